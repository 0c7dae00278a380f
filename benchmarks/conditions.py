"""What the benchmarks of the method `gp` share: the clouds, how a run is made and judged, and runs kept in a file.

A script does all conditions, or those named on its command line; only all together are kept in `results/`.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import gppcs
import report
from gppcs.clouds.cloud import NORMALS
from gppcs.engine.stages import Stages
from gppcs.evaluation.judge import judged

SQUARES = 20  # along the edge of the gridded cube

Array = NDArray[np.float64]
Figures = Mapping[str, float]  # by name; lengths in diagonals of the mesh


class Column(NamedTuple):
    """A figure, or "seconds", and how tables show it."""

    title: str
    figure: str
    factor: float = 1.0
    digits: int = 2

    def cell(self, values: Sequence[float]) -> str:
        """Return the mean, with the standard deviation where there are several values; nothing for none."""
        if not values:
            return ""
        scaled = self.factor * np.array(values)
        spread = f" ± {scaled.std(ddof=1):.{self.digits}f}" if len(values) > 1 else ""
        return f"{scaled.mean():.{self.digits}f}{spread}"


H_MEAN = Column("H mean, 1e-4 diagonals", "hausdorff_mean", 1e4)
H_MAX = Column("H max, 1e-3 diagonals", "hausdorff_max", 1e3)
VARIATION = Column("mean surface variation", "mean_surface_variation", digits=4)
COVER = Column("covering radius, 1e-3 diagonals", "covering_radius", 1e3)
SURFACE = Column("mean distance to the local surface, 1e-4 diagonals", "surface_mean", 1e4)
FEATURES = Column("feature error, 1e-5 diagonals", "feature_error", 1e5)
SECONDS = Column("seconds", "seconds")
COLUMNS = (H_MEAN, H_MAX, VARIATION, COVER, SURFACE, FEATURES, SECONDS)
REBUILT = (H_MEAN.figure, H_MAX.figure)  # with normals of their own where the points carry them
KNOWN = {**gppcs.figures_of(gppcs.Report), **gppcs.figures_of(gppcs.Rebuilt)}


@dataclass(frozen=True)
class Condition:
    """A cloud, the mesh that it is judged by, and to what share or number of points it is simplified.

    Without a mesh it is the gridded cube in the box of the cloud.
    """

    file: str
    mesh_file: str | None
    amount: float

    @property
    def name(self) -> str:
        """What the tables and the command line call it."""
        return f"{self.file}:{self.amount:g}"

    @property
    def files(self) -> list[Path]:
        """What is read."""
        return [report.DATA / f"{name}.ply" for name in (self.file, self.mesh_file) if name]

    @cached_property
    def cloud(self) -> gppcs.PointCloud:
        """The original."""
        return gppcs.read(self.files[0])

    @cached_property
    def mesh(self) -> gppcs.Mesh:
        """The surface that it was taken from."""
        return gppcs.read_mesh(self.files[1]) if self.mesh_file else gridded_cube(self.cloud.points)

    @property
    def n_points(self) -> int:
        """How many points are to be kept."""
        return round(self.amount * len(self.cloud)) if self.amount < 1 else int(self.amount)


def gridded_cube(points: Array) -> gppcs.Mesh:
    """Return the box of some points as a mesh of SQUARES x SQUARES squares, cut into triangles, on each face."""
    corners = []
    first, second = (axis.ravel() for axis in np.mgrid[:SQUARES, :SQUARES])
    for axis in range(3):
        for side in (0, SQUARES):
            square = np.zeros((4, SQUARES**2, 3), dtype=np.int64)
            square[:, :, axis] = side
            for corner, (i, j) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                square[corner, :, (axis + 1) % 3], square[corner, :, (axis + 2) % 3] = first + i, second + j
            ways = ((0, 1, 2), (0, 2, 3)) if side else ((0, 2, 1), (0, 3, 2))  # counter-clockwise from outside
            corners += [square[list(way)].transpose(1, 0, 2).reshape(-1, 3) for way in ways]
    vertices, faces = np.unique(np.concatenate(corners), axis=0, return_inverse=True)
    return gppcs.Mesh(points.min(axis=0) + np.ptp(points, axis=0) * vertices / SQUARES, faces.reshape(-1, 3))


def simplified(
    condition: Condition, method: gppcs.Method, start: int = 0, n_points: int | None = None, normals: bool = False
) -> tuple[gppcs.PointCloud, float]:
    """Return what a method that moves no points keeps of the cloud turned at random, as it is for the start 0.

    The points kept are those of the cloud as it is, and so are the normals that they carry, if they are to. Beside
    them, the wall time in seconds.
    """
    turn = Rotation.random(random_state=start).as_matrix() if start else np.eye(3)
    turned = condition.cloud.points @ turn.T
    result, seconds = timed(turned, method, n_points or condition.n_points, normals)
    kept = condition.cloud.take(result.indices)
    if normals:
        carried = dict(zip(NORMALS, (result.cloud.normals() @ turn).T, strict=True))
        kept = dataclasses.replace(kept, attributes={**kept.attributes, **carried})
    return kept, seconds


def timed(
    cloud: gppcs.PointCloud | Array, method: gppcs.Method, n_points: int, normals: bool = False
) -> tuple[gppcs.Result, float]:
    """Return the simplified cloud and the wall time in seconds, without the compilation of kernels."""
    _prepare(method)
    start = perf_counter()
    result = gppcs.simplify(cloud, n_points=n_points, method=method, normals=normals)
    return result, perf_counter() - start


@cache
def _prepare(method: gppcs.Method) -> None:
    """Compile or load the kernels of a method, and those of carried normals."""
    gppcs.simplify(gppcs.sample("bracket", n_points=6_000), ratio=0.1, method=method, normals=True)


def figures(condition: Condition, kept: gppcs.PointCloud) -> dict[str, float]:
    """Return the judge's figures; those of the rebuilt mesh with the normals that the points carry, where they do."""
    found, failure = judged(condition.cloud, kept, condition.mesh, Stages())
    if failure:
        print(f"{condition.name}: {failure}", file=sys.stderr)
    diagonal = float(np.linalg.norm(np.ptp(condition.mesh.vertices, axis=0)))  # noise widens that of the cloud
    values, wanted = found.figures(), {}
    for name in (column.figure for column in COLUMNS):
        value = values.get(f"carried_{name}" if kept.normals() is not None and name in REBUILT else name)
        if value is not None:
            scaled = KNOWN[name].relative(value, diagonal)
            wanted[name] = value if scaled is None else scaled
    return wanted


