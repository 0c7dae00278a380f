"""Output that all commands share: JSON and tables on stdout, an error as one line on stderr."""

from __future__ import annotations

import logging
import os
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import typer

from gppcs import __version__
from gppcs.clouds.quantities import METRES, SHARE
from gppcs.engine.memory import peak_memory
from gppcs.engine.strict_json import strict_json
from gppcs.engine.threads import set_threads
from gppcs.engine.timer import COMPILATION, Timer
from gppcs.errors import GppcsError, InputError
from gppcs.evaluation.report import MeshReport, Report, figure_called

BAD_INPUT = 2
MOST_IN_FULL = 1e15  # of whole numbers; floats hold larger ones without their last digits
LONG = 0.1  # the share of the time from which a stage is named
CONTROLS = {"Cc", "Cf", "Cs", "Zl", "Zp"}  # Unicode categories: controls, marks of direction, what is no text, breaks
FAILURES = (GppcsError, OSError, MemoryError)  # printed as one line, without a traceback


def visible(text: str) -> str:
    """Return a text with escapes for characters that would control the terminal, besides line breaks."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        ascii(char)[1:-1] if unicodedata.category(char) in CONTROLS and char != "\n" else char for char in text
    )


def say(text: str) -> None:
    """Print a text on stdout."""
    typer.echo(visible(text))


def say_aside(text: str) -> None:
    """Print a text on stderr, as one line."""
    typer.echo(visible(" ".join(text.split())), err=True)


def started(quiet: bool, threads: int | None = None) -> Timer:
    """Return the timer of a run in so many threads, which shows progress and notices unless the user wants quiet."""
    from gppcs.engine.progress import ProgressBar, ProgressLines

    set_threads(threads)
    if quiet:
        logging.getLogger("gppcs").setLevel(logging.WARNING)
        return Timer()
    return Timer(ProgressLines() if os.environ.get("GPPCS_PROGRESS") == "lines" else ProgressBar())


def names_of(text: str | None) -> list[str] | None:
    """Return the names in an option that takes several."""
    return None if text is None else [name.strip() for name in text.split(",")]


def for_each(files: Iterable[Path], work: Callable[[Path], None]) -> None:
    """Work on each file. If that fails for one, the others are still worked on, and the program ends with an error."""
    failed = False
    for file in files:
        try:
            work(file)
        except FAILURES as error:
            tell(error, file)
            failed = True
    if failed:
        raise typer.Exit(BAD_INPUT)


def show(record: Mapping[str, Any], title: str, rows: Mapping[str, str], as_json: bool, quiet: bool = False) -> None:
    """Print a result as JSON, or as a table."""
    from gppcs.app.console import print_table

    if as_json:
        print_json(record)
    elif not quiet:
        print_table(title, rows)


def record_of_run(diagnostics: Mapping[str, float], seconds: Mapping[str, float]) -> dict[str, Any]:
    """Return what the record of each run ends with."""
    return {
        "diagnostics": dict(diagnostics),
        "seconds": dict(seconds),
        "seconds_compiling": seconds.get(COMPILATION, 0.0),
        "peak_memory": peak_memory(),
        "version": __version__,
    }


def number_in_words(value: float) -> str:
    """Return a number with four digits, or in full if it is whole and not huge."""
    return f"{value:,.0f}" if value.is_integer() and abs(value) < MOST_IN_FULL else f"{value:.4g}"


def time_in_words(seconds: Mapping[str, float]) -> str:
    """Return the time of a run, and the stages that took most of it."""
    from gppcs.engine.kernel_cache import folder_to_write

    total, compilation = sum(seconds.values()), seconds.get(COMPILATION, 0.0)
    text = f"{total:.2f} s"
    if compilation:
        text += f", of which {compilation:.2f} s compiling kernels{', this time only' if folder_to_write() else ''}"
    least = LONG * (total - compilation)
    named = {stage: value for stage, value in seconds.items() if stage != COMPILATION and value >= least}
    return text + "".join(f"; {stage} {value:.2f} s" for stage, value in named.items())


def print_json(record: Mapping[str, Any]) -> None:
    """Print a record as one line of strict JSON."""
    say(strict_json(record))


def figure_rows(report: Report | MeshReport, unit: str | None) -> dict[str, str]:
    """Return the figures of a report as rows of a table, with units, below a verdict in a sentence."""
    raw, relative = report.figures(), report.figures(relative=True)
    of_unit = f" {unit}" if unit else ""
    rows = {"verdict": _verdict(report, of_unit)}
    for name, value in raw.items():
        if name in ("points_in", "points_out"):
            continue
        rows[name.replace("_", " ")] = {
            "count": f"{value:,.0f}",
            "length": length_in_words(value, unit, raw["diagonal"] if name != "diagonal" else None),
            "squared length": f"{value:.4g}{of_unit and of_unit + '²'}  ({relative[name]:.3g} of the squared diagonal)",
            "degrees": f"{value:.4g} degrees",
            "share": f"{100 * value:.4g} %",
            "ratio": f"{value:.4g}",
        }[figure_called(name).unit]
    return rows | of_unknown_unit(unit)


def length_in_words(value: float, unit: str | None, diagonal: float | None) -> str:
    """Return a length with its unit, if it is known, and as a share of a diagonal, if one is given."""
    words = f"{value:.4g} {unit}" if unit else f"{value:.4g}"
    return f"{words}  ({value / diagonal:.3%} of the diagonal)" if diagonal else words


def of_unknown_unit(unit: str | None) -> dict[str, str]:
    """Return the row that tells that the unit of lengths is not known, if it is not."""
    return {} if unit else {"lengths": "in the unit of the coordinates, which the file does not tell"}


def _verdict(report: Report | MeshReport, unit: str) -> str:
    """Return in a sentence how far the original points are from what was made of them."""
    if isinstance(report, MeshReport):
        most, mean = report.mesh_max, report.mesh_mean
        return f"no point is farther than {most:.3g}{unit} from the mesh; on average they are {mean:.3g}{unit} from it"
    most, nearer = report.surface_max, report.surface_p95
    return (
        f"no original point is farther than {most:.3g}{unit} from the surface through the kept points; 95 % are within "
        f"{nearer:.3g}{unit}"
    )


def tell(error: BaseException, source: Path | None = None) -> None:
    """Print an error as one line on stderr."""
    if isinstance(error, InputError) and source:
        print_error(f"{source}: {error}")
    elif isinstance(error, GppcsError):
        print_error(str(error))
    elif isinstance(error, OSError) and error.filename:
        is_unit = isinstance(error, FileNotFoundError) and str(error.filename) in (*METRES, SHARE)
        hint = f"; if it is the unit of a length, write no space before it: 1{error.filename}" if is_unit else ""
        print_error(f"{error.filename}: {error.strerror}{hint}")
    else:
        print_error(str(error) or "not enough memory")


def note_left_out(path: Path, names: list[str]) -> None:
    """Print on stderr what was left out."""
    if names:
        print_error(f"note: {path}: left out: {', '.join(names)}")


def print_error(message: str) -> None:
    """Print a message as one line on stderr."""
    say_aside(f"gppcs: {message}")
