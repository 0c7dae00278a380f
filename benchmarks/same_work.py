"""Time parts and methods of gppcs beside other packages that do the same work, on the Dragon.

The table says which packages are not installed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import packages_distributions, version
from time import perf_counter

import numpy as np

import gppcs
import report
from clouds import DRAGON, Array
from gppcs.engine.threads import number_of_threads
from gppcs.methods.hc.clustering import hierarchical_clusters
from gppcs.methods.voxel.grid import representatives
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import paper_radius
from gppcs.surface.surface_variation import features_in_radius, features_of_nearest

RATIO = 0.03
NEIGHBOURS = 25
REPEATS = 5
MODULES = ("CGAL", "fpsample", "jakteristics", "open3d", "pgeof", "scipy")
LONG = 6.0  # no more repeats after so many seconds

Work = Callable[[], object]


@dataclass(frozen=True)
class Rival:
    """Another package: `prepare` imports it and returns the work to be timed."""

    name: str
    prepare: Callable[[Array], Work]
    parallel: bool  # whether it uses several threads


def jakteristics(points: Array) -> Work:
    """Compute surface variation and normals within a radius."""
    from jakteristics import compute_features

    return lambda: compute_features(
        points,
        search_radius=paper_radius(points),
        num_threads=number_of_threads(),
        feature_names=["surface_variation", "nx", "ny", "nz"],
    )


def pgeof(points: Array) -> Work:
    """Compute all features of pgeof from the nearest points, in single precision."""
    import pgeof

    single = points.astype(np.float32)
    ends = np.arange(len(points) + 1, dtype=np.uint32) * np.uint32(NEIGHBOURS)
    return lambda: pgeof.compute_features(single, pgeof.knn_search(single, single, NEIGHBOURS)[0].ravel(), ends)


def scipy_tree(points: Array) -> Work:
    """Build a k-d tree."""
    from scipy.spatial import cKDTree

    return lambda: cKDTree(points)


def scipy_query(points: Array) -> Work:
    """Find the nearest points of each."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    return lambda: tree.query(points, NEIGHBOURS, workers=number_of_threads())


def cgal_clusters(points: Array) -> Work:
    """Cluster hierarchically."""
    import by_cgal
    from rivals import SIZE, VARIATION

    given = by_cgal.point_set(points)
    return lambda: by_cgal.hierarchy_simplify_point_set(given, SIZE, VARIATION)


def cgal_wlop(points: Array) -> Work:
    """Project by WLOP with the default radius, which is the same as ours."""
    import by_cgal

    given, moved, radius = by_cgal.point_set(points), by_cgal.Point_set_3(), by_cgal.radius_of_wlop(points)
    return lambda: by_cgal.wlop_simplify_and_regularize_point_set(given, moved, 100 * RATIO, radius, 35, False)


def fpsample(points: Array) -> Work:
    """Choose farthest points with the buckets of a k-d tree, of the height that is fastest here."""
    from fpsample import bucket_fps_kdline_sampling

    return lambda: bucket_fps_kdline_sampling(points, kept(points), h=9, start_idx=0)


def open3d_cloud(points: Array) -> object:
    """Return the points as a point cloud of Open3D."""
    import open3d

    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))


def open3d_voxels(points: Array) -> Work:
    """Take the mean of each cell."""
    cloud = open3d_cloud(points)
    return lambda: cloud.voxel_down_sample(paper_radius(points))


def open3d_farthest(points: Array) -> Work:
    """Choose farthest points."""
    cloud = open3d_cloud(points)
    return lambda: cloud.farthest_point_down_sample(kept(points))


def kept(points: Array) -> int:
    """Return the number of points to keep."""
    return round(RATIO * len(points))


def simplified(method: str, points: Array) -> object:
    """Simplify by one of our methods."""
    return gppcs.simplify(points, n_points=kept(points), method=method)


