"""The methods by name. Adding one is adding its file, its import and its place in the list."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gppcs.errors import ParameterError, nearest_name
from gppcs.methods.aivs import AIVS
from gppcs.methods.fps import FarthestPoint
from gppcs.methods.fps_variation import FarthestPointVariation
from gppcs.methods.gp import LocalGP
from gppcs.methods.gp_spectral import SpectralGP
from gppcs.methods.hc import HierarchicalClustering
from gppcs.methods.method import Method, Selection
from gppcs.methods.pc_simp import PCSimp
from gppcs.methods.qem import QEM
from gppcs.methods.random import Random
from gppcs.methods.sample_elimination import SampleElimination
from gppcs.methods.top_variation import TopVariation
from gppcs.methods.voxel import Voxel
from gppcs.methods.wlop import WLOP

METHODS: Mapping[str, type[Method]] = {
    method.name: method
    for method in (
        LocalGP,
        SpectralGP,
        FarthestPointVariation,
        TopVariation,
        FarthestPoint,
        Random,
        HierarchicalClustering,
        WLOP,
        SampleElimination,
        Voxel,
        AIVS,
        PCSimp,
        QEM,
    )
}
DEFAULT = LocalGP.name


def method_named(name: str, settings: Mapping[str, Any] | None = None) -> Method:
    """Return the method of that name, with its defaults replaced by `settings`, which may be text.

    Raises
    ------
    ParameterError
        If there is no such method or parameter, with the nearest name.
    """
    if name not in METHODS:
        raise ParameterError(f"there is no method {name!r}{nearest_name(name, METHODS)}")
    return METHODS[name]().replaced(settings or {})


__all__ = [
    "AIVS",
    "DEFAULT",
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
    "method_named",
]
