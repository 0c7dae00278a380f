"""The command-line program `gppcs`: results go to stdout, progress and errors to stderr."""

import inspect
import logging
import os
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from gppcs import __version__
from gppcs.app.printing import BAD_INPUT, FAILURES, print_error, print_failure, say

COMMANDS = (
    "simplify", "mesh", "evaluate", "compare", "report", "view", "render", "info", "convert", "sample", "methods",
    "warmup",
)  # fmt: skip

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs sample bracket -o scan.ply\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.03\n\n"
    "gppcs render scan.ply small.ply -o both.png\n\n"
    "gppcs mesh scan.ply -o mesh.ply --points 5000\n\n"
    "gppcs compare scan.ply --points 5000 --methods gp-spectral,fps,hc -o comparison\n\n"
    "gppcs info small.ply\n\n"
    "gppcs --install-completion\n\n"
    "gppcs COMMAND --help explains a command."
)


class _Command(TyperCommand):
    """A command whose help shows no type of value behind flags, which take none."""

    def get_params(self, ctx: Any) -> Any:
        params = super().get_params(ctx)
        for param in params:
            if getattr(param, "is_flag", False):
                param.metavar = ""
        return params


def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        say(__version__)
        raise typer.Exit


def program(commands: Sequence[str] = COMMANDS) -> typer.Typer:
    """Return the program with some of its commands: to make all takes longer than many a run."""
    app = typer.Typer(
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        help="Thin a point cloud to exactly the number of points asked for, and keep its features.",
        epilog=EPILOG,
    )
    app.callback(invoke_without_command=True)(_root)
    for name in commands:
        module = import_module(f"gppcs.app.commands.{name}")
        function = getattr(module, name)
        text = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.getdoc(function) or "")  # without the line breaks of the source
        app.command(cls=_Command, help=text, epilog=f"[bold]Examples[/bold]\n\n{module.EPILOG}")(function)
    return app


def run(arguments: Sequence[str]) -> int:
    """Run the program and return its exit code."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal may not show all characters of file names
    try:
        with _messages_on_stderr():
            line = list(arguments) or ["--help"]
            app = program(line[:1] if line[0] in COMMANDS else COMMANDS)
            code = app(line, prog_name="gppcs", standalone_mode=False, obj=["gppcs", *line])  # obj: shown by pages
    except BrokenPipeError:  # as of `gppcs info scans | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is flushed at the end
        return 1
    except FAILURES as error:
        print_failure(error)
        return BAD_INPUT
    except Exception as error:
        if not hasattr(error, "format_message"):  # errors of Typer about the command line have it
            raise
        # Without what pydantic, by which Typer reads values, adds to messages.
        print_error(re.sub(r"Value error, |, unable to parse string as an? \w+", "", error.format_message()))
        return BAD_INPUT
    return code if isinstance(code, int) else 0


@contextmanager
def _messages_on_stderr() -> Iterator[None]:
    """Show what the library warns of and logs while the block runs, such as that it compiles its kernels."""
    logger, handler = logging.getLogger("gppcs"), logging.StreamHandler()
    handler.setFormatter(logging.Formatter("gppcs: %(message)s"))
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)  # each once
        warnings.showwarning = lambda message, *_, **__: print_error(f"note: {message}")
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        try:
            yield
        finally:
            logger.setLevel(logging.NOTSET)
            logger.removeHandler(handler)
