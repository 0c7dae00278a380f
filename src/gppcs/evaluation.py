"""How good a simplification is, by figures that need no mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.cloud import PointCloud


@dataclass(frozen=True)
class Report:
    """The figures of a simplification; lengths in the unit of the coordinates.

    Attributes
    ----------
    points_in, points_out : int
        N and M.
    diagonal : float
        Of the original's bounding box, to put the lengths in relation.
    covering_radius : float
        The largest distance of an original point to the nearest kept one.
    mean_distance : float
        The mean of those distances.
    chamfer : float
        The mean squared distance to the nearest point, both ways, summed (the paper's CD), in squared units.
    mean_surface_variation : float
        Of the simplified cloud, measured on it (25 neighbours, the paper's radius): the larger, the more of its
        points lie on features.
    """

    points_in: int
    points_out: int
    diagonal: float
    covering_radius: float
    mean_distance: float
    chamfer: float
    mean_surface_variation: float


def evaluate(original: PointCloud | ArrayLike, simplified: PointCloud | ArrayLike) -> Report:
    """Compare a simplified cloud with the original, (N, 3) and (M, 3), both with finite coordinates.

    Raises
    ------
    InputError
        If either is empty, misshapen or not finite.
    """
    from gppcs.kdtree import KdTree

    before, after = (
        PointCloud.of(cloud).usable(f"{name} cloud")
        for cloud, name in ((original, "original"), (simplified, "simplified"))
    )
    corner = before.min(axis=0)
    before, after = before - corner, after - corner
    _, to_kept = KdTree.build(after).nearest_of(before, 1)
    _, to_original = KdTree.build(before).nearest_of(after, 1)
    return Report(
        points_in=len(before),
        points_out=len(after),
        diagonal=float(np.linalg.norm(before.max(axis=0))),
        covering_radius=float(np.sqrt(to_kept.max())),
        mean_distance=float(np.sqrt(to_kept).mean()),
        chamfer=float(to_kept.mean() + to_original.mean()),
        mean_surface_variation=_mean_surface_variation(after),
    )


def _mean_surface_variation(points: NDArray[np.float64]) -> float:
    """Return the mean, with the paper's radius even where points crowd together, since its tables use that."""
    from gppcs.features import features_in_radius
    from gppcs.kdtree import KdTree
    from gppcs.neighbourhood import ColumnGrid, neighbourhood_radius, paper_radius

    radius = paper_radius(points) or neighbourhood_radius(points, KdTree.build(points))
    return float(features_in_radius(ColumnGrid.build(points, radius)).surface_variation.mean())
