"""Synthetic sample scans whose surfaces and normals are known exactly."""

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import COLOUR
from gppcs.errors import ParameterError, nearest_name, number, shown, whole_number
from gppcs.scans.bracket import BRACKET
from gppcs.scans.fan import FAN
from gppcs.scans.medallion import MEDALLION
from gppcs.scans.painted import FRESCO, STREET
from gppcs.scans.patch import Scan, zone
from gppcs.scans.village import VILLAGE

SPHERE = Scan((zone(50.0, 0.0, (-1.0, 1.0), (-np.pi, np.pi), (120, 160, 190)),), ((-50.0,) * 3, (50.0,) * 3))
SCANS = {
    "medallion": MEDALLION, "bracket": BRACKET, "fan": FAN, "sphere": SPHERE, "fresco": FRESCO, "street": STREET,
    "village": VILLAGE,
}  # fmt: skip


def sample(
    name: str, n_points: int = 200_000, noise: float = 0.0, outliers: float = 0.0, uneven: float = 0.0, seed: int = 0
) -> PointCloud:
    """Return a synthetic scan, whose surface is known exactly.

    "medallion", "bracket", "fan" and "sphere" are about 100 mm large. The detail of two others is no shape: "fresco" is
    a wall of 4 m with a picture, "street" 20 m of a street with markings. "village" is 120 m of hills with houses,
    trees and a power line. Points are random on the surface, in random order.

    Parameters
    ----------
    name : str
        "medallion", "bracket", "fan", "sphere", "fresco", "street" or "village".
    n_points : int
        Number of points, outliers included; at least 1.
    noise : float
        Standard deviation of the Gaussian noise on each coordinate, as a fraction of the bounding box's diagonal.
    outliers : float
        Fraction of the points that are outliers, from 0 to below 1. Outliers are uniform in the bounding box, enlarged
        1.5 times about its centre. Their number is rounded.
    uneven : float
        Loss of density along x, from 0 to 0.999: at the highest x, the density is 1 - `uneven` times that at the lowest
        x. It falls as 1 / distance², as if from a scanner in front of the low end. With 0, points are uniform by area.
    seed : int
        The same arguments and seed give the same cloud. At least 0.

    Returns
    -------
    PointCloud
        Points in millimetres, of the village in metres, exact in float32, with these attributes: `nx`, `ny`, `nz`, the
        unit normal (float32), which points outward; `curvature`, the mean curvature (float32), positive where the
        surface bulges outward: 1/r on a sphere of radius r; `red`, `green`, `blue` (uint8); and, if there are outliers,
        `outlier` (uint8, 0 or 1). The street has noisy `intensity` (uint16), and `marking` (uint8, 0 or 1). The village
        has `classification`, the code of the LAS specification (uint8): 2 ground, 5 high vegetation, 6 building, 7
        outlier, 14 wire and 15 pylon. A noisy point keeps the normal and the curvature of its place on the surface.
        Both are zero for outliers.

    Raises
    ------
    ParameterError
        If the name is unknown, or a number is outside its range.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000, noise=0.001, seed=3)
    >>> cloud.points.shape
    (1000, 3)
    """
    if not isinstance(name, str) or name not in SCANS:
        raise ParameterError(f"expected the name of a sample scan, found {shown(name)}{nearest_name(name, SCANS)}")
    return measure(SCANS[name], n_points, noise, outliers, uneven, seed)


def measure(
    scan: Scan, n_points: int, noise: float = 0.0, outliers: float = 0.0, uneven: float = 0.0, seed: int = 0
) -> PointCloud:
    """Return points of a surface, with noise and outliers; see `sample`."""
    _check(n_points, noise, outliers, uneven, seed)
    rng = np.random.default_rng(seed)
    points, attributes, box = scan.measure(n_points, uneven, rng)
    lower, upper = np.array(box)
    if noise > 0.0:
        sigma = noise * float(np.linalg.norm(upper - lower))
        points += (sigma * rng.standard_normal(points.shape)).astype(np.float32)
    if outliers > 0.0:
        stray = rng.permutation(n_points)[: round(outliers * n_points)]
        half = 1.5 * (upper - lower) / 2.0
        points[stray] = (lower + upper) / 2.0 + rng.uniform(-half, half, (len(stray), 3))
        attributes["outlier"] = np.zeros(n_points, np.uint8)
        for attribute, values in attributes.items():
            # Without a surface, grey, and of the class of noise in the LAS specification.
            values[stray] = {**dict.fromkeys(COLOUR, 128), "classification": 7, "outlier": 1}.get(attribute, 0)
    return PointCloud(points.astype(np.float64), attributes, np.dtype(np.float32))


def _check(n_points: int, noise: float, outliers: float, uneven: float, seed: int) -> None:
    """Raise a ParameterError that names the number that is outside its range, if one is."""
    most = 10**17  # an array of more points is beyond the range of its size
    whole_number("the seed", seed, 0)
    for value, is_valid, expected in (
        (n_points, whole_number("the number of points", n_points, 1) <= most, f"at most {most:,} points"),
        (noise, 0.0 <= number(noise) < np.inf, "noise as a fraction of the diagonal, 0 or more"),
        (outliers, 0.0 <= number(outliers) < 1.0, "outliers from 0 to below 1"),
        (uneven, 0.0 <= number(uneven) <= 0.999, "uneven from 0 to 0.999"),
    ):
        if not is_valid:
            raise ParameterError(f"expected {expected}, found {shown(value)}")
