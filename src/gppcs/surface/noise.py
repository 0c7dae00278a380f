"""How far points lie off the surface that their neighbours make out, and where on it they belong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree
from gppcs.surface.quadrics import fit_quadrics

FEWEST, MOST = 12, 40  # points that a quadric is fitted to: with fewer it goes through them, noise and all
WIDE = 80  # in place of the most where noise is thick
THICK = 0.3  # level of the noise, in radii of the neighbourhoods, from which on these must grow
SAMPLES = 4096  # points by which the level of the noise is judged
TOLERATED = 0.5  # of the target spacing: noise of that size makes an observation as uncertain as the field's prior
LARGEST = 2.0  # variance of an observation, in units of the field's prior: no point counts for less
QUIET = 0.04  # of the target spacing: a level of noise that changes no choice worth the time


@dataclass(frozen=True)
class Noise:
    """How far points lie off the surface, by the quadrics fitted to those around them.

    Attributes
    ----------
    tree : KdTree
        Over the points that quadrics are fitted to.
    neighbours : int
        How many each is fitted to.
    level : float
        The root of the mean squared distance of some points from the surface, in their unit; 0 where it cannot be told.
    spacing : float
        The target spacing.
    detail : bool
        Whether what lies off the quadrics is detail more than noise: its share of the neighbourhoods' radius rises with
        that, where the share of noise falls.
    """

    tree: KdTree
    neighbours: int
    level: float
    spacing: float
    detail: bool = False

    @classmethod
    def measure(cls, tree: KdTree, n_points: int, spacing: float) -> Noise:
        """Measure the noise where M points are to be chosen.

        A quadric is fitted to as many points as there are on average within the target spacing: beyond, detail that is
        to be kept would pass for noise. Fewer will do, unless they lie within the noise rather than across it.
        """
        count = len(tree.order)
        within = int(np.pi * count / n_points)
        neighbours = min(MOST, within)
        if neighbours < FEWEST:
            return cls(tree, neighbours, 0.0, spacing)
        first, radius = level_and_radius(tree, neighbours, 1)
        if first <= QUIET * spacing:
            return cls(tree, neighbours, first, spacing)
        level, wide = level_and_radius(tree, neighbours, 2)
        if level > THICK * wide:
            neighbours = min(WIDE, within)
            return cls(tree, neighbours, level_and_radius(tree, neighbours, 2)[0], spacing)
        fewer, narrow = level_and_radius(tree, neighbours // 2, 1)
        if first * narrow > fewer * radius:
            return cls(tree, neighbours, first, spacing, detail=True)
        return cls(tree, neighbours, level, spacing)

    @property
    def quiet(self) -> bool:
        """Whether there is none to speak of: it is small, or too few points lie near each other to tell."""
        return self.level <= QUIET * self.spacing

    def seen(self, places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where on the surface some points, (n, 3), belong, and the variance of the observation at each.

        Times 1 / h^2, variances are in units of the field's prior at spacing h. They end at `LARGEST` at the target
        spacing, lest lone points be left out.
        """
        if self.quiet:
            return places, np.zeros(len(places))
        feet, _ = projections(self.tree, places, self.neighbours, 1 if self.detail else 2)
        squared = ((feet - places) ** 2).sum(axis=1)
        largest = 1.0 if self.detail else LARGEST
        return (places if self.detail else feet), np.minimum(squared / TOLERATED**2, largest * self.spacing**2)


def projections(
    tree: KdTree, places: NDArray[np.float64], neighbours: int, steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the feet of places, (n, 3), on the quadrics fitted to the points around them, and the radii of these.

    The second step fits anew around the first's foot: a ball around a place off the surface holds too many points that
    are displaced alike.
    """
    feet = places
    for _ in range(steps):
        quadrics = fit_quadrics(tree, feet, neighbours)
        rise = np.clip(quadrics.heights, -quadrics.reaches, quadrics.reaches)
        feet = feet + rise[:, None] * quadrics.normals
    return feet, quadrics.reaches


def level_and_radius(tree: KdTree, neighbours: int, steps: int) -> tuple[float, float]:
    """Return the root mean squares of the distance of a tree's points from the surface and of their balls' radii.

    Some points, evenly spread over the tree, stand for all.
    """
    some = tree.points.T[:: -(-len(tree.order) // SAMPLES)]
    feet, radii = projections(tree, some, neighbours, steps)
    return float(np.sqrt(np.mean(((feet - some) ** 2).sum(axis=1)))), float(np.sqrt(np.mean(radii**2)))
