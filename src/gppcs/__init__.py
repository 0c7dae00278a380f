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

from gppcs import kernels as _kernels

if TYPE_CHECKING:
    from gppcs.cloud import PointCloud
    from gppcs.comparison import Entry, compare
    from gppcs.depth_camera import from_depth
    from gppcs.errors import (
        FileFormatError,
        GppcsError,
        InputError,
        MissingExtraError,
        NoSurfaceError,
        OutputError,
        ParameterError,
    )
    from gppcs.evaluation.judge import evaluate
    from gppcs.evaluation.report import Figure, Rebuilt, Report, figures_of
    from gppcs.features import Features, estimate_features
    from gppcs.io import read, write
    from gppcs.mesh import Mesh, read_mesh
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
    from gppcs.normals import estimate_normals
    from gppcs.scans import sample
    from gppcs.simplification import Result, simplify
    from gppcs.summary import Summary, info

__version__ = "0.1.0"

_kernels.provide_folder()

_HOMES = {
    "cloud": ("PointCloud",),
    "comparison": ("Entry", "compare"),
    "depth_camera": ("from_depth",),
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
    "features": ("Features", "estimate_features"),
    "io": ("read", "write"),
    "mesh": ("Mesh", "read_mesh"),
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
    "normals": ("estimate_normals",),
    "scans": ("sample",),
    "simplification": ("Result", "simplify"),
    "summary": ("Summary", "info"),
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
