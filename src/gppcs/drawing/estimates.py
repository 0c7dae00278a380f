"""Surface variation and normals of any cloud, as pictures and pages show them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised
from gppcs.surface.surface_variation import features_around

KNOWN = 4  # points in a neighbourhood, at least: fewer always seem flat
ROUNDING = 1e-12  # surface variation that rounding leaves on a plane; drawn, it would look like relief


def estimates(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], KdTree]:
    """Return surface variation (N,) and normals (N, 3) without a sign at points (N, 3), and a tree over them.

    The variation is NaN where fewer than four points are near. The tree is over the distinct points, shifted and scaled
    by `normalised`.
    """
    local, _, _ = normalised(points)
    distinct = local[first_occurrences(local)]
    tree = KdTree.build(distinct)
    features = features_around(distinct, tree, 25)
    measured = np.where(features.surface_variation <= ROUNDING, 0.0, features.surface_variation)
    variation = np.where(features.neighbours >= KNOWN, measured, np.nan)
    same = tree.nearest_of(local, 1)[0][:, 0]
    return variation[same], features.normals[same], tree
