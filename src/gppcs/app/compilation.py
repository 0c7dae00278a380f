"""Compiles all kernels at once, by running every method on a small scan."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba.core.dispatcher import Dispatcher

import gppcs
from gppcs import METHODS, PointCloud, mesh, sample, simplify
from gppcs.errors import MissingExtraError
from gppcs.evaluation.comparison import PREPARATION_POINTS
from gppcs.methods.hc.clustering import hierarchical_clusters
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.surface_variation import features_in_radius


def compile_all(on_progress: Callable[[int], None]) -> tuple[int, list[str]]:
    """Compile every kernel for all types of arrays that the package passes to it."""
    before = sum(map(_compilations, _loaded()))
    original = sample("medallion", PREPARATION_POINTS, noise=0.002)  # noise needs additional kernels
    for method in METHODS:
        kept = simplify(original, ratio=0.1, method=method).cloud
        on_progress(1)
    gppcs.evaluate(original, kept)
    gppcs.estimate_normals(original, kept)
    light = mesh(original, n_points=100, effort=1).mesh
    with suppress(MissingExtraError):  # raised after all kernels
        gppcs.evaluate_mesh(original, light)
    mesh(original, tolerance="2%")
    mesh(sample("room", 40_000), n_points=4_000, moved=True)  # which takes most steps of a mesh
    mesh(sample("fan", 10_000, noise=0.002), n_points=1_000, moved=True)  # some triangles of which relax
    mesh(sample("bracket", PREPARATION_POINTS), n_points=500)  # whose drilled holes are tried as small handles
    stray = sample("statue", 30_000, noise=0.001, outliers=0.01)
    mesh(stray, n_faces=2_000, fill_holes="5%")  # which removes triangles that cut others, and fills a hole
    simplify(stray, ratio=0.02, drop_outliers=True, max_gap="2%", normals=True)
    features_in_radius(KdTree.build(stray.points), 100.0)  # balls that hold whole nodes of the tree
    simplify(original, tolerance="2%", keep="curvature > 0", weight=abs(original.attributes["curvature"]))
    simplify(stray, ratio=0.02, denoise=True)
    simplify(original, ratio=0.1, detail="rgb")
    hierarchical_clusters(original.points, size=10, variation=0.1)
    original.points.flags.writeable = False  # like memory-mapped arrays; another type for Numba
    gppcs.info(PointCloud(original.points))
    simplify(original.points, ratio=0.5, method="random")
    folders = {path for kernel in _loaded() if (path := kernel.stats.cache_path)}
    return sum(map(_compilations, _loaded())) - before, sorted(folders)


def _loaded() -> list[Any]:
    """Return the kernels in all loaded modules of the package."""
    modules = [module for name, module in sys.modules.items() if name.startswith("gppcs.")]
    values = [value for module in modules for value in vars(module).values()]
    return list({id(value): value for value in values if isinstance(value, Dispatcher)}.values())


def _compilations(kernel: Any) -> int:
    return sum(kernel.stats.cache_misses.values())
