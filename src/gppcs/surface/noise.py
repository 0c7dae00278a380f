"""Noise: how far points lie off the surface that their neighbours span, and where on that surface they belong.

The rows "noise off" and "wide neighbourhoods off" of the ablation
(benchmarks/results/gp_ablation.md) show what the parts are worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree
from gppcs.surface.quadrics import Quadrics, fit_quadrics

FEWEST = 12  # A quadric has six coefficients. Fitted to fewer points than this it follows their noise.
NEIGHBOURS = 30  # Points of a fit if the noise is thin compared with the neighbourhood: five for each coefficient.
# Noise above this, in neighbourhood radii, is thick: neighbourhoods lie within its layer, not across it. 32
# clouds without added noise have at most 0.22.
THICK = 0.25
# What lies off quadrics is detail if twice as many points lower its ratio to their radius to no less than this share.
# That of noise falls to 1 / sqrt(2), as its distance stays; that of vegetation and clutter stays about the same.
DETAIL = 0.85
CLEAN = 0.04  # Noise below this, in target spacings, changes no choice that matters, and lets sharp places be told.
TOLERATED = 0.5  # Noise of this size, in target spacings, makes an observation as uncertain as the prior.
# Largest variance of an observation, in units of the prior's, so that lone points still count. Without it the covering
# radius of a desk scan grows from 1.7 to 6.7 times that of fps (research/experiments.md).
LARGEST = 2.0
MEDIAN = 0.6745  # Of the absolute value of standard normal numbers.
SAMPLES = 4096  # Points on which the noise level is measured: its error is then about one per cent.
# The level is told by this share of the points; Gaussian noise has that share within so many standard deviations.
SHARE, DEVIATIONS = 0.9, 1.645


class Layer(NamedTuple):
    """The layer of noise about the quadrics fitted to the points around each point, in quantiles, for outliers."""

    # From the distance of the quadrics within which 90 % of the points lie: the standard deviation of Gaussian noise.
    level: float
    radius: float  # Median radius of the neighbourhoods

    @classmethod
    def of(cls, distances: NDArray[np.float64], radii: NDArray[np.float64]) -> Layer:
        """Return the layer, given the distances of points from their quadrics and the radii of neighbourhoods, (m,)."""
        return cls(float(np.quantile(distances, SHARE)) / DEVIATIONS, float(np.median(radii)))

    @classmethod
    def between(cls, places: NDArray[np.float64], feet: NDArray[np.float64], fitted: Quadrics) -> Layer:
        """Return the layer between places and their feet on quadrics, (3, m) both."""
        return cls.of(np.sqrt(((feet - places) ** 2).sum(axis=0)), fitted.reaches)


class Observations(NamedTuple):
    """What observations at n places are worth."""

    # (n, 3), projections onto the surface, where features are measured; None if the noise is not thick: features are
    # then measured at the places themselves.
    feet: NDArray[np.float64] | None
    # (n,): Variance of each observation; 0 without noise. Divided by h^2 it is in units of the prior variance of a
    # field with target spacing h.
    variances: NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """The noise of a cloud, for a simplification to a given target spacing.

    Detail of about that size looks like thin noise, which therefore makes observations uncertain, but moves no
    features.
    """

    # Over the points to which quadrics are fitted; None if no noise matters, so that its memory is free.
    tree: KdTree | None
    neighbours: int  # Points of each fit
    thick: bool  # Whether the layer of noise about quadrics of `NEIGHBOURS` points is thick
    # Distance of the points from the surface, as in `Layer`, in the unit of the tree; 0 where it is not measured.
    level: float
    # Whether no noise matters: there is little, it is detail of the surface such as vegetation, or too few points lie
    # near each other to measure it.
    quiet: bool
    clean: bool  # Whether there is little, so that sharp places can be told
    spacing: float  # Target spacing, in the same unit

    @classmethod
    def measure(cls, tree: KdTree, n_points: int, spacing: float) -> Noise:
        """Measure the noise of the points of a tree; neighbourhoods never grow beyond the target spacing."""
        within = int(np.pi * len(tree.order) / n_points)  # points within the target spacing of a point, on average
        noise = cls.from_layers(partial(layer_of, tree), within, spacing)
        return noise if noise.quiet else replace(noise, tree=tree)

    @classmethod
    def from_layers(cls, layer_of: Callable[[int], Layer], within: int, spacing: float) -> Noise:
        """Tell the noise from the layers about quadrics fitted to different numbers of points."""
        if within < FEWEST:
            return cls(None, within, False, 0.0, True, True, spacing)
        layer_of = cache(layer_of)
        narrow = layer_of(NEIGHBOURS)
        thick = narrow.level > THICK * narrow.radius
        neighbours = min(2 * NEIGHBOURS if thick else NEIGHBOURS, within)
        layer = layer_of(neighbours)
        clean = layer.level <= CLEAN * spacing
        quiet = clean or (not thick and is_detail(narrow, layer_of(2 * NEIGHBOURS)))
        return cls(None, neighbours, thick, layer.level, quiet, clean, spacing)

    def observe(self, places: NDArray[np.float64]) -> Observations:
        """Return what observations at some places are worth. Shapes: places (n, 3)."""
        if self.tree is None:
            return Observations(None, np.zeros(len(places)))
        feet = feet_of(self.tree, places, self.neighbours)
        squared = ((feet - places) ** 2).sum(axis=1)
        variances = np.minimum(squared / TOLERATED**2, LARGEST * self.spacing**2)
        return Observations(feet if self.thick else None, variances)

    def projected(self, places: KdTree) -> tuple[NDArray[np.float64], Quadrics]:
        """Return the feet of places, (3, m) in tree order, on the quadrics across the noise; only where it matters."""
        assert self.tree is not None
        return projections(self.tree, places, self.neighbours)


def is_detail(fine: Layer, wide: Layer) -> bool:
    """Return whether what lies off quadrics is detail of the surface rather than noise."""
    return wide.level * fine.radius > DETAIL * fine.level * wide.radius


def projections(tree: KdTree, places: KdTree, neighbours: int) -> tuple[NDArray[np.float64], Quadrics]:
    """Project places onto the quadrics fitted to the points around them, (3, m) in the order of their tree."""
    fitted = fit_quadrics(tree, places, neighbours)
    return places.points + np.clip(fitted.heights, -fitted.reaches, fitted.reaches) * fitted.normals, fitted


def feet_of(tree: KdTree, places: NDArray[np.float64], neighbours: int) -> NDArray[np.float64]:
    """Return the projections, (m, 3), of places, (m, 3), onto quadrics fitted to the nearest points of a tree."""
    of_places, feet = KdTree.build(places), np.empty_like(places)
    feet[of_places.order] = projections(tree, of_places, neighbours)[0].T
    return feet


def layer_of(tree: KdTree, neighbours: int) -> Layer:
    """Measure the layer of noise on at most `SAMPLES` points, evenly spread over the tree."""
    some = KdTree.over(np.ascontiguousarray(tree.points[:, :: -(-len(tree.order) // SAMPLES)]))
    feet, fitted = projections(tree, some, neighbours)
    return Layer.between(some.points, feet, fitted)