class Runs:
    """Figures of runs, kept in a file of JSON lines, so that a call cut short can be taken up again.

    Runs of other sources or of another number of threads are not taken for runs of these.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.known: dict[tuple[str, ...], dict[str, float]] = {}
        source = hashlib.sha256()
        for file in sorted(Path(gppcs.__file__).parent.rglob("*.py")):
            source.update(file.read_bytes())
        self.by = f"{source.hexdigest()[:16]}, {numba.get_num_threads()} threads"
        for line in path.read_text().splitlines() if path and path.exists() else ():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:  # cut short
                continue
            if record["by"] == self.by:
                self.known[tuple(record["run"])] = record["figures"]

    def of(
        self, condition: Condition, label: str, start: int, work: Callable[[], tuple[gppcs.PointCloud, float]]
    ) -> Figures:
        """Return the figures of a run, from the file where it has been made; none where it fails."""
        run = (condition.name, label, str(start))
        if run not in self.known:
            print(", ".join(run), file=sys.stderr)
            try:
                kept, seconds = work()
                self.known[run] = {**figures(condition, kept), "seconds": seconds}
            except Exception as error:  # a blank cell, so that the other runs are not lost; made again by the next call
                print(f"{', '.join(run)}: {type(error).__name__}: {error}", file=sys.stderr)
                return {}
            if self.path:
                with open(self.path, "a") as file:
                    file.write("\n" + json.dumps({"by": self.by, "run": run, "figures": self.known[run]}))
        return self.known[run]


def asked(conditions: Sequence[Condition], purpose: str | None) -> tuple[list[Condition], Runs]:
    """Return the conditions of the command line, or all, and the runs that are known."""
    parser = argparse.ArgumentParser(description=purpose, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [word for condition in conditions for word in (condition.file, condition.name)]
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(dict.fromkeys(names))}; all if none")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="JSON lines of the runs made, to take up again")
    given = parser.parse_args()
    for word in set(given.names) - set(names):
        parser.error(f"there is no condition {word!r}")
    chosen = [each for each in conditions if not given.names or {each.file, each.name} & set(given.names)]
    return chosen, Runs(given.keep)


def keep(
    name: str,
    title: str,
    sections: Sequence[report.Section],
    conditions: Sequence[Condition],
    notes: Sequence[str],
    whole: bool,
) -> None:
    """Print the tables, and keep them in results/NAME.md if they are of all conditions."""
    data = list(dict.fromkeys(path for condition in conditions for path in condition.files))
    if whole:
        report.write_sections(name, title, sections, data, notes)
    else:
        print(report.text(title, sections, data, notes))