def pairs(points: Array) -> Iterator[tuple[str, Work, Rival]]:
    """Yield the name of each work, our code for it, and the rival."""
    tree = KdTree.build(points)
    cgal_hc = Rival("CGAL hierarchy_simplify_point_set", cgal_clusters, parallel=False)
    cgal = Rival("CGAL wlop_simplify_and_regularize_point_set", cgal_wlop, parallel=True)
    farthest = partial(farthest_points, points, kept(points))
    yield (
        "surface variation and normals in a radius, tree included",
        lambda: features_in_radius(KdTree.build(points), paper_radius(points)),
        Rival("jakteristics", jakteristics, parallel=True),
    )
    yield (
        f"surface variation and normals of {NEIGHBOURS} nearest points, tree included",
        lambda: features_of_nearest(KdTree.build(points), NEIGHBOURS),
        Rival("pgeof knn_search, compute_features", pgeof, parallel=True),
    )
    yield "k-d tree", lambda: KdTree.build(points), Rival("SciPy cKDTree", scipy_tree, parallel=False)
    yield (
        f"{NEIGHBOURS} nearest points of each",
        lambda: tree.nearest_of(points, NEIGHBOURS),
        Rival("SciPy cKDTree.query", scipy_query, parallel=True),
    )
    yield "hc, clusters by the same limits", lambda: hierarchical_clusters(points, 1000, 0.01), cgal_hc
    yield "hc, the number exact", partial(simplified, "hc", points), cgal_hc
    yield "wlop, snapped", partial(simplified, "wlop", points), cgal
    yield "gp", partial(simplified, "gp", points), cgal_hc
    yield "gp", partial(simplified, "gp", points), cgal
    yield (
        "farthest points, tree included",
        farthest,
        Rival("fpsample bucket_fps_kdline_sampling", fpsample, parallel=False),
    )
    yield (
        "farthest points, tree included",
        farthest,
        Rival("Open3D farthest_point_down_sample", open3d_farthest, parallel=False),
    )
    yield (
        "one point for each cell, and the means",
        lambda: representatives(points - points.min(axis=0), paper_radius(points)),
        Rival("Open3D voxel_down_sample", open3d_voxels, parallel=False),
    )


def least_times(ours: Work, rival: Rival, points: Array) -> tuple[float, float]:
    """Return the least seconds of both sides, which take turns; NaN for a rival that is not installed."""
    least, begin = [np.inf, np.inf], perf_counter()
    ours()  # loads the kernels
    for _ in range(REPEATS):
        for side, prepare in enumerate((lambda: ours, partial(rival.prepare, points))):
            try:
                work = prepare()
            except (ImportError, OSError):  # OSError: a library of the system is missing
                least[side] = np.nan
                continue
            start = perf_counter()
            work()
            least[side] = min(least[side], perf_counter() - start)
        if perf_counter() - begin > LONG:
            break
    return least[0], least[1]


def versions() -> str:
    """Return the versions of the packages that are installed."""
    installed = packages_distributions()
    names = sorted(name for module in MODULES for name in installed.get(module, ()))
    return ", ".join(f"{name} {version(name)}" for name in names)


def compared() -> report.Section:
    """Return the table of all pairs, each with the number of threads that the rival can use."""
    points = gppcs.read(DRAGON).points
    most = number_of_threads()
    rows = []
    for work, ours, rival in pairs(points):
        print(f"{work} beside {rival.name}", file=sys.stderr)
        threads = most if rival.parallel else 1
        gppcs.set_threads(threads)
        mine, theirs = least_times(ours, rival, points)
        known = np.isfinite(theirs)
        cells = (f"{theirs:.3f}", f"{theirs / mine:.2f}") if known else ("not installed", "")
        rows.append((work, f"{mine:.3f}", rival.name, cells[0], str(threads), cells[1]))
    gppcs.set_threads(most)
    header = ("work", "our seconds", "rival", "its seconds", "threads of each", "times as fast")
    return report.Section(f"Beside others, Dragon, {len(points):,} points to {kept(points):,}", header, rows)
