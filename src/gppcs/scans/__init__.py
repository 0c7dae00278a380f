"""Synthetic sample scans whose surface, normals and curvature are known exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import ParameterError, nearest_name, whole_number
from gppcs.scans.bracket import BRACKET
from gppcs.scans.fan import FAN
from gppcs.scans.medallion import MEDALLION
from gppcs.scans.patch import Patch, Scan, SurfacePoints
from gppcs.scans.sphere import SPHERE

__all__ = ["SCANS", "Patch", "Scan", "SurfacePoints", "sample"]

SCANS: dict[str, Scan] = {"medallion": MEDALLION, "bracket": BRACKET, "fan": FAN, "sphere": SPHERE}

# Small enough that the jets of a batch stay in the cache, and that many millions of points fit in memory.
BATCH = 32_768
OUTLIER_BOX = 1.5
OUTLIER_GREY = 128

Sampled = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]


def sample(
    name: str,
    n_points: int = 200_000,
    noise: float = 0.0,
    outliers: float = 0.0,
    uneven: float = 0.0,
    seed: int = 0,
) -> PointCloud:
    """Return a synthetic scan: random points on a surface of about 100 mm, in no particular order.

    Parameters
    ----------
    name : str
        One of `SCANS`.
    n_points : int
        Number of points, outliers included.
    noise : float
        Standard deviation of Gaussian noise on each coordinate, as a share of the diagonal of `Scan.box`.
    outliers : float, 0 to below 1
        Share of the points, rounded to a whole number of them, that lie anywhere in the box, enlarged
        1.5 times about its centre.
    uneven : float, 0 to below 1
        How much density the scan loses from the low end of x to the high end. The density is proportional to
        1 / distance², as for a scanner that stands so far before the low end that the highest x gets
        1 - uneven times the density of the lowest. With 0, uniform by area.
    seed : int
        The same arguments and seed give the same cloud.

    Returns
    -------
    PointCloud
        Points in millimetres, exact in float32, with the attributes `nx`, `ny`, `nz` (outward unit normal,
        float32), `curvature` (mean curvature in 1/mm, float32, positive where the surface bulges outward:
        1/r on a sphere of radius r), `red`, `green`, `blue` (uint8) and, where outliers are asked for,
        `outlier` (uint8, 0 or 1). A noisy point keeps normal and curvature of the place that it comes from;
        an outlier has zeros.

    Raises
    ------
    ParameterError
        If the name is unknown or a number is out of its range.
    """
    scan = _checked(name, n_points, noise, outliers, uneven, seed)
    rng = np.random.default_rng(seed)
    points, normals, curvature, colours = _on_surface(scan, n_points, uneven, rng)
    low, high = np.array(scan.box)
    if noise > 0.0:
        sigma = noise * float(np.linalg.norm(high - low))
        points += (sigma * rng.standard_normal(points.shape)).astype(np.float32)
    attributes: dict[str, NDArray[np.generic]] = {}
    if outliers > 0.0:
        stray = rng.permutation(n_points)[: round(outliers * n_points)]
        reach = OUTLIER_BOX * (high - low) / 2.0
        points[stray] = (low + high) / 2.0 + rng.uniform(-reach, reach, (len(stray), 3))
        normals[stray], curvature[stray], colours[stray] = 0.0, 0.0, OUTLIER_GREY
        attributes["outlier"] = np.zeros(n_points, np.uint8)
        attributes["outlier"][stray] = 1
    known = dict(zip(("nx", "ny", "nz"), normals.T, strict=True)) | {"curvature": curvature}
    painted = dict(zip(("red", "green", "blue"), colours.T, strict=True))
    return PointCloud(points.astype(np.float64), known | painted | attributes, np.dtype(np.float32))


def _checked(name: str, n_points: int, noise: float, outliers: float, uneven: float, seed: int) -> Scan:
    if name not in SCANS:
        raise ParameterError(f"expected the name of a sample scan, found {name!r}{nearest_name(name, SCANS)}")
    whole_number("the number of points", n_points, 1)
    if not 0.0 <= noise < np.inf:
        raise ParameterError(
            f"expected noise as a share of the diagonal, 0 or more, found {noise}; 0.005 is a noisy scan"
        )
    for argument, value in (("outliers", outliers), ("uneven", uneven)):
        if not 0.0 <= value < 1.0:
            raise ParameterError(
                f"expected {argument} from 0 to below 1, found {value}; give a share, such as 0.05 for 5 %"
            )
    whole_number("the seed", seed, 0)
    return SCANS[name]


def _on_surface(scan: Scan, n_points: int, uneven: float, rng: np.random.Generator) -> Sampled:
    """Draw points by rejection, until there are enough, as (points, normals, curvature, colours)."""
    points = np.empty((n_points, 3), np.float32)
    normals = np.empty((n_points, 3), np.float32)
    curvature = np.empty(n_points, np.float32)
    colours = np.empty((n_points, 3), np.uint8)
    # Proposals in proportion to the bounds make what is kept uniform over all patches, whatever their areas.
    weights = np.array([patch.weight for patch in scan.patches])
    filled = 0
    while filled < n_points:
        proposed = rng.multinomial(min(BATCH, 64 + 4 * (n_points - filled)), weights / weights.sum())
        drawn = [patch.draw(count, rng) for patch, count in zip(scan.patches, proposed, strict=True)]
        batch_points = np.concatenate([one.points for one in drawn])
        order = rng.permutation(len(batch_points))
        order = order[rng.uniform(0.0, 1.0, len(order)) < _density(scan, batch_points[order, 0], uneven)]
        order = order[: n_points - filled]
        rows = slice(filled, filled + len(order))
        points[rows] = batch_points[order]
        normals[rows] = np.concatenate([one.normals for one in drawn])[order]
        curvature[rows] = np.concatenate([one.curvature for one in drawn])[order]
        base = np.repeat([patch.colour for patch in scan.patches], [len(one.points) for one in drawn], axis=0)
        colours[rows] = _patinated(base[order], curvature[rows])
        filled += len(order)
    return points, normals, curvature, colours


def _density(scan: Scan, x: NDArray[np.float64], uneven: float) -> NDArray[np.float64]:
    """Return the density at x, relative to the highest, for a scanner at the low end of x."""
    low, high = scan.box[0][0], scan.box[1][0]
    # The scanner stands so far off that the density at the far end is 1 - uneven.
    growth = 1.0 / np.sqrt(1.0 - uneven) - 1.0
    density: NDArray[np.float64] = (1.0 + growth * (x - low) / (high - low)) ** -2.0
    return density


def _patinated(colours: NDArray[np.int64], curvature: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Darken hollows and brighten ridges, as handling does."""
    lightness = 1.0 + 0.3 * np.tanh(2.0 * curvature)
    patinated: NDArray[np.uint8] = np.clip(colours * lightness[:, None], 0.0, 255.0).astype(np.uint8)
    return patinated
