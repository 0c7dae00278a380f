"""The command `gppcs`: results to stdout, progress and errors to stderr."""

from __future__ import annotations

import gc
import sys
from io import TextIOWrapper
from typing import Annotated

import typer

from gppcs import __version__
from gppcs.app.commands import compare, evaluate, info, methods, sample, simplify, warmup
from gppcs.app.printing import BAD_INPUT, FAILURES, print_error, tell

INTERRUPTED = 130
GARBAGE = 1_000_000  # objects between two searches for garbage; with Python's 700 these slow the loading of modules

app = typer.Typer(
    name="gppcs",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Thin a point cloud to exactly the number of points asked for, and keep its features.",
    epilog="[bold]Examples[/bold]\n\n"
    "gppcs sample bracket -o scan.ply\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.03 --picture small.png\n\n"
    "gppcs compare scan.ply --points 5000 --methods gp-spectral,fps,hc -o comparison\n\n"
    "gppcs info small.ply\n\n"
    "gppcs COMMAND --help says more of each command.",
)


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit


app.command(epilog=simplify.EPILOG)(simplify.simplify)
app.command(epilog=evaluate.EPILOG)(evaluate.evaluate)
app.command(epilog=compare.EPILOG)(compare.compare)
app.command(epilog=info.EPILOG)(info.info)
app.command(epilog=sample.EPILOG)(sample.sample)
app.command(epilog=methods.EPILOG)(methods.methods)
app.command(epilog=warmup.EPILOG)(warmup.warmup)


def main() -> None:
    """Run the command; what goes wrong becomes one line on stderr and exit code 2."""
    gc.set_threshold(GARBAGE)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may hold anything, terminals may not
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except FAILURES as error:
        tell(error)
        code = BAD_INPUT
    except KeyboardInterrupt:
        code = INTERRUPTED
    except Exception as error:
        if not hasattr(error, "format_message"):  # Typer's own complaints about the command line
            raise
        print_error(error.format_message())
        code = BAD_INPUT
    sys.exit(code if isinstance(code, int) else 0)
