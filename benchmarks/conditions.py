"""What the benchmarks of the method `gp` share: clouds, runs, figures, and runs kept in a file.

A script measures all its conditions, or those named on its command line. It writes to `results/` only if it measured
all of them.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import inspect
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, TypeVar
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import gppcs
import report
from gppcs.clouds.cloud import NORMALS
from gppcs.engine.threads import number_of_threads
from gppcs.errors import NoSurfaceError
from gppcs.evaluation import reconstruction
from gppcs.evaluation.reconstruction import distances_to, estimated_normals, exact_normals, reconstruct
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.local_surface import LocalSurface
from scans import SCENES, sample

SQUARES = 20  # along the edge of the gridded cube
REFERENCE = 60_000  # points of a scan, at most, to which the rebuilt surface is compared
SURFACE_SAMPLE = 50_000  # points without noise that stand for the surface of a sample scan
OTHER_SEED = 7  # of these points; the sample scan itself has seed 0
SCENE = 100_000  # points of a sample scene, and about those of a thinned scene

Array = NDArray[np.float64]
Figures = Mapping[str, float]  # by name; lengths in diagonals
Work = Callable[[], tuple[gppcs.PointCloud, float]]  # returns the points kept and the seconds
Made = TypeVar("Made")


class Column(NamedTuple):
    """A figure, or "seconds", and how tables show it."""

    title: str
    figure: str
    factor: float = 1.0
    digits: int = 2

    def cell(self, values: Sequence[float]) -> str:
        """Return the mean, and the standard deviation if there are several values; nothing for none."""
        if not values:
            return ""
        scaled = self.factor * np.array(values)
        spread = f" ± {scaled.std(ddof=1):.{self.digits}f}" if len(values) > 1 else ""
        return f"{scaled.mean():.{self.digits}f}{spread}"


H_MEAN = Column("H mean, 1e-4 diagonals", "hausdorff_mean", 1e4)
H_MAX = Column("H max, 1e-3 diagonals", "hausdorff_max", 1e3)
ESTIMATED_H_MEAN = Column("H mean with estimated normals, 1e-4 diagonals", "estimated_hausdorff_mean", 1e4)
ESTIMATED_H_MAX = Column("H max with estimated normals, 1e-3 diagonals", "estimated_hausdorff_max", 1e3)
VARIATION = Column("mean surface variation", "mean_surface_variation", digits=4)
COVER = Column("covering radius, 1e-3 diagonals", "covering_radius", 1e3)
SURFACE = Column("mean distance to the local surface, 1e-4 diagonals", "surface_mean", 1e4)
EXACT = Column("mean distance from the true surface to the local surface, 1e-4 diagonals", "exact_mean", 1e4)
SURFACE_P95 = Column("95th percentile of these distances, 1e-4 diagonals", "surface_p95", 1e4)
SURFACE_BY_AREA = Column("mean distance to the local surface, by area, 1e-4 diagonals", "surface_mean_by_area", 1e4)
SURFACE_P95_BY_AREA = Column("95th percentile of these distances, by area, 1e-4 diagonals", "surface_p95_by_area", 1e4)
COVER_P999 = Column("99.9th percentile of the distance to a kept point, 1e-3 diagonals", "covering_p999", 1e3)
FEATURES = Column("feature error, 1e-5 diagonals", "feature_error", 1e5)
SECONDS = Column("seconds", "seconds")
COLUMNS = (
    H_MEAN, H_MAX, ESTIMATED_H_MEAN, ESTIMATED_H_MAX, VARIATION, COVER, SURFACE, SURFACE_P95, FEATURES, SECONDS,
)  # fmt: skip
DEPTHS = 8, 10  # of the octree: the paper's, and where that cannot tell the methods apart


class Reference(NamedTuple):
    """Points of the original surface and the normals there, both (V, 3); these give other normals their signs."""

    points: Array
    normals: Array


@dataclass(frozen=True)
class Condition:
    """A cloud, the mesh that judges it, and the share or the number of points to keep.

    Without a mesh file, the mesh is the gridded cube in the bounding box of the cloud.
    """

    file: str
    mesh_file: str | None
    amount: float

    @property
    def name(self) -> str:
        """The name in tables and on the command line."""
        return f"{self.file}:{self.amount:g}"

    @property
    def files(self) -> list[Path]:
        """The files of the cloud and of the mesh."""
        return [report.DATA / f"{name}.ply" for name in (self.file, self.mesh_file) if name]

    @cached_property
    def cloud(self) -> gppcs.PointCloud:
        """The original."""
        return gppcs.read(self.files[0])

    @property
    def original(self) -> gppcs.PointCloud:
        """The points that the kept points are compared with."""
        return self.cloud

    @cached_property
    def mesh(self) -> gppcs.Mesh | None:
        """The surface that the cloud was taken from."""
        return gppcs.read_mesh(self.files[1]) if self.mesh_file else gridded_cube(self.cloud.points)

    @cached_property
    def reference(self) -> Reference | None:
        """What the rebuilt surface is compared to, if there is a surface."""
        return Reference(self.mesh.vertices, self.mesh.vertex_normals()) if self.mesh else None

    @cached_property
    def normals(self) -> Array:
        """The normals of the surface at all points of the cloud, (N, 3)."""
        assert self.mesh
        return exact_normals(self.mesh, self.cloud.points)

    @property
    def exact(self) -> Array | None:
        """Points of the surface without the noise that the cloud has; None where none was added."""
        return self.mesh.vertices if self.mesh and "noise" in self.file else None

    @property
    def diagonal(self) -> float:
        """The unit of length: of the mesh or the reference if there is one, since noise widens the cloud."""
        known = self.reference.points if self.reference else self.original.points
        return float(np.linalg.norm(np.ptp(known, axis=0)))

    @property
    def n_points(self) -> int:
        """The number of points to keep."""
        return round(self.amount * len(self.cloud)) if self.amount < 1 else int(self.amount)


@dataclass(frozen=True)
class Scene(Condition):
    """A scan that spans no closed surface, such as a scene of LiDAR: its points alone judge the kept points."""

    @cached_property
    def mesh(self) -> None:
        """There is none."""

    @cached_property
    def normals(self) -> Array:
        """The normals of the whole cloud, (N, 3)."""
        return gppcs.estimate_normals(self.cloud)


@dataclass(frozen=True)
class Scan(Scene):
    """A scan without a mesh: its own points stand for the surface, with normals of the whole cloud."""

    @cached_property
    def reference(self) -> Reference:
        """Some random points of the scan."""
        indices = np.sort(np.random.default_rng(0).permutation(len(self.cloud))[:REFERENCE])
        return Reference(self.cloud.points[indices], self.normals[indices])


@dataclass(frozen=True)
class ThinnedScene(Scene):
    """A scene of about 100,000 points: every n-th of its file."""

    @cached_property
    def cloud(self) -> gppcs.PointCloud:
        """These points."""
        points = gppcs.read(self.files[0]).points
        return gppcs.PointCloud.from_object(points[:: max(1, round(len(points) / SCENE))])


@dataclass(frozen=True)
class SampleScene(Scene):
    """A sample scene of gppcs, whose surfaces are known."""

    @property
    def files(self) -> list[Path]:
        """None: the cloud is computed."""
        return []

    @property
    def cloud(self) -> gppcs.PointCloud:
        """The sample, without the exact normals that it carries."""
        return measured_scene(self.file)

    @property
    def original(self) -> gppcs.PointCloud:
        """Other points of its surfaces, which the same sensor sees without noise. Leaves have no surface."""
        return exact_scene(self.file)


@cache
def measured_scene(name: str) -> gppcs.PointCloud:
    """Return the points of a sample scene."""
    return gppcs.PointCloud.from_object(sample(name, SCENE).points)


@cache
def exact_scene(name: str) -> gppcs.PointCloud:
    """Return points of the surfaces of a sample scene, seen by its sensor along other rays, without noise."""
    exact = dataclasses.replace(SCENES[name], measured=lambda rays, distances, rng: distances)
    points, normals, *_ = exact.scan(SURFACE_SAMPLE, np.random.default_rng(OTHER_SEED))
    return gppcs.PointCloud(points[normals.any(axis=1)].astype(np.float64))


@dataclass(frozen=True)
class Sample(Condition):
    """A sample scan: its surface is known, so a second sample without noise stands for it.

    Attributes
    ----------
    size : int
        Points of the cloud.
    noise : float
        Standard deviation of the noise in diagonals.
    """

    size: int = 100_000
    noise: float = 0.0

    @property
    def name(self) -> str:
        """The name in tables and on the command line."""
        noise = f"_noise_{self.noise:g}" if self.noise else ""
        return f"{self.file}_{self.size // 1000}k{noise}:{self.amount:g}"

    @property
    def files(self) -> list[Path]:
        """None: the cloud is computed."""
        return []

    @cached_property
    def measured(self) -> gppcs.PointCloud:
        """The sample."""
        return sample(self.file, self.size, noise=self.noise)

    @property
    def cloud(self) -> gppcs.PointCloud:
        """The sample without the exact normals that it carries."""
        return gppcs.PointCloud.from_object(self.measured.points)

    @property
    def normals(self) -> Array:
        """The exact normals of the surface at all points of the cloud, (N, 3)."""
        normals = self.measured.normals()
        assert normals is not None
        return normals

    @property
    def exact(self) -> Array | None:
        """Points of the surface without the noise that the cloud has; None where none was added."""
        return self.reference.points if self.noise else None

    @cached_property
    def mesh(self) -> None:
        """There is none."""

    @cached_property
    def reference(self) -> Reference:
        """Other points of the same surface, with exact normals."""
        exact = sample(self.file, SURFACE_SAMPLE, seed=OTHER_SEED)
        normals = exact.normals()
        assert normals is not None
        return Reference(exact.points, normals)


FOUND_ON = (  # the rules and the constants of gp were chosen by its figures on these
    Condition("dragon", "dragon", 0.03),
    Condition("armadillo_50k", "armadillo_50k", 0.05),
    Condition("nefertiti", "nefertiti", 0.05),
    Condition("bunny", "bunny", 0.05),
    Condition("bunny", "bunny", 0.2),
    Condition("face_rangemap", "face_rangemap", 0.03),
    Condition("armadillo_173k_resampled", "armadillo_50k", 0.05),
    Condition("sfm_angel", "sfm_angel", 0.1),
    Condition("sfm_bird_bath", "sfm_bird_bath", 0.1),
    Condition("armadillo_100k_noise_2.5e-3", "armadillo_50k", 0.05),
    Condition("armadillo_100k_noise_5e-3", "armadillo_50k", 0.05),
    Condition("fandisk_60k_sampled", "fandisk", 1_200),
    Condition("cube_30k_sampled", None, 600),
)
LIDAR = (
    Scene("kitti_000000", None, 0.03),
    Scene("autzen_airborne", None, 0.03),
    Scene("lidr_topography_airborne", None, 0.03),
)
SOLIDS = (  # with the noise of scanners by structured light: 0.03 mm
    Sample("horse", None, 3_000, 40_000, 0.0002),
    Sample("moth", None, 3_000, 40_000, 0.0002),
    Sample("case", None, 3_000, 40_000, 0.0002),
    Sample("plate", None, 1_500, 40_000, 0.0002),
    Sample("gears", None, 3_000, 40_000, 0.0002),
    Sample("plant", None, 3_000, 40_000, 0.0002),
)
HELD_OUT = (  # these took no part in that
    Condition("turbine", "turbine", 0.1),
    Condition("blade", "blade", 0.1),
    Condition("anchor_dense", "anchor_dense", 0.1),
    Scan("lion_takanawa", None, 0.03),
    Scan("redwood_fragment", None, 0.05),
    Scan("tum_desk", None, 0.03),
    Sample("bracket", None, 800, 40_000),
    Sample("bracket", None, 4_000, 100_000),
    Sample("medallion", None, 3_000, 60_000),
    Sample("medallion", None, 3_000, 100_000, 0.002),
    Sample("fan", None, 3_000, 40_000),
    *SOLIDS,
    *LIDAR,
)

THIN = (  # in all parts; the last three took no part in any decision
    Sample("horn", None, 2_000, 40_000),
    Sample("handlebar", None, 2_000, 40_000),
    Sample("vents", None, 2_000, 40_000),
    Sample("cable", None, 2_000, 40_000),
    Sample("crate", None, 2_000, 40_000),
    Sample("sink", None, 2_000, 40_000),
    Sample("funnel", None, 2_000, 40_000),
    Sample("organizer", None, 2_000, 40_000),
    Sample("louvre", None, 2_000, 40_000),
)

SMALLER = (  # without clouds that take long or resemble others
    *(each for each in FOUND_ON if not each.file.startswith(("dragon", "armadillo_50k", "armadillo_173k", "sfm_bird"))),
    *(each for each in HELD_OUT if each not in SOLIDS),
)


def not_placed(points: Any, chosen: Any, *others: Any) -> Any:
    """Leave chosen points where they are, in place of `placement.place`."""
    return chosen


def geometric_mean(ratios: Iterable[float]) -> float:
    """Return the geometric mean of the ratios that are known; NaN for none."""
    known = [value for value in ratios if np.isfinite(value)]
    return float(np.exp(np.mean(np.log(known)))) if known else float("nan")


def section(
    condition: Condition, made: Mapping[str, Sequence[Figures]], columns: Sequence[Column] = COLUMNS
) -> report.Section:
    """Return the figures of all methods under a condition."""
    rows = [
        [
            label,
            *(column.cell([found[column.figure] for found in runs if column.figure in found]) for column in columns),
        ]
        for label, runs in made.items()
    ]
    heading = f"{condition.name}, {len(condition.cloud):,} points to {condition.n_points:,}"
    return report.Section(heading, ["method", *(column.title for column in columns)], rows)


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


def turn_of(start: int) -> Array:
    """Return the rotation of the cloud for a run: none for the first one."""
    turn: Array = Rotation.random(random_state=start).as_matrix() if start else np.eye(3)
    return turn


def simplified(
    condition: Condition, method: gppcs.Method, start: int = 0, n_points: int | None = None, normals: bool = False
) -> tuple[gppcs.PointCloud, float]:
    """Simplify the cloud, turned at random unless the start is 0, which is also the seed of methods that have one.

    Returns the points kept, taken from the cloud as it is or turned back, and the wall time in seconds. With `normals`,
    the points carry the normals that were found in the whole cloud, turned back.
    """
    turn = turn_of(start)
    turned = condition.cloud.points @ turn.T
    result, seconds = timed(turned, method, n_points or condition.n_points, normals, seed=start)
    kept = condition.cloud.take(result.indices)
    if method.moves_points:
        kept = kept.moved(result.cloud.points @ turn)
    if normals:
        carried = dict(zip(NORMALS, (result.cloud.normals() @ turn).T, strict=True))
        kept = dataclasses.replace(kept, attributes={**kept.attributes, **carried})
    return kept, seconds


def timed(
    cloud: gppcs.PointCloud | Array, method: gppcs.Method, n_points: int, normals: bool = False, seed: int = 0
) -> tuple[gppcs.Result, float]:
    """Return the simplified cloud and the wall time in seconds, without the compilation of kernels."""
    _prepare(method)
    start = perf_counter()
    method = dataclasses.replace(method, seed=seed) if hasattr(method, "seed") else method
    result = gppcs.simplify(cloud, n_points=n_points, method=method, normals=normals)
    return result, perf_counter() - start


@cache
def _prepare(method: gppcs.Method) -> None:
    """Compile or load the kernels of a method, and those of carried normals."""
    gppcs.simplify(gppcs.sample("bracket", n_points=6_000), ratio=0.1, method=method, normals=True)


def figures(condition: Condition, kept: gppcs.PointCloud) -> dict[str, float]:
    """Return all figures of the points kept, lengths in diagonals.

    H mean and H max are of the surface that is rebuilt with the exact normals of the nearest original points. Where
    they are called estimated, the normals are those that the points carry, or estimated from the points alone.
    """
    values = gppcs.evaluate(condition.original, kept).values_in(condition.diagonal)
    values["exact_mean"] = values["surface_mean"]
    if condition.exact is not None:
        values["exact_mean"] = mean_to_local_surface(condition.exact, kept.points) / condition.diagonal
    if condition.reference:
        nearest = KdTree.build(condition.cloud.points).nearest_of(kept.points, 1)[0][:, 0]
        values |= distances_from(condition, kept.points, condition.normals[nearest])
        estimated = distances_from(condition, kept.points, kept.normals())
        values |= {f"estimated_{name}": value for name, value in estimated.items()}
    return values


def mean_to_local_surface(places: Array, kept: Array) -> float:
    """Return the mean distance of places, (Q, 3), from the local surface of kept points, (M, 3)."""
    return float(LocalSurface.from_points(kept).nearest_to(places)[0].mean())


def distances_from(condition: Condition, kept: Array, normals: Array | None) -> dict[str, float]:
    """Return H mean and H max in diagonals: distances from the reference to the surface rebuilt from points, (M, 3).

    Normals, (M, 3), are estimated from the points if there are none. If no surface can be rebuilt, there are no values.
    """
    reference = condition.reference
    assert reference
    low = reference.points.min(axis=0)
    places, kept = ((points - low) / condition.diagonal for points in (reference.points, kept))
    if normals is None:
        normals = estimated_normals(kept, places, reference.normals)
    try:
        distances = distances_to(reconstruct(kept, normals), places)
    except NoSurfaceError as error:
        print(f"{condition.name}: {error}", file=sys.stderr)
        return {}
    return {"hausdorff_mean": float(distances.mean()), "hausdorff_max": float(distances.max())}


def floor_of(condition: Condition) -> float:
    """Return H mean in diagonals of all points of the surface: those without noise, where it was added."""
    assert condition.reference
    points, normals = condition.reference
    if condition.exact is None:
        points, normals = condition.cloud.points, condition.normals
    return distances_from(condition, points, normals).get("hausdorff_mean", 0.0)


def digest_of(cloud: gppcs.PointCloud) -> str:
    """Return a digest of the points and the normals of a cloud."""
    normals = cloud.normals()
    return hashlib.sha256(cloud.points.tobytes() + (b"" if normals is None else normals.tobytes())).hexdigest()


@cache
def code_of_judge() -> str:
    """Return a digest of the code that judges points."""
    files = sorted(Path(reconstruction.__file__).parent.glob("*.py"))
    text = "".join(path.read_text() for path in files) + "".join(map(inspect.getsource, (figures, distances_from)))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


class Runs:
    """Figures of runs, kept in a file of JSON lines, so that a call that was cut short can go on.

    A run is taken from the file only if the same commit made it with as many threads. Points that are in the file, too,
    are not judged again while the code that judges is the same: judging takes longer than most methods.

    Attributes
    ----------
    path : Path, optional
        The file.
    jobs : int
        The number of processes of `over`.
    """

    def __init__(self, path: Path | None, jobs: int = 1) -> None:
        self.path, self.jobs = path, jobs
        self.known: dict[tuple[str, ...], dict[str, float]] = {}
        self.judged: dict[tuple[str, ...], dict[str, float]] = {}
        for line in path.read_text().splitlines() if path and path.exists() else ():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:  # an empty line, or one that was cut short
                continue
            self.known[(record["by"], *record["run"])] = self.judged[tuple(record["judged"])] = record["figures"]

    def of(self, condition: Condition, label: str, start: int, work: Work) -> Figures:
        """Return the figures of a run, from the file if this commit has made them; none if it fails."""
        run = (condition.name, label, str(start))
        depth = reconstruction.OCTREE_DEPTH
        key = f"commit {report.commit()}, {number_of_threads()} threads, depth {depth}"
        judge = f"judge {code_of_judge()}, depth {depth}"
        if (key, *run) not in self.known:
            print(", ".join(run), file=sys.stderr)
            try:
                kept, seconds = work()
                judged = (judge, condition.name, digest_of(kept))
                found = {**(self.judged.get(judged) or figures(condition, kept)), "seconds": seconds}
                self.known[key, *run] = self.judged[judged] = found
            except Exception as error:  # leaves a blank cell, and other runs go on; the next call tries again
                print(f"{', '.join(run)}: {type(error).__name__}: {error}", file=sys.stderr)
                return {}
            if self.path:
                with open(self.path, "a") as file:
                    file.write("\n" + json.dumps({"by": key, "run": run, "judged": judged, "figures": found}))
        return self.known[key, *run]

    def of_all(self, condition: Condition, works: Mapping[str, Mapping[int, Work]]) -> dict[str, list[Figures]]:
        """Return the figures of all runs by label, with the same depth of the octree.

        It is the larger one where a surface from all points is more than half as far from the original as the best one.
        """
        made: dict[str, list[Figures]] = {}
        for depth in DEPTHS:
            with patch.object(reconstruction, "OCTREE_DEPTH", depth):
                made = {
                    label: [self.of(condition, label, start, work) for start, work in of_label.items()]
                    for label, of_label in works.items()
                }
                means = [
                    np.mean([figures.get(H_MEAN.figure, np.inf) for figures in runs]) for runs in made.values() if runs
                ]
                if not condition.reference or not floor_of(condition) > min(means) / 2.0:
                    break
                print(f"{condition.name}: all points are too far at depth {depth}", file=sys.stderr)
        return made

    def over(self, chosen: Sequence[Condition], work: Callable[[Condition, Runs], Made]) -> list[Made]:
        """Return what some work makes under each condition, by several processes side by side if there are jobs."""
        if self.jobs == 1:
            return [work(condition, self) for condition in chosen]
        with ProcessPoolExecutor(self.jobs, get_context("spawn"), gppcs.set_threads, (1,)) as processes:
            return list(processes.map(_apart, [(work, condition, self.path) for condition in chosen]))


def _apart(task: tuple[Callable[[Condition, Runs], Made], Condition, Path | None]) -> Made:
    work, condition, path = task
    return work(condition, Runs(path))


def asked(conditions: Sequence[Condition], purpose: str | None) -> tuple[list[Condition], Runs]:
    """Return the conditions of the command line, or all, and the known runs."""
    parser = argparse.ArgumentParser(description=purpose, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = list(dict.fromkeys(word for condition in conditions for word in (condition.file, condition.name)))
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(names)}; all if none is given")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="file of runs, to go on after a call cut short")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes side by side; 1 by default")
    given = parser.parse_args()
    for word in set(given.names) - set(names):
        parser.error(f"there is no condition {word!r}")
    gppcs.set_threads(1)  # as many as each of several processes has
    chosen = [each for each in conditions if not given.names or {each.file, each.name} & set(given.names)]
    return chosen, Runs(given.keep, given.jobs)


def keep(
    name: str,
    title: str,
    sections: Sequence[report.Section],
    conditions: Sequence[Condition],
    notes: Sequence[str],
    whole: bool,
    introduction: str = "",
) -> None:
    """Print the tables, and write them to results/NAME.md if they are of all conditions."""
    data = list(dict.fromkeys(path for condition in conditions for path in condition.files))
    if whole:
        report.write_sections(name, title, sections, data, notes, introduction)
    else:
        print(report.text(title, sections, data, notes, introduction))
