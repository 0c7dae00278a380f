"""Noise that differs from place to place: how thick its layer is, and how wide the fits are that reach across it.

Depth cameras round depths to steps, and their noise grows with distance. Narrow fits then see a single step, and take
it for a clean surface. So quadrics are fitted to as many points of thinned clouds, which reach ever farther. As the
radius of the fits grows, noise stays about the same, and detail grows.
"""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.surface.noise import MEDIAN, SAMPLES, SHEETS, projections
from gppcs.surface.quadrics import TWO_PEAKS, fit_quadrics

FITTED = 80  # points of each fit
THIN = 0.1  # thinner layers, in radii of the narrowest fits, do not count
FRACTION = 0.19  # of samples that must have a layer that counts: 0.23 or more in scans with steps, 0.15 or less without


def uneven_noise(tree: KdTree) -> tuple[Floats, Ints] | None:
    """Return sigma and the stride of the narrowest fits across it, (n,); None if noise is small, even or detail."""
    n, finer, fewest = tree.points.shape[1], 4, 10_000
    widest = n / fewest  # points of the widest fits: to fewer, thin parts pass for noise, however many points there are
    if widest < finer:
        return None
    steps = round(np.log(widest) / np.log(finer))
    strides = np.array([round(widest ** (step / steps)) for step in range(steps + 1)])
    sampled = tree.thinned(-(-n // SAMPLES))
    near, _ = nearest_others(sampled, 16)  # the noise at a sample is the median of these
    sigmas, radii = np.empty((2, len(strides), len(near)))
    for number, stride in enumerate(strides):
        if number == len(strides) - 1 and (sigmas[:-1] > THIN * radii[0]).mean(axis=1).max() < FRACTION:
            return None  # whatever the widest fits see
        fitted = fit_quadrics(tree.thinned(int(stride)), sampled, FITTED, sheets=TWO_PEAKS)
        if fitted.two_sheets.mean() > SHEETS:
            return None
        sigmas[number] = np.median(np.abs(fitted.heights)[near], axis=1) / MEDIAN
        radii[number] = np.median(fitted.radii[near], axis=1)
    decided = _decided(sigmas, radii)
    if decided is None:
        return None
    at, sigma, fit = decided
    nearest = KdTree.build(np.ascontiguousarray(sampled.points.T[at])).nearest_of(
        np.ascontiguousarray(tree.points.T), 1
    )[0][:, 0]
    return sigma[nearest], strides[fit][nearest]


def _decided(sigmas: Floats, radii: Floats) -> tuple[Ints, Floats, Ints] | None:
    """Return the points with noise, its sigma and their narrowest fit, by measures (strides, points); or None."""
    # Noise grows by at most the square root of the radius, detail about as the radius.
    steady = (sigmas[1:] <= sigmas[:-1] * (radii[1:] / radii[:-1]) ** 0.5) & (sigmas[:-1] > 0.0)
    counted = steady & (sigmas[:-1] > THIN * radii[0])
    if counted.mean(axis=1).max() < FRACTION:
        return None
    at = np.flatnonzero(steady.any(axis=0))
    seen = steady.argmax(axis=0)[at]  # the narrowest fit that sees all of the layer
    sigma = sigmas[seen, at]
    lower, upper = np.quantile(sigma, [0.1, 0.9])
    if upper < 2.5 * lower:  # of even noise, the ratio is about 2
        return None
    across = radii[:, at] >= sigma / 0.3
    across[-1] = True
    return at, sigma, np.maximum(seen, across.argmax(axis=0))


def projected_across(tree: KdTree, strides: Ints) -> tuple[Floats, Floats, Floats]:
    """Return the feet, (n, 3), of the points on fits across the noise, with normals, (n, 3), and radii, (n,)."""
    feet, normals, radii = np.ascontiguousarray(tree.points.T), np.empty((len(strides), 3)), np.empty(len(strides))
    for stride in np.unique(strides):
        at, thinned = np.flatnonzero(strides == stride), tree.thinned(stride)
        for _ in range(2):
            moved, fitted = projections(thinned, KdTree.over(feet[at].T), FITTED)
            feet[at], normals[at], radii[at] = moved.T, fitted.normals.T, fitted.radii
    return feet, normals, radii
