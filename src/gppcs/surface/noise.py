"""Noise: how far points lie off the surface that their neighbours span, and where on that surface they belong.

The rows "noise off" and "wide neighbourhoods off" of the ablation
(benchmarks/results/gp_ablation.md) show what the parts are worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree
from gppcs.surface.quadrics import fit_quadrics

FEWEST = 12  # A quadric has six coefficients. Fitted to fewer points than this it follows their noise.
NEIGHBOURS = 30  # Points of a fit if the noise is thin compared with the neighbourhood: five for each coefficient.
WIDEST = 120  # Points of a fit at most. Quadrics of more points cut off detail and take long.
THICK = 0.25  # Noise above this, in neighbourhood radii, is thick. 32 clouds without added noise have at most 0.22.
QUIET = 0.04  # Noise below this, in target spacings, changes no choice that matters.
TOLERATED = 0.5  # Noise of this size, in target spacings, makes an observation as uncertain as the prior.
# Largest variance of an observation, in units of the prior's, so that lone points still count. Without it the covering
# radius of a desk scan grows from 1.7 to 6.7 times that of fps (docs/experiments.md).
LARGEST = 2.0
SAMPLES = 4096  # Points on which the noise level is measured: its error is then about one per cent.


@dataclass(frozen=True)
class Noise:
    """The noise of a cloud, for a simplification to a given target spacing.

    Detail of about the target spacing lies off the quadrics, too, and looks like thin noise. So thin noise makes
    observations uncertain, but features stay those of the points. Thick noise moves the features to the surface.

    Attributes
    ----------
    tree : KdTree or None
        Over the points to which quadrics are fitted; None if no noise matters, so that its memory is free.
    neighbours : int
        Points of each fit.
    thick : bool
        Whether neighbourhoods of `NEIGHBOURS` points lie within the layer of noise instead of across it.
    level : float
        Root mean square distance of the points from the surface, in the unit of the tree; 0 where it is not measured.
    spacing : float
        Target spacing, in the same unit.
    """

    tree: KdTree | None
    neighbours: int
    thick: bool
    level: float
    spacing: float

    @classmethod
    def measure(cls, tree: KdTree, n_points: int, spacing: float) -> Noise:
        """Measure the noise of the points of a tree.

        Neighbourhoods never grow beyond the target spacing, since detail of that size should be kept.

        Parameters
        ----------
        tree : KdTree
            Over N points: the cloud or a sample of it.
        n_points : int
            M, the number of points to keep.
        spacing : float
            Target spacing, in the unit of the tree.

        Returns
        -------
        Noise
            Its level is 0 if fewer than `FEWEST` points lie within the target spacing of a point.
        """
        within = int(np.pi * len(tree.order) / n_points)  # points within the target spacing of a point, on average
        if within < FEWEST:
            return cls(None, within, False, 0.0, spacing)
        neighbours, level = neighbours_across_noise(tree)
        thick = neighbours > NEIGHBOURS
        if neighbours > within:
            neighbours, level = within, level_and_radius(tree, within)[0]
        noise = cls(tree, neighbours, thick, level, spacing)
        return replace(noise, tree=None) if noise.quiet else noise

    @property
    def quiet(self) -> bool:
        """Whether there is no noise that matters, or too few points near each other to measure it."""
        return self.level <= QUIET * self.spacing

    def observe(self, places: KdTree) -> tuple[KdTree, NDArray[np.float64]]:
        """Return the places where the features of points are measured, and the variances of the observations.

        Parameters
        ----------
        places : KdTree
            Over n points.

        Returns
        -------
        feet : KdTree
            Projections onto the surface, in the same order, if the noise is thick; otherwise the places themselves.
        variances : (n,) array
            Variance of each observation, in tree order; 0 without noise. Divided by h^2 it is in units of the prior
            variance of a field with target spacing h.
        """
        if self.tree is None:
            return places, np.zeros(len(places.order))
        feet, _ = projections(self.tree, places, self.neighbours)
        squared = ((feet.points - places.points) ** 2).sum(axis=0)
        variances = np.minimum(squared / TOLERATED**2, LARGEST * self.spacing**2)
        return (feet if self.thick else places), variances


def neighbours_across_noise(tree: KdTree) -> tuple[int, float]:
    """Double neighbourhoods until they lie across the layer of noise, not within it.

    Parameters
    ----------
    tree : KdTree
        Over N points.

    Returns
    -------
    neighbours : int
        Points of each fit: `NEIGHBOURS`, doubled up to `WIDEST`.
    level : float
        Root mean square distance of the points from these quadrics, in the unit of the tree.
    """
    return across_noise(lambda neighbours: level_and_radius(tree, neighbours))


def across_noise(level_and_radius: Callable[[int], tuple[float, float]]) -> tuple[int, float]:
    """Double neighbourhoods as `neighbours_across_noise` does.

    Parameters
    ----------
    level_and_radius : callable
        Takes the number of points of each fit: `NEIGHBOURS`, doubled up to `WIDEST`. Returns what the function
        `level_and_radius` returns.

    Returns
    -------
    neighbours : int
    level : float
    """
    neighbours = NEIGHBOURS
    level, radius = level_and_radius(neighbours)
    while level > THICK * radius and neighbours < WIDEST:
        neighbours *= 2
        level, radius = level_and_radius(neighbours)
    return neighbours, level


def projections(tree: KdTree, places: KdTree, neighbours: int) -> tuple[KdTree, NDArray[np.float64]]:
    """Project places onto the quadrics fitted to the points around them.

    Parameters
    ----------
    tree : KdTree
        Over the points to which quadrics are fitted.
    places : KdTree
        Over m places.
    neighbours : int
        Points of each fit.

    Returns
    -------
    feet : KdTree
        Over the projected places, in the same order.
    radii : (m,) array
        Radii of the neighbourhoods, in the order of the tree of places.
    """
    quadrics = fit_quadrics(tree, places, neighbours)
    rise = np.clip(quadrics.heights, -quadrics.reaches, quadrics.reaches)
    return KdTree.over(places.points + rise * quadrics.normals, places.order), quadrics.reaches


def level_and_radius(tree: KdTree, neighbours: int) -> tuple[float, float]:
    """Measure distances from the surface on at most `SAMPLES` points, evenly spread over the tree.

    Parameters
    ----------
    tree : KdTree
        Over N points.
    neighbours : int
        Points of each fit.

    Returns
    -------
    level : float
        Root mean square distance of the points from their quadrics.
    radius : float
        Root mean square radius of their neighbourhoods.
    """
    some = KdTree.over(np.ascontiguousarray(tree.points[:, :: -(-len(tree.order) // SAMPLES)]))
    feet, radii = projections(tree, some, neighbours)
    off = ((feet.points - some.points) ** 2).sum(axis=0)
    return float(np.sqrt(np.mean(off))), float(np.sqrt(np.mean(radii**2)))
