"""What all commands print: a record as JSON or as a table on stdout, an error or a note as one line on stderr."""

from __future__ import annotations

import dataclasses
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeVar

import typer

from gppcs import __version__
from gppcs.engine.memory import peak_memory
from gppcs.engine.strict_json import strict_json
from gppcs.engine.threads import set_threads
from gppcs.engine.timer import COMPILATION, Timer
from gppcs.errors import GppcsError, InputError, with_addresses

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud

Item = TypeVar("Item")

BAD_INPUT = 2
OPTIONS = {"n_points": "points", "n_faces": "faces", "format": "from"}  # by other names than arguments of the library
FAILURES = (GppcsError, OSError, MemoryError)  # printed as one line, without a traceback


def visible(text: str) -> str:
    """Return a text with whole addresses, and escapes for what would control the terminal, besides line breaks."""
    whole = with_addresses(text)
    return "".join(char if char.isprintable() or char == "\n" else ascii(char)[1:-1] for char in whole)


def say(text: str) -> None:
    """Print a text on stdout."""
    typer.echo(visible(text))


def print_error(message: str) -> None:
    """Print an error or a note as one line on stderr, with options in place of `argument` and `argument=value`."""
    text = re.sub(r"(?<![\w./])`(\w+)(?:=(?:True|'?(.*?)'?))?`(?!\w|\.\w|/)", _option, f"gppcs: {message}")
    typer.echo(visible(" ".join(text.split())), err=True)


def _option(argument: re.Match[str]) -> str:
    """Return the option, with its value if it has one, that sets an argument of the library."""
    name, value = argument.groups()
    return f"--{OPTIONS.get(name, name.replace('_', '-'))} {value or ''}".rstrip()


def note_left_out(path: Path, names: list[str]) -> None:
    """Print on stderr what a file does not hold as it was."""
    if names:
        print_error(f"note: {path}: does not hold: {', '.join(names)}")


def note_units(path: Path | str, cloud: PointCloud, unit: str | None = None) -> None:
    """Print on stderr what is measured if axes have different units, or if `unit` is not that of the file."""
    from gppcs.clouds.quantities import names_of_units

    if cloud.units is None or not len(cloud):
        return
    names = horizontal, vertical = names_of_units(cloud.units)
    in_words = horizontal if horizontal == vertical else f"{horizontal} in x and y, and {vertical} in z"
    if unit is not None and names != (unit, unit):
        print_error(f"note: {path}: its coordinate system says that the unit is {in_words}; --unit {unit} is used")
    elif unit is None and cloud.units.is_geographic and (cloud.factors() == 1.0).all():
        print_error(f"note: {path}: coordinates are no {horizontal}, as its coordinate system says; metres are assumed")
    elif unit is None and horizontal != vertical:
        lengths = "m, around the middle of the cloud" if cloud.units.is_geographic else horizontal
        print_error(f"note: {path}: {in_words}: distances are measured in {lengths}; coordinates stay as they are")


def print_failure(error: BaseException, source: Path | None = None) -> None:
    """Print an error as one line on stderr, behind the file that it is about."""
    if isinstance(error, InputError) and source:
        print_error(f"{source}: {error}")
    elif isinstance(error, OSError) and error.filename:
        print_error(f"{error.filename}: {error.strerror}")
    else:
        print_error(str(error) or "not enough memory")


def for_each(items: Iterable[tuple[Path, Item]], work: Callable[[Item], None]) -> None:
    """Work on items of files. If that fails for one, others are still worked on, and the program ends with an error."""
    failed = False
    for file, item in items:
        try:
            work(item)
        except BrokenPipeError:  # nobody reads the results any more
            raise
        except FAILURES as error:
            print_failure(error, file)
            failed = True
    if failed:
        raise typer.Exit(BAD_INPUT)


def started(quiet: bool, threads: int | None = None, in_pipes: bool = False) -> Timer:
    """Return the timer of a run in so many threads, which shows progress and notices unless the user wants quiet.

    With `in_pipes`, lines show the later stages of a long run where no terminal would show a bar.
    """
    set_threads(threads)
    if quiet:
        logging.getLogger("gppcs").setLevel(logging.WARNING)
        return Timer()
    from gppcs.engine.progress import PATIENCE, ProgressBar, ProgressLines

    lines, start = ProgressLines(), perf_counter()
    if os.environ.get("GPPCS_PROGRESS") == "lines":
        return Timer(lines)
    if not in_pipes or sys.stderr.isatty():
        return Timer(ProgressBar())
    return Timer(lambda *stage: lines(*stage) if perf_counter() - start > PATIENCE else None)


def emit(
    record: Any, as_json: bool, quiet: bool = False, title: str = "", table: Mapping[str, Any] | None = None
) -> None:
    """Print a result, a dataclass or a dictionary, as one line of JSON, or it or other table as a table."""
    record = dataclasses.asdict(record) if dataclasses.is_dataclass(record) else record  # type: ignore[arg-type]
    if as_json:
        say(strict_json(record))
    elif not quiet:
        # A name with blanks is a title, in which names of attributes are as conditions take them.
        titles = {name: name if " " in name else name.replace("_", " ") for name in table or record}
        texts = {visible(titles[name]): text_of(value) for name, value in (table or record).items()}
        width = max(map(len, texts))
        typer.secho(visible(title), bold=True)
        for name, text in texts.items():
            say(f"{name:<{width}}  {text}".rstrip())


def unit_text(unit: str | None) -> str:
    """Return the unit of the lengths in a table."""
    return unit or "that of the coordinates, which the file does not say"


def text_of(value: Any) -> str:
    """Return a value as tables show it: numbers with six digits, whole ones in full, None as a dash."""
    if isinstance(value, float):
        return f"{value:,.0f}" if value.is_integer() and abs(value) < 1e15 else f"{value:.6g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if isinstance(value, tuple | list):
        return "  ".join(map(text_of, value))
    return "-" if value is None else str(value)


def record_of_run(diagnostics: Mapping[str, float], seconds: Mapping[str, float]) -> dict[str, Any]:
    """Return what the record of each run ends with."""
    return {
        "diagnostics": dict(diagnostics),
        "seconds": dict(seconds),
        "seconds_compiling": seconds.get(COMPILATION, 0.0),
        "peak_memory": peak_memory(),
        "version": __version__,
    }


def time_in_words(seconds: Mapping[str, float]) -> str:
    """Return the time of a run, and of the stages that took at least a tenth of it."""
    total = sum(seconds.values())
    stages = "".join(f"; {stage} {value:.2f} s" for stage, value in seconds.items() if value >= 0.1 * total)
    return f"{total:.2f} s{stages}"


def names_of(text: str | None) -> list[str] | None:
    """Return the names in an option that takes several."""
    return None if text is None else [name.strip() for name in text.split(",")]
