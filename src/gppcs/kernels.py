"""Where the compiled kernels are kept, and how to compile all of them at once.

Numba keeps what it compiled in the folder that NUMBA_CACHE_DIR names, else beside the package's files, else in the
user's cache folder: the first of these that it can write to.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gppcs.cloud import PointCloud

_passing: Any = None  # the folder that is removed at exit, where there had to be one


def provide_folder() -> None:
    """Give Numba a folder that is removed at exit where it could write to none, since it would refuse to compile."""
    global _passing
    beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "__pycache__")
    if _can_write(beside) or any(map(_can_write, _named_folders())):
        return
    import atexit
    import tempfile

    _passing = tempfile.TemporaryDirectory(prefix="gppcs-", ignore_cleanup_errors=True)
    atexit.register(_passing.cleanup)
    os.environ["NUMBA_CACHE_DIR"] = _passing.name
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = _passing.name


def are_kept() -> bool:
    """Tell whether what is compiled outlives this process."""
    return _passing is None


def _named_folders() -> Iterator[str]:
    """Give the folders that Numba would use instead of the one beside the package's files."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        yield named
    yield os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "numba")


def _can_write(folder: str) -> bool:
    """Tell whether files can be made in a folder, which itself may have to be made first."""
    folder = os.path.abspath(folder)
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def compile_all(advanced: Callable[[int], None]) -> tuple[int, list[str]]:
    """Compile every kernel for the arrays that the package gives it, by work on a small scan.

    Parameters
    ----------
    advanced : callable
        Told of the number of methods, of `gppcs.METHODS`, whose kernels were compiled since the last call.

    Returns
    -------
    compiled : int
        How many there were to compile; a kernel that takes several types of arrays counts once for each.
    folders : list of str
        Where all are kept.
    """
    from gppcs.cloud import PointCloud
    from gppcs.evaluation.judge import evaluate
    from gppcs.hierarchical_clustering import hierarchical_clusters
    from gppcs.methods import METHODS
    from gppcs.normals import estimate_normals
    from gppcs.simplification import simplify
    from gppcs.summary import info

    before = sum(map(_compilations, _loaded()))
    for method in METHODS:
        original, kept = compile_method(method)
        advanced(1)
    evaluate(original, kept)
    estimate_normals(original, kept)
    hierarchical_clusters(original.points, size=10, variation=0.1)
    original.points.flags.writeable = False  # as those are that `numpy.load` maps: another type to Numba
    info(PointCloud(original.points))
    simplify(original.points, ratio=0.5, method="random")
    folders = {kernel.stats.cache_path for kernel in _loaded()}
    return sum(map(_compilations, _loaded())) - before, sorted(folders)


def compile_method(name: str) -> tuple[PointCloud, PointCloud]:
    """Compile the kernels of a method; return the scan that it had to simplify, and what it made of it."""
    from gppcs.comparison import PREPARATION
    from gppcs.scans import sample
    from gppcs.simplification import simplify

    scan = sample("medallion", PREPARATION, noise=0.002)  # noise has kernels of its own
    return scan, simplify(scan, ratio=0.1, method=name).cloud


def _loaded() -> list[Any]:
    """Return the kernels of all modules of the package that are loaded."""
    from numba.core.dispatcher import Dispatcher

    modules = [module for name, module in sys.modules.items() if name.startswith(f"{__package__}.")]
    values = [value for module in modules for value in vars(module).values()]
    return list({id(value): value for value in values if isinstance(value, Dispatcher)}.values())


def _compilations(kernel: Any) -> int:
    return sum(kernel.stats.cache_misses.values())
