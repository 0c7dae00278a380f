"""Compiles all kernels at once, by running every method on a small scan."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud


def compile_all(advanced: Callable[[int], None]) -> tuple[int, list[str]]:
    """Compile every kernel for all types of arrays that the package passes to it."""
    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.summary import info
    from gppcs.evaluation.judge import evaluate
    from gppcs.meshing.pipeline import mesh
    from gppcs.methods import METHODS
    from gppcs.methods.hc.clustering import hierarchical_clusters
    from gppcs.simplification import simplify
    from gppcs.surface.normals import estimate_normals

    before = sum(map(_compilations, _loaded()))
    for method in METHODS:
        original, kept = compile_method(method)
        advanced(1)
    evaluate(original, kept)
    estimate_normals(original, kept)
    mesh(original, n_points=100, moved=True)
    hierarchical_clusters(original.points, size=10, variation=0.1)
    original.points.flags.writeable = False  # like memory-mapped arrays; another type for Numba
    info(PointCloud(original.points))
    simplify(original.points, ratio=0.5, method="random")
    folders = {path for kernel in _loaded() if (path := kernel.stats.cache_path)}
    return sum(map(_compilations, _loaded())) - before, sorted(folders)


def compile_method(name: str) -> tuple[PointCloud, PointCloud]:
    """Compile the kernels of one method."""
    from gppcs.evaluation.comparison import PREPARATION_POINTS
    from gppcs.scans import sample
    from gppcs.simplification import simplify

    scan = sample("medallion", PREPARATION_POINTS, noise=0.002)  # noise needs additional kernels
    return scan, simplify(scan, ratio=0.1, method=name).cloud


def _loaded() -> list[Any]:
    """Return the kernels in all loaded modules of the package."""
    from numba.core.dispatcher import Dispatcher

    modules = [module for name, module in sys.modules.items() if name.startswith("gppcs.")]
    values = [value for module in modules for value in vars(module).values()]
    return list({id(value): value for value in values if isinstance(value, Dispatcher)}.values())


def _compilations(kernel: Any) -> int:
    return sum(kernel.stats.cache_misses.values())
