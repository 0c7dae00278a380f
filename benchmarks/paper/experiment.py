"""What the experiments of the paper share: methods, runs and tables.

A script runs all methods, or those named on its command line. It writes to `results/` only if it ran all methods.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import gppcs
import report
from data import path_of
from gppcs.amounts.options import Options, method_of
from gppcs.engine.timer import timer_of
from gppcs.evaluation.comparison import PREPARATION_POINTS, Entry, those_that_fit
from gppcs.evaluation.judge import judged
from gppcs.evaluation.report import Rebuilt
from gppcs.methods.pc_simp.graph_filter import NeighbourGraph
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree

CANDIDATES = 25_000  # random points that the experiments of the paper choose from
RELEASED_WEIGHT = 1e-3  # lambda in PC-Simp's released program
COUNTERPARTS = {  # the method of the paper that a method is compared with
    "gp": "GP",
    "gp-spectral": "GP",
    "fps-variation": "GP",
    "hc": "HC",
    "wlop": "WLOP",
    "pc-simp": "PC-Simp",
    "aivs": "AIVS",
    "potamias": "Potamias et al.",
}
RELEASED_NOTE = (
    "pc-simp, released weight, has the lambda of the released program, 1e-3, for coordinates in the file's unit. So "
    "the unit decides how even its choice is. Like pc-simp, it solves one problem for the whole cloud, not one for "
    "each cell."
)
LEARNED_NOTE = (
    "apes, apes-global and potamias have weights of our own, trained on procedural shapes. They are not the authors', "
    "and the paper's figures of Potamias et al. are of a network and a set-up that are not known. apes-global runs "
    "only where its N x N attention fits into memory."
)
SECONDS_NOTE = (
    "CPU seconds are of one run, of all threads together, after its kernels were compiled. For times, see speed.md."
)
FIGURES = gppcs.Report.definitions() | {f"estimated_{name}": each for name, each in Rebuilt.definitions().items()}

Methods = Mapping[str, gppcs.Method]  # by the name in the table


class Column(NamedTuple):
    """A figure of the report, or "seconds", and how the table shows it. Lengths are in diagonals."""

    title: str
    figure: str
    factor: float = 1.0
    digits: int = 1


REBUILT = (
    Column("H mean, 1e-4 diagonals", "estimated_hausdorff_mean", 1e4),  # as in the paper
    Column("H max, 1e-3 diagonals", "estimated_hausdorff_max", 1e3),
)
COVER = (
    Column("covering radius, 1e-3 diagonals", "covering_radius", 1e3),
    Column("mean distance to the local surface, 1e-4 diagonals", "surface_mean", 1e4),
    Column("feature error, 1e-5 diagonals", "feature_error", 1e5),
    Column("feature recall, %", "feature_recall", 100),
)
VARIATION = Column("mean surface variation", "mean_surface_variation", digits=4)
SECONDS = Column("CPU seconds", "seconds", digits=2)


@dataclass(frozen=True)
class Condition:
    """A cloud and the share of points to keep. If there is a mesh, it judges the rebuilt surface."""

    name: str
    cloud: gppcs.PointCloud
    ratio: float
    mesh: gppcs.Mesh | None = None

    @cached_property
    def diagonal(self) -> float:
        """The diagonal of the mesh, since noise widens a cloud; without a mesh, that of the cloud."""
        points = self.mesh.vertices if self.mesh else self.cloud.points
        return float(np.linalg.norm(np.ptp(points, axis=0)))


def paper_settings(n: int) -> dict[str, gppcs.Method]:
    """Return methods with the settings of the paper, where these are not our defaults, for a cloud of n points."""
    settings: dict[str, gppcs.Method] = {
        "wlop, moved": gppcs.WLOP(snap=False),
        "potamias, moved": method_of("potamias", settings={"snap": False}),
    }
    if n > CANDIDATES:
        settings[f"gp-spectral, {CANDIDATES:,} candidates"] = gppcs.SpectralGP(candidates=CANDIDATES)
        settings[f"fps-variation, {CANDIDATES:,} candidates"] = gppcs.FarthestPointVariation(candidates=CANDIDATES)
    return settings


def released_weight(cloud: gppcs.PointCloud) -> dict[str, gppcs.Method]:
    """Return PC-Simp with the weight of evenness of its authors' program, for coordinates in the file's unit.

    The strengths of that program are squared lengths. Ours are divided by the squared spacing, so the weight is, too.
    If the spacing is a small number, the weight is large and 1000 iterations are too few.
    """
    method = gppcs.PCSimp(iterations=10_000)
    distinct = cloud.points[first_occurrences(cloud.points)]
    squared_spacing = NeighbourGraph.build(KdTree.build(distinct), method.neighbours).squared_spacing
    return {"pc-simp, released weight": dataclasses.replace(method, uniformity=RELEASED_WEIGHT / squared_spacing)}


def asked(settings: Methods) -> dict[str, gppcs.Method]:
    """Return the methods of the command line, or all. After each come those of `settings` with the same name."""
    methods = {}
    for name in sys.argv[1:] or gppcs.METHODS:
        methods[name] = method_of(name)
        methods |= {label: method for label, method in settings.items() if method.name == name}
    return methods


def runs(conditions: Sequence[Condition], methods: Methods) -> dict[str, list[Entry]]:
    """Return the entries of each method whose memory suffices, one for each condition."""
    largest = max(conditions, key=lambda condition: len(condition.cloud))
    fitting = those_that_fit(methods.values(), len(largest.cloud), Options(ratio=largest.ratio))
    methods = {label: method for label, method in methods.items() if method in fitting}
    entries = []
    for condition in conditions:
        print(f"{condition.name}: {len(methods)} methods", file=sys.stderr)
        entries.append([entry(condition, method) for method in methods.values()])
    return {label: [of_all[i] for of_all in entries] for i, label in enumerate(methods)}


def entry(condition: Condition, method: gppcs.Method) -> Entry:
    """Return the result of a method with its CPU seconds; a run on a part of the cloud compiles the kernels before."""
    points = condition.cloud.points
    gppcs.simplify(points[:: max(1, len(points) // PREPARATION_POINTS)], ratio=0.1, method=method)
    start = process_time()
    result = gppcs.simplify(condition.cloud, ratio=condition.ratio, method=method)
    seconds = process_time() - start
    figures, failure, _ = judged(condition.cloud, result.cloud, condition.mesh, timer_of(None))
    return Entry(result, figures, seconds, str(failure) if failure else None)


def section(
    heading: str, conditions: Sequence[Condition], made: Mapping[str, list[Entry]], columns: Sequence[Column]
) -> report.Section:
    """Return a table with a row for each method, and each column once for each condition."""
    suffixes = [f"; {condition.name}" for condition in conditions] if len(conditions) > 1 else [""]
    header = ["method", *(column.title + suffix for column in columns for suffix in suffixes)]
    rows = [
        [label, *(shown(entry, column, condition.diagonal) for column in columns
                  for entry, condition in zip(entries, conditions, strict=True))]
        for label, entries in made.items()
    ]  # fmt: skip
    return report.Section(heading, header, rows)


def shown(entry: Entry, column: Column, diagonal: float) -> str:
    """Return the cell of a figure; empty if no surface could be rebuilt."""
    value = {**entry.report.figures(), "seconds": entry.seconds}.get(column.figure)
    if value is None:
        return ""
    power = FIGURES[column.figure].power if column.figure in FIGURES else 0
    return f"{column.factor * (value / diagonal**power if power else value):.{column.digits}f}"


def keep(
    name: str,
    title: str,
    sections: Sequence[report.Section],
    files: Sequence[str],
    notes: Sequence[str],
    introduction: str = "",
) -> None:
    """Print the tables, and write them to results/NAME.md if they are of all methods."""
    paths, notes = [path_of(file) for file in dict.fromkeys(files)], [*notes, SECONDS_NOTE]
    if sys.argv[1:]:
        print(report.text(title, sections, paths, notes, introduction))
    else:
        report.write_sections(name, title, sections, paths, notes, introduction)
