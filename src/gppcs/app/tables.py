"""Tables of a comparison: a selection of columns for terminal and Markdown, and CSV with all figures."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Any, Literal

from gppcs.evaluation.report import MeshReport, Rebuilt, Report, figures_of

if TYPE_CHECKING:
    from gppcs.evaluation.comparison import Entry
    from gppcs.evaluation.mesh_comparison import MeshEntry

FIGURES = {**figures_of(Report), **figures_of(Rebuilt), **figures_of(MeshReport)}
FACTORS = {"length": 1e4, "squared length": 1e6}
UNITS = "Lengths in 1e-4 diagonals of the original's bounding box, Chamfer in 1e-6 squared diagonals, angles in degrees"
UNITS_OF_MESHES = "Lengths in 1e-4 diagonals of the original's bounding box, slivers as a share of the triangles"
SHOWN = (
    "hausdorff_mean", "hausdorff_max", "carried_hausdorff_mean", "carried_hausdorff_max", "stray_share",
    "surface_mean", "surface_mean_by_area", "surface_max", "feature_error", "feature_recall", "normal_deviation",
    "mean_surface_variation", "covering_radius", "covering_p999", "mean_distance", "chamfer",
    "mesh_mean", "mesh_max", "mesh_back_mean", "mesh_back_max", "mesh_pieces", "borders", "genus",
    "non_manifold_edges", "non_manifold_vertices", "self_intersections", "slivers",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """What the tables say of one method, or of one way to a mesh.

    Attributes
    ----------
    kind : str
        "method" or "way".
    name : str
        Its name.
    label : str
        The same with parameters that are not the usual ones.
    parameters : mapping of str to object, or None
        All parameters; None for ways, which have none.
    counts : mapping of str to int
        The size of the result, by the titles of columns. Empty without a result.
    seconds : float
        Wall time.
    figures, relative : mapping of str to float
        The figures of the result, also relative to the diagonal.
    failure : str or None
        Why figures are missing.
    """

    kind: Literal["method", "way"]
    name: str
    label: str
    parameters: Mapping[str, Any] | None
    counts: Mapping[str, int]
    seconds: float
    figures: Mapping[str, float]
    relative: Mapping[str, float]
    failure: str | None

    @classmethod
    def of(cls, entry: Entry | MeshEntry) -> Row:
        """Return the row of an entry of a comparison."""
        from gppcs.evaluation.comparison import Entry

        report = entry.report
        known: dict[str, Any] = {
            "seconds": entry.seconds,
            "figures": report.figures() if report else {},
            "relative": report.figures(relative=True) if report else {},
            "failure": entry.failure,
        }
        if isinstance(entry, Entry):
            method = entry.result.method
            counts = {"points": entry.report.points_out}
            return cls("method", method.name, str(method), dataclasses.asdict(method), counts, **known)
        counts = {"vertices": entry.report.vertices, "triangles": entry.report.triangles} if entry.report else {}
        return cls("way", entry.way, entry.way, None, counts, **known)


@dataclass(frozen=True)
class Column:
    """One column of a table: a figure of each method or way.

    Attributes
    ----------
    title : str
        The name of the figure.
    values : tuple of (float or None)
        The value of each row, in the unit that `units_of` gives; None if a row has no such value.
    better : "less", "more" or None
        Which values are better; None if neither are.
    """

    title: str
    values: tuple[float | None, ...]
    better: Literal["less", "more"] | None

    def is_best(self, row: int) -> bool:
        """Return whether a row has the best value."""
        known = [value for value in self.values if value is not None]
        if self.better is None or len(set(known)) < 2:
            return False
        return self.values[row] == (min(known) if self.better == "less" else max(known))


def columns_of(rows: Sequence[Row]) -> list[Column]:
    """Return the columns for terminal and Markdown."""
    counts = dict.fromkeys(name for row in rows for name in row.counts)
    columns = [
        *(Column(name, tuple(row.counts.get(name) for row in rows), None) for name in counts),
        Column("seconds", tuple(row.seconds for row in rows), "less"),
    ]
    for name in SHOWN:
        if any(name in row.relative for row in rows):
            known = FIGURES[name.removeprefix("carried_")]
            values = (row.relative.get(name) for row in rows)
            scaled = tuple(None if value is None else FACTORS.get(known.unit, 1) * value for value in values)
            columns.append(Column(name.replace("_", " "), scaled, known.better))
    return columns


def units_of(rows: Sequence[Row]) -> str:
    """Return the units of a table in words."""
    return UNITS if rows[0].kind == "method" else UNITS_OF_MESHES


def as_text(value: float | None) -> str:
    """Return a number with three significant digits."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value:,}"
    rounded = f"{value:.3g}"
    return rounded if abs(float(rounded)) < 1000 else f"{value:.0f}"


def as_markdown(rows: Sequence[Row]) -> str:
    """Return a comparison as a Markdown table."""
    columns = columns_of(rows)
    lines = [[rows[0].kind, *(column.title for column in columns)], ["---"] * (len(columns) + 1)]
    for number, row in enumerate(rows):
        cells = (
            f"**{as_text(column.values[number])}**" if column.is_best(number) else as_text(column.values[number])
            for column in columns
        )
        lines.append([row.label, *cells])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\n{units_of(rows)}; bold: the best.\n"


def as_csv(rows: Sequence[Row]) -> str:
    """Return a comparison as CSV."""
    records: list[dict[str, Any]] = []
    for row in rows:
        relative = {
            f"{name}_relative": value
            for name, value in row.relative.items()
            if name != "diagonal" and FIGURES[name.removeprefix("carried_")].unit in FACTORS
        }
        named: dict[str, str] = {row.kind: row.name}
        if row.parameters is not None:
            named["parameters"] = " ".join(f"{name}={value}" for name, value in row.parameters.items())
        records.append({**named, "seconds": row.seconds, **row.figures, **relative})
    names = [*dict.fromkeys(name for record in records for name in record), "failure"]
    for record, row in zip(records, rows, strict=True):
        record["failure"] = " ".join(row.failure.split()) if row.failure else ""
    file = StringIO()
    writer = csv.DictWriter(file, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return file.getvalue()
