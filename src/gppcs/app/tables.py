"""Tables of a comparison: a selection of the figures for terminal and Markdown, and all of them as CSV."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import pandas
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gppcs.app.printing import visible
from gppcs.evaluation.comparison import Entry
from gppcs.evaluation.report import definition_of

UNITS = "Lengths in 1e-4 diagonals of the original's bounding box, Chamfer in 1e-6 squared diagonals, angles in degrees"
SHOWN = (
    "points_out", "seconds",
    "hausdorff_mean", "hausdorff_max", "estimated_hausdorff_mean", "estimated_hausdorff_max", "stray_share",
    "surface_mean", "surface_mean_by_area", "surface_max", "feature_error", "feature_recall", "normal_deviation",
    "mean_surface_variation", "covering_radius", "covering_p999", "mean_distance", "chamfer",
)  # fmt: skip

Cell = tuple[str, bool]  # a value as text, and whether it is the best of its column


def record_of(entry: Entry) -> dict[str, Any]:
    """Return the record of a method, as `--json` prints it."""
    return {
        "method": entry.method.name,
        "parameters": dataclasses.asdict(entry.method),
        "seconds": entry.seconds,
        "figures": entry.report.figures(),
        "relative": entry.report.figures(relative=True),
        "failure": entry.failure,
    }


def columns_of(records: Sequence[dict[str, Any]]) -> dict[str, list[Cell]]:
    """Return the columns for terminal and Markdown by their titles."""
    columns = {}
    values_of = [record["relative"] | {"seconds": record["seconds"]} for record in records]
    of_attributes = dict.fromkeys(name for values in values_of for name in values if name.endswith("error_mean"))
    for name in (*SHOWN, *of_attributes):
        values = [record.get(name) for record in values_of]
        measured = [value for value in values if value is not None]
        if not measured:
            continue
        figure = None if name == "seconds" else definition_of(name)
        better = figure.better if figure else "less"
        best = (max if better == "more" else min)(measured) if better and len(set(measured)) > 1 else None
        factor = (1.0, 1e4, 1e6)[figure.power] if figure else 1.0  # as the units say
        title = "points" if name == "points_out" else name.replace("_", " ")
        columns[title] = [(_text(value, factor), value is not None and value == best) for value in values]
    return columns


def _text(value: float | None, factor: float) -> str:
    """Return a number with three significant digits, whole ones in full."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value:,}"
    rounded = f"{factor * value:.3g}"
    return rounded if abs(float(rounded)) < 1000 else f"{factor * value:.0f}"


def print_table(labels: Sequence[str], columns: dict[str, list[Cell]]) -> None:
    """Print a comparison, wider than the terminal rather than cut. The best value of each column is bold."""
    table = Table("method", box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for title, cells in columns.items():
        width = max(len(word) for word in (*title.split(), *(text for text, _ in cells)))
        table.add_column(title, justify="right", width=width)
    for number, label in enumerate(labels):
        row = [cells[number] for cells in columns.values()]
        table.add_row(Text(visible(label)), *(Text(text, style="bold" if best else "") for text, best in row))
    console = Console(highlight=False)
    console.width = max(console.width, Console(width=10_000).measure(table).maximum)
    console.print(table)
    console.print(UNITS, style="dim")


def as_markdown(labels: Sequence[str], columns: dict[str, list[Cell]]) -> str:
    """Return a comparison as a Markdown table."""
    lines = [["method", *columns], ["---"] * (len(columns) + 1)]
    for number, label in enumerate(labels):
        row = [cells[number] for cells in columns.values()]
        lines.append([label, *(f"**{text}**" if best else text for text, best in row)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\n{UNITS}; bold: the best.\n"


def as_csv(records: Sequence[dict[str, Any]]) -> str:
    """Return a comparison as CSV, with all figures."""
    flat = []
    for record in records:
        row = {name: value for name, value in record.items() if name not in ("figures", "relative")}
        row["failure"] = " ".join((record["failure"] or "").split())
        row["parameters"] = " ".join(f"{name}={value}" for name, value in record["parameters"].items())
        for name, value in record["relative"].items():
            if name != "diagonal" and definition_of(name).power:
                row[f"{name}_relative"] = value
        flat.append(row | record["figures"])
    table = pandas.DataFrame(flat, dtype=object)  # whole numbers stay whole beside missing ones
    names = sorted(table, key=lambda name: (name == "failure", name.endswith("_relative")))
    return table.to_csv(columns=names, index=False, lineterminator="\n")
