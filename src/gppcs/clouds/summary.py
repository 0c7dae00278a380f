"""What a cloud is like, before anything is done to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gppcs.clouds.cloud import PointCloud


@dataclass(frozen=True)
class Summary:
    """The facts of a cloud; lengths in the unit of its coordinates, over the points that are finite.

    Attributes
    ----------
    points : int
        N.
    low, high : tuple of three float
        Corners of the bounding box; NaN where no point is finite.
    diagonal : float
        Of the bounding box.
    spacing : float
        Median distance of a point to the nearest other one; NaN for fewer than two distinct points.
    repeats : int
        Points that have exactly the coordinates of an earlier one.
    non_finite : int
        Points with a coordinate that is NaN or infinite.
    coordinate_type : str
        The type of the coordinates where they came from.
    attributes : mapping of name to str
        The type of each attribute, with its shape beyond N where it has one.
    """

    points: int
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    diagonal: float
    spacing: float
    repeats: int
    non_finite: int
    coordinate_type: str
    attributes: Mapping[str, str]


def info(cloud: PointCloud | ArrayLike) -> Summary:
    """Return the facts of a cloud; it may be empty or hold coordinates that are not finite."""
    from gppcs.spatial.cells import first_occurrences
    from gppcs.spatial.kdtree import KdTree
    from gppcs.spatial.spacing import spacing

    cloud = PointCloud.of(cloud)
    bad = cloud.non_finite()
    points = np.delete(cloud.points, bad, axis=0) if len(bad) else cloud.points
    low = points.min(axis=0) if len(points) else np.full(3, np.nan)
    high = points.max(axis=0) if len(points) else np.full(3, np.nan)
    first = first_occurrences(points)
    distinct = points[first] - low
    return Summary(
        points=len(cloud),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        diagonal=float(np.linalg.norm(high - low)),
        spacing=spacing(KdTree.build(distinct)) if len(distinct) > 1 else float("nan"),
        repeats=int((~first).sum()),
        non_finite=len(bad),
        coordinate_type=str(cloud.coordinate_dtype),
        attributes={
            name: " x ".join([str(values.dtype), *map(str, values.shape[1:])])
            for name, values in cloud.attributes.items()
        },
    )
