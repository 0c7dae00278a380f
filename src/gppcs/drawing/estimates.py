"""Surface variation and normals of any cloud, as pictures and pages show them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised
from gppcs.surface.surface_variation import features_around

Array = NDArray[np.float64]

KNOWN = 4  # points in a neighbourhood, at least: fewer always seem flat
ROUNDING = 1e-12  # surface variation that rounding leaves on a plane; drawn, it would look like relief


class Estimates(NamedTuple):
    """What is estimated at N points.

    Attributes
    ----------
    variation : (N,) array, float64
        Surface variation; NaN where fewer than four points are near.
    normals : (N, 3) array, float64
        Unit normals, without a sign.
    tree : KdTree
        Over the places of the points, shifted and scaled by `normalised`.
    """

    variation: Array
    normals: Array
    tree: KdTree

    @classmethod
    def of(cls, points: Array) -> Estimates:
        """Estimate the surface at each point.

        Shapes: points (N, 3).
        """
        local, _, _ = normalised(points)
        distinct = local[first_occurrences(local)]
        tree = KdTree.build(distinct)
        features = features_around(distinct, tree, 25)
        measured = np.where(features.surface_variation <= ROUNDING, 0.0, features.surface_variation)
        variation = np.where(features.neighbours >= KNOWN, measured, np.nan)
        same = tree.nearest_of(local, 1)[0][:, 0]
        return cls(variation[same], features.normals[same], tree)
