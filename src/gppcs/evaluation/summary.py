"""The summary of a cloud: size, spacing, attributes, repeats and invalid points."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike
from gppcs.clouds.quantities import names_of_units, unit_of
from gppcs.io.reading import as_cloud


@dataclass(frozen=True)
class Summary:
    """Facts about a cloud. Lengths are in the unit of the coordinates and use the finite points only.

    Attributes
    ----------
    points : int
        The number of points, N.
    minimum, maximum : tuple of three float
        Corners of the bounding box; NaN if no point is finite.
    diagonal : float
        Length of the diagonal of the bounding box; infinite if a float cannot hold it, NaN if no point is finite.
    spacing : float
        Median distance from a point to its nearest neighbour; NaN for fewer than two distinct points.
    repeats : int
        The number of points that have exactly the coordinates of an earlier point.
    non_finite : int
        The number of points with a NaN or infinite coordinate.
    coordinate_type : str
        The type of the coordinates in the source of the cloud, such as "float32".
    attributes : mapping of str to str
        The type of each attribute by name. For an attribute with several numbers per point, their number follows, as
        in "uint8 x 3".
    crs : str or None
        The coordinate reference system, if the file of the cloud names one.
    unit : str or None
        The unit of lengths, such as "m" or "us-ft", if the coordinate reference system tells it: that of x and y, or
        the metre if these are degrees.
    coordinate_units : tuple of str or None
        The units of x and y and of z, such as ("degrees", "m").
    ranges : mapping of str to (number, number) or None
        The minimum and maximum of each attribute by name, without NaN and infinity; None if there is no such
        value, or the attribute is no number. An attribute with several numbers per point has one range for all.
    """

    points: int
    minimum: tuple[float, float, float]
    maximum: tuple[float, float, float]
    diagonal: float
    spacing: float
    repeats: int
    non_finite: int
    coordinate_type: str
    attributes: Mapping[str, str]
    crs: str | None = None
    unit: str | None = None
    coordinate_units: tuple[str, str] | None = None
    ranges: Mapping[str, tuple[float, float] | None] = field(default_factory=dict)


def info(cloud: CloudLike) -> Summary:
    """Return the size, spacing, attributes, repeats and invalid points of a cloud.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, object that `PointCloud.from_object` takes, path, open file or CloudFiles
        It may be empty, and coordinates may be NaN or infinite.

    Returns
    -------
    Summary
        Lengths in the unit of the coordinates.

    Raises
    ------
    InputError
        If `cloud` is not a numeric (N, 3) array.
    FileFormatError, OSError
        If a file cannot be read.

    Examples
    --------
    >>> summary = gppcs.info([[0, 0, 0], [0, 0, 0], [3, 0, 0], [3, 4, 0]])
    >>> summary.points, summary.repeats, summary.spacing
    (4, 1, 3.0)
    """
    from gppcs.spatial.cells import first_occurrences
    from gppcs.spatial.kdtree import KdTree
    from gppcs.spatial.spacing import nearest_distances

    cloud = as_cloud(cloud)
    points = cloud.points[np.flatnonzero(cloud.is_finite())]
    first = first_occurrences(points)
    measured = points[first] * cloud.factors()
    # In units of a power of two, which round nothing, no difference and no square of one overflows.
    exponent = math.frexp(np.abs(measured).max(initial=0.0))[1] + 1
    distinct = np.ldexp(measured, -exponent)
    diagonal = spacing = math.nan
    if len(distinct):
        distinct -= distinct.min(axis=0)
        diagonal = float(np.linalg.norm(distinct.max(axis=0)))
    if len(distinct) > 1:
        spacing = float(np.median(nearest_distances(KdTree.build(distinct), 1)))
    with np.errstate(over="ignore"):
        diagonal, spacing = np.ldexp((diagonal, spacing), exponent).tolist()
    corners = np.stack([points.min(axis=0), points.max(axis=0)]) if len(points) else np.full((2, 3), np.nan)
    minimum, maximum = map(tuple, corners.tolist())
    return Summary(
        points=len(cloud),
        minimum=minimum,
        maximum=maximum,
        diagonal=diagonal,
        spacing=spacing,
        repeats=int((~first).sum()),
        non_finite=len(cloud) - len(points),
        coordinate_type=str(cloud.coordinate_dtype),
        attributes={
            name: " x ".join([str(values.dtype), *map(str, values.shape[1:])])
            for name, values in cloud.attributes.items()
        },
        crs=cloud.header.crs if cloud.header else None,
        unit=unit_of(cloud.header),
        coordinate_units=names_of_units(cloud.units) if cloud.units else None,
        ranges={name: _range(values) for name, values in cloud.attributes.items()},
    )


def _range(values: NDArray[np.generic]) -> tuple[float, float] | None:
    """Return the minimum and maximum of the finite values of an attribute; whole numbers stay whole."""
    if not (np.issubdtype(values.dtype, np.number) or values.dtype == bool) or np.iscomplexobj(values):
        return None
    finite = values[np.isfinite(values)]
    return (+finite.min().item(), +finite.max().item()) if finite.size else None
