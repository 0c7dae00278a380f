"""Thin a point cloud to exactly the number of points asked for, and keep its features.

>>> import gppcs
>>> cloud = gppcs.sample("bracket", n_points=20_000)
>>> result = gppcs.simplify(cloud, ratio=0.05)
>>> len(result.indices)
1000

What takes long to import is imported when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from gppcs.engine import kernel_cache as _kernel_cache

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.depth_camera import from_depth
    from gppcs.clouds.mesh import Mesh
    from gppcs.clouds.summary import Summary, info
    from gppcs.errors import (
        FileFormatError,
        GppcsError,
        InputError,
        MissingExtraError,
        NoSurfaceError,
        OutputError,
        ParameterError,
    )
    from gppcs.evaluation.comparison import Entry, compare
    from gppcs.evaluation.judge import evaluate
    from gppcs.evaluation.report import Figure, Rebuilt, Report, figures_of
    from gppcs.io import read, write
    from gppcs.io.mesh_files import read_mesh
    from gppcs.methods import (
        AIVS,
        METHODS,
        QEM,
        WLOP,
        FarthestPoint,
        FarthestPointVariation,
        HierarchicalClustering,
        LocalGP,
        Method,
        PCSimp,
        Random,
        SampleElimination,
        Selection,
        SpectralGP,
        TopVariation,
        Voxel,
    )
    from gppcs.scans import sample
    from gppcs.simplification import Result, simplify
    from gppcs.surface.normals import estimate_normals
    from gppcs.surface.surface_variation import Features, estimate_features

__version__ = "0.1.0"

_kernel_cache.provide_folder()

_HOMES = {
    "clouds.cloud": ("PointCloud",),
    "evaluation.comparison": ("Entry", "compare"),
    "clouds.depth_camera": ("from_depth",),
    "errors": (
        "FileFormatError",
        "GppcsError",
        "InputError",
        "MissingExtraError",
        "NoSurfaceError",
        "OutputError",
        "ParameterError",
    ),
    "evaluation.judge": ("evaluate",),
    "evaluation.report": ("Figure", "Rebuilt", "Report", "figures_of"),
    "surface.surface_variation": ("Features", "estimate_features"),
    "io": ("read", "write"),
    "clouds.mesh": ("Mesh",),
    "io.mesh_files": ("read_mesh",),
    "methods": (
        "AIVS",
        "METHODS",
        "QEM",
        "WLOP",
        "FarthestPoint",
        "FarthestPointVariation",
        "HierarchicalClustering",
        "LocalGP",
        "Method",
        "PCSimp",
        "Random",
        "SampleElimination",
        "Selection",
        "SpectralGP",
        "TopVariation",
        "Voxel",
    ),
    "surface.normals": ("estimate_normals",),
    "scans": ("sample",),
    "simplification": ("Result", "simplify"),
    "clouds.summary": ("Summary", "info"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["__version__", *_HOME_OF]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'gppcs' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"gppcs.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME_OF})
