"""Tables of a comparison: a selection of columns for terminal and Markdown, and CSV with all figures."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Literal

from gppcs.evaluation.report import MeshReport, Rebuilt, Report, figures_of

if TYPE_CHECKING:
    from gppcs.evaluation.comparison import Entry

FIGURES = {**figures_of(Report), **figures_of(Rebuilt), **figures_of(MeshReport)}
FACTORS = {"length": 1e4, "squared length": 1e6}
UNITS = "Lengths in 1e-4 diagonals of the original's bounding box, Chamfer in 1e-6 squared diagonals, angles in degrees"
SHOWN = (
    "hausdorff_mean", "hausdorff_max", "carried_hausdorff_mean", "carried_hausdorff_max", "stray_share",
    "surface_mean", "surface_max", "feature_error", "feature_recall", "normal_deviation", "mean_surface_variation",
    "covering_radius", "mean_distance", "chamfer",
)  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One column of a table: a figure of each method.

    Attributes
    ----------
    title : str
        The name of the figure.
    values : tuple of (float or None)
        The value of each method, in the unit that `UNITS` gives; None if a method has no such value.
    better : "less", "more" or None
        Which values are better; None if neither are.
    """

    title: str
    values: tuple[float | None, ...]
    better: Literal["less", "more"] | None

    def is_best(self, row: int) -> bool:
        """Return whether a row has the best value.

        Parameters
        ----------
        row : int
            Index of the method.

        Returns
        -------
        bool
            False for all rows if all known values are equal or neither are better.
        """
        known = [value for value in self.values if value is not None]
        if self.better is None or len(set(known)) < 2:
            return False
        return self.values[row] == (min(known) if self.better == "less" else max(known))


def columns_of(entries: Sequence[Entry]) -> list[Column]:
    """Return the columns for terminal and Markdown.

    Parameters
    ----------
    entries : sequence of Entry
        One for each method.

    Returns
    -------
    list of Column
        Lengths are in the units of `UNITS`. Figures that no method has are left out.
    """
    columns = [
        Column("points", tuple(entry.report.points_out for entry in entries), None),
        Column("seconds", tuple(entry.seconds for entry in entries), "less"),
    ]
    relative = [entry.report.figures(relative=True) for entry in entries]
    for name in SHOWN:
        if any(name in figures for figures in relative):
            known = FIGURES[name.removeprefix("carried_")]
            values = (figures.get(name) for figures in relative)
            scaled = tuple(None if value is None else FACTORS.get(known.unit, 1) * value for value in values)
            columns.append(Column(name.replace("_", " "), scaled, known.better))
    return columns


def shown(value: float | None) -> str:
    """Return a number with three significant digits.

    Parameters
    ----------
    value : float, int or None
        An int is shown in full, and None as a hyphen.

    Returns
    -------
    str
    """
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value:,}"
    rounded = f"{value:.3g}"
    return rounded if abs(float(rounded)) < 1000 else f"{value:.0f}"


def as_markdown(entries: Sequence[Entry]) -> str:
    """Return a comparison as a Markdown table, with a row for each method.

    Parameters
    ----------
    entries : sequence of Entry
        One for each method.

    Returns
    -------
    str
        The best value of each column is bold.
    """
    columns = columns_of(entries)
    lines = [["method", *(column.title for column in columns)], ["---"] * (len(columns) + 1)]
    for row, entry in enumerate(entries):
        cells = (
            f"**{shown(column.values[row])}**" if column.is_best(row) else shown(column.values[row])
            for column in columns
        )
        lines.append([entry.result.method.label, *cells])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\n{UNITS}; bold: the best.\n"


def as_csv(entries: Sequence[Entry]) -> str:
    """Return a comparison as CSV, with a row for each method.

    Parameters
    ----------
    entries : sequence of Entry
        One for each method.

    Returns
    -------
    str
        Method, parameters (in the form of `gppcs simplify --set`, separated by spaces), all figures, lengths also
        relative to the diagonal, and why a surface could not be rebuilt.
    """
    rows = []
    for entry in entries:
        relative = {
            f"{name}_relative": value
            for name, value in entry.report.figures(relative=True).items()
            if name != "diagonal" and FIGURES[name.removeprefix("carried_")].unit in FACTORS
        }
        method = entry.result.method
        parameters = " ".join(f"{name}={value}" for name, value in dataclasses.asdict(method).items())
        known = {"method": method.name, "parameters": parameters, "seconds": entry.seconds}
        rows.append({**known, **entry.report.figures(), **relative})
    names = [*dict.fromkeys(name for row in rows for name in row), "failure"]
    for row, entry in zip(rows, entries, strict=True):
        row["failure"] = " ".join(entry.failure.split()) if entry.failure else ""
    file = StringIO()
    writer = csv.DictWriter(file, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue()
