"""Noise: how far points lie off the quadrics of their neighbours, and what observations of the surface are then worth.

Where more points make the fits wider, the layer of noise stays, and that of detail grows. The rows "noise off", "wide
neighbourhoods off" and "largest variance off" of the ablation (benchmarks/results/gp_ablation.md) show its worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Flags, Floats
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import quantile
from gppcs.surface.quadrics import TWO_PEAKS, Quadrics, fit_quadrics

FEWEST = 12  # A quadric has six coefficients. Fitted to fewer points than this it follows their noise.
NEIGHBOURS = 30  # Points of a fit if the noise is thin compared with the neighbourhood: five for each coefficient.
# Noise above this, in neighbourhood radii, is thick: neighbourhoods lie within its layer, not across it. 32
# clouds without added noise have at most 0.22.
THICK = 0.25
# What lies off quadrics is detail if twice as many points lower its ratio to their radius to no less than this. That of
# noise falls to 1 / sqrt(2), as its distance stays; that of vegetation and clutter stays about the same.
DETAIL = 0.85
# Fits of 60 points with two peaks, of all, above which a cloud has two sheets: thin parts have 0.17 to 0.76, all others
# at most 0.02 (research/local-field.md).
SHEETS = 0.05
# The kurtosis of fits of so many points and more scatters less, so a larger one is enough. Where noise is a fourth of
# the distance of sheets, 0.3 or more are below, where it is a third, and in other clouds, at most 0.06.
WIDE, WIDE_PEAKS, WIDE_SHEETS = 160, 1.9, 0.1
CLEAN = 0.04  # Noise below this, in target spacings, changes no choice that matters, and sharpness can be measured.
TOLERATED = 0.5  # Noise of this size, in target spacings, makes an observation as uncertain as the prior.
# Largest variance of an observation, in units of the prior's, so that isolated points still count. Without it the
# covering radius of a desk scan grows from 1.7 to 6.7 times that of fps (research/experiments.md).
LARGEST = 2.0
# In radii of a fit: queries as near its middle share its quadric. That takes half of the time, and the feet of a noisy
# Armadillo are 3 % farther from the surface.
SHARED = 0.5
MEDIAN = 0.6745  # Of the absolute value of standard normal numbers.
SAMPLES = 4096  # Points on which the noise is measured: its error is then about one per cent.
SAMPLES_IN_LEAF = 8  # which share a search: few, as they are far from each other
FEW_SAMPLES = 256  # Of a small cloud, where the fits would take most of the time: the error is four per cent.


class NoiseLayer(NamedTuple):
    """The layer of noise about the quadrics fitted to the points around each point, in quantiles, for outliers."""

    sigma: float  # Standard deviation of the noise: 90th percentile of the distance to the quadric, divided by 1.645
    radius: float  # Median radius of the neighbourhoods

    @classmethod
    def about(cls, fitted: Quadrics) -> NoiseLayer:
        """Return the layer about quadrics."""
        distances = np.minimum(np.abs(fitted.heights), fitted.radii)
        return cls(quantile(distances, 0.9) / 1.645, quantile(fitted.radii, 0.5))

    @property
    def ratio(self) -> float:
        """Thickness in radii of the neighbourhoods."""
        return self.sigma / self.radius

    def is_thick(self) -> bool:
        """Return whether neighbourhoods lie within the layer."""
        return self.sigma > THICK * self.radius

    def is_detail(self, wider: NoiseLayer) -> bool:
        """Return whether what lies off quadrics is detail, not noise, by the layer about quadrics of more points."""
        return wider.sigma * self.radius > DETAIL * self.sigma * wider.radius


def layer_of(tree: KdTree, neighbours: int) -> NoiseLayer:
    """Measure the layer of noise on an eighth of the points, `FEW_SAMPLES` to `SAMPLES`, evenly spread."""
    return NoiseLayer.about(fit_quadrics(tree, _sampled(tree), neighbours))


class Sheets(NamedTuple):
    """What fits see of two sheets near each other, by those that see both: others may see a part of the second."""

    fraction: float  # of the fits that see both
    noise: float  # of each sheet
    apart: float  # distance of the sheets
    radius: float  # of the fits


def two_sheets(tree: KdTree, neighbours: int = 2 * NEIGHBOURS) -> Sheets | None:
    """Measure two sheets by fits to so many neighbours; None if hardly any fit sees both."""
    peaks, fewest, one_of = (TWO_PEAKS, SHEETS, 1) if neighbours < WIDE else (WIDE_PEAKS, WIDE_SHEETS, 8)
    sampled = _sampled(tree, one_of)
    own = fit_quadrics(tree, sampled, neighbours, sheets=peaks)
    seen = own.kurtosis < peaks
    if (fraction := float(seen.mean())) <= fewest:
        return None
    both = fit_quadrics(tree, sampled, neighbours)
    apart, radius = 2.0 * quantile(np.abs(both.heights[seen]), 0.5), quantile(both.radii[seen], 0.5)
    return Sheets(fraction, _noise_of_each(own, seen), apart, radius)


def _noise_of_each(own: Quadrics, seen: Flags) -> float:
    """Return the noise of each of two sheets, by those fits to the query's own one that have seen both."""
    return quantile(np.abs(own.heights[seen]), 0.5) / MEDIAN


