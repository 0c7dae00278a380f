"""Tables of a comparison: a selection of columns for terminal and Markdown, and CSV with all figures."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Any, Literal

from gppcs.evaluation.report import figure_called

if TYPE_CHECKING:
    from gppcs.evaluation.comparison import Entry
    from gppcs.evaluation.mesh_comparison import MeshEntry

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
ERROR = "error_mean"  # ends the figures of attributes that are shown


@dataclass(frozen=True)
class Row:
    """What the tables say of one method or way to a mesh; `counts` is its size by the titles of columns."""

    kind: Literal["method", "way"]
    name: str
    label: str
    parameters: Mapping[str, Any]
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
        figures, relative = (report.figures(), report.figures(relative=True)) if report else ({}, {})
        measured = entry.seconds, figures, relative, entry.failure
        if isinstance(entry, Entry):
            method = entry.result.method
            counts = {"points": entry.report.points_out}
            return cls("method", method.name, str(method), dataclasses.asdict(method), counts, *measured)
        counts = {"vertices": entry.report.vertices, "triangles": entry.report.triangles} if entry.report else {}
        return cls("way", entry.way, entry.way, {}, counts, *measured)


@dataclass(frozen=True)
class Column:
    """A figure of each method or way, in the unit that `units_of` gives, and which values of it are better, if any."""

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
    of_attributes = dict.fromkeys(name for row in rows for name in row.relative if name.endswith(ERROR))
    for name in (*SHOWN, *of_attributes):
        if any(name in row.relative for row in rows):
            known = figure_called(name)
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
        marked = (("**" if each.is_best(number) else "", as_text(each.values[number])) for each in columns)
        lines.append([row.label, *(f"{mark}{text}{mark}" for mark, text in marked)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\n{units_of(rows)}; bold: the best.\n"


def as_csv(rows: Sequence[Row]) -> str:
    """Return a comparison as CSV."""
    records: list[dict[str, Any]] = []
    for row in rows:
        parameters = " ".join(f"{name}={value}" for name, value in row.parameters.items())
        relative = {
            f"{name}_relative": value
            for name, value in row.relative.items()
            if name != "diagonal" and figure_called(name).unit in FACTORS
        }
        known = {"parameters": parameters} if row.kind == "method" else {}
        records.append({row.kind: row.name, **known, "seconds": row.seconds, **row.figures, **relative})
    names = [*dict.fromkeys(name for record in records for name in record), "failure"]
    for record, row in zip(records, rows, strict=True):
        record["failure"] = " ".join((row.failure or "").split())
    file = StringIO()
    writer = csv.DictWriter(file, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return file.getvalue()
