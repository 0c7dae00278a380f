"""What all commands print: results as tables or as JSON on stdout, what went wrong as one line on stderr."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from gppcs.app.tables import FIGURES
from gppcs.errors import GppcsError, InputError, OutputError
from gppcs.evaluation.report import Report

BAD_INPUT = 2
FAILURES = (GppcsError, OSError, MemoryError)  # told in one line

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object a line, for machines.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist; never an input.")]

Invalid = Annotated[Literal["error", "drop"], typer.Option(help="What to do with NaN and infinite coordinates.")]


def print_json(record: dict[str, Any]) -> None:
    """Print one line of strict JSON; what is not a number becomes null."""

    def strict(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: strict(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [strict(item) for item in value]
        if isinstance(value, float) and value - value != 0:
            return None
        return value

    typer.echo(json.dumps(strict(record), allow_nan=False))


def figure_rows(report: Report) -> dict[str, str]:
    """Return the figures as rows of a table with their units, lengths in diagonals of the original as well."""
    raw, relative = report.figures(), report.figures(relative=True)
    rows = {}
    for name, value in raw.items():
        if name in ("points_in", "points_out"):
            continue
        unit = FIGURES[name.removeprefix("carried_")].unit
        rows[name.replace("_", " ")] = {
            "count": f"{value:,}",
            "length": f"{value:.4g}" + (f"  ({relative[name]:.3g} of the diagonal)" if name != "diagonal" else ""),
            "squared length": f"{value:.4g}  ({relative[name]:.3g} of the squared diagonal)",
            "degrees": f"{value:.4g} degrees",
            "share": f"{100 * value:.4g} %",
            "ratio": f"{value:.4g}",
        }[unit]
    return {**rows, "lengths": "in the unit of the coordinates"}


def refuse_input(target: Path, source: Path) -> None:
    """Raise an OutputError if the file to write is the one to read."""
    if target.exists() and source.exists() and target.samefile(source):
        raise OutputError(f"{target}: expected a file other than the input, found the same; choose another name")


def tell(error: BaseException, source: Path | None = None) -> None:
    """Print what went wrong; errors about a cloud do not know which file it came from."""
    if isinstance(error, InputError) and source:
        print_error(f"{source}: {error}")
    elif isinstance(error, OSError) and error.filename:
        print_error(f"{error.filename}: {error.strerror}")
    else:
        print_error(str(error) or "not enough memory")


def print_error(message: str) -> None:
    """Print a line on stderr."""
    typer.echo(f"gppcs: {' '.join(message.split())}", err=True)