def _sampled(tree: KdTree, one_of: int = 1) -> KdTree:
    """Return a tree over some of the points of another, evenly spread; if wanted, over one of so many of them."""
    n = len(tree.order)
    step = -(-n * one_of // min(max(n // 8, FEW_SAMPLES), SAMPLES))
    return KdTree.over(tree.points[:, ::step], leaf_size=SAMPLES_IN_LEAF)


def across(layers: Callable[[int], NoiseLayer], largest: int) -> tuple[int, NoiseLayer]:
    """Double the points of a fit until neighbourhoods lie across the layer of noise, not within it."""
    neighbours = NEIGHBOURS
    while (layer := layers(neighbours)).is_thick() and neighbours < largest:
        neighbours *= 2
    return neighbours, layer


def projections(tree: KdTree, queries: KdTree, neighbours: int, sheets: float = 0.0) -> tuple[Floats, Quadrics]:
    """Project the points of one tree onto the quadrics fitted to points of another around them, (3, m) in its order."""
    fitted = fit_quadrics(tree, queries, neighbours, sheets=sheets)
    return projected(queries.points, fitted), fitted


def projected(points: Floats, fitted: Quadrics) -> Floats:
    """Return the projections of points onto the quadrics fitted around them, (3, m) both."""
    return points + np.clip(fitted.heights, -fitted.radii, fitted.radii) * fitted.normals


def feet_of(tree: KdTree, points: Floats, neighbours: int) -> Floats:
    """Return the projections, (m, 3), of points, (m, 3), onto quadrics fitted to the nearest points of a tree."""
    of_points, feet = KdTree.build(points), np.empty_like(points)
    feet[of_points.order] = projections(tree, of_points, neighbours)[0].T
    return feet


@dataclass(frozen=True)
class Noise:
    """The noise of a cloud, for a simplification to a given target spacing."""

    tree: KdTree | None  # Over the points to which quadrics are fitted; None if no noise matters
    neighbours: int  # Points of each fit
    thick: bool  # Whether the layer of noise about quadrics of `NEIGHBOURS` points is thick
    sigma: float  # Standard deviation, as in `NoiseLayer`, in the unit of the tree; 0 where it is not measured
    # Whether no noise matters: there is little, it is detail or two sheets, or there are too few points to measure it.
    is_negligible: bool
    is_below_threshold: bool  # Whether sigma is so small, and sheets so far apart, that sharpness can be measured
    spacing: float  # Target spacing, in the same unit

    @classmethod
    def measure(cls, tree: KdTree, n_points: int, spacing: float) -> Noise:
        """Measure the noise of the points of a tree; neighbourhoods never grow beyond the target spacing."""
        within = int(np.pi * len(tree.order) / n_points)  # points within the target spacing of a point, on average
        if within < FEWEST:
            return cls(None, within, False, 0.0, True, True, spacing)
        sampled = _sampled(tree, 2)  # half as many are enough for what is only compared
        layers = cache(lambda k: NoiseLayer.about(fit_quadrics(tree, sampled, k)))
        neighbours = min(across(layers, 2 * NEIGHBOURS)[0], within)
        sigma, thick = layers(neighbours).sigma, layers(NEIGHBOURS).is_thick()
        if sigma <= CLEAN * spacing:
            return cls(None, neighbours, thick, sigma, True, True, spacing)
        own = fit_quadrics(tree, sampled, 2 * NEIGHBOURS, sheets=TWO_PEAKS)
        if own.two_sheets.mean() > SHEETS:
            return cls(None, neighbours, False, _noise_of_each(own, own.two_sheets), True, False, spacing)
        is_negligible = not thick and layers(NEIGHBOURS).is_detail(NoiseLayer.about(own))
        return cls(None if is_negligible else tree, neighbours, thick, sigma, is_negligible, False, spacing)

    @property
    def in_spacings(self) -> float:
        """The standard deviation, in target spacings."""
        return self.sigma / self.spacing if self.spacing > 0.0 else 0.0

    def observe(self, points: Floats, fitted: Quadrics | None = None) -> tuple[Floats | None, Floats]:
        """Return feet, (n, 3), and variances, (n,), of observations at points, (n, 3), times h^2 (Eq. (7)).

        Quadrics are fitted around the points if they are not there. The feet are where features are measured:
        projections onto the surface, None if the noise is not thick, as detail looks like thin noise.
        """
        if self.tree is None:
            return None, np.zeros(len(points))
        feet = feet_of(self.tree, points, self.neighbours) if fitted is None else projected(points.T, fitted).T
        squared = ((feet - points) ** 2).sum(axis=1)
        variances = np.minimum(squared / TOLERATED**2, LARGEST * self.spacing**2)  # Eq. (7)
        return feet if self.thick else None, variances

    def fitted(self, points: KdTree) -> Quadrics:
        """Return the quadrics across the noise around points, in tree order and float32; only where noise matters."""
        assert self.tree is not None
        return fit_quadrics(self.tree, points, self.neighbours, SHARED).astype(np.float32)
