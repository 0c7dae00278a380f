"""Noise that differs from place to place: how thick its layer is, and how wide the fits are that reach across it.

Depth cameras round depths to steps, and their noise grows with distance. Narrow fits then see a single step, and take
it for a clean surface. So quadrics are fitted to as many points of thinned clouds, which reach ever farther. As their
reach grows, noise stays about the same, and detail grows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gppcs.meshing.halfedges import Floats, Ints
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.noise import MEDIAN, SAMPLES, projections
from gppcs.surface.quadrics import fit_quadrics

FINER = 4  # about the ratio of one stride to the next: fits then reach about twice as far
FITTED = 80  # points of each fit
AROUND = 16  # samples by whose median the noise at a sample is told
STEADY = 0.5  # noise is what grows by at most this power of the reach; that of detail is about 1
LEAST = 0.1  # noise that counts, in reaches of the narrowest fit
COMMON = 0.25  # a cloud is noisy if at least this share of the samples is
UNEVEN = 2.5  # least ratio of the 90 % to the 10 % quantile of uneven noise; that of even noise is about 2
FEWEST = 10_000  # points to some of which the widest fits are made: in fewer, thin parts pass for noise
ACROSS = 0.3  # a fit reaches across noise of at most this share of its reach
STEPS = 2  # projections of each point


@dataclass(frozen=True)
class UnevenNoise:
    """The noise around the points of a tree, (n,) each."""

    noise: Floats  # standard deviation of the points from the surface
    stride: Ints  # between the points of the narrowest fit that reaches across the noise

    @classmethod
    def of(cls, tree: KdTree) -> UnevenNoise | None:
        """Measure the noise around all points; return None if there is little, if it is even, or if it is detail."""
        n = tree.points.shape[1]
        strides = _strides(n)
        if not strides:
            return None
        some = tree.thinned(-(-n // SAMPLES))
        near, _ = some.neighbours(AROUND)
        measured = [_measured(tree, some, near, stride) for stride in strides]
        spreads, reaches = (np.array(part) for part in zip(*measured, strict=True))
        known, noise, number = _decided(spreads, reaches)
        if not len(known):
            return None
        nearest, _ = KdTree.build(np.ascontiguousarray(some.points.T[known])).nearest_of(tree.points.T, 1)
        return cls(noise[nearest[:, 0]], np.array(strides)[number][nearest[:, 0]])

    def projected(self, tree: KdTree) -> tuple[Floats, Floats, Floats]:
        """Return the feet, (n, 3), of the points on fits across the noise, with normals, (n, 3), and reaches, (n,)."""
        feet, normals, reaches = (
            np.ascontiguousarray(tree.points.T),
            np.empty((len(self.noise), 3)),
            np.empty_like(self.noise),
        )
        for stride in np.unique(self.stride):
            there = np.flatnonzero(self.stride == stride)
            some = tree.thinned(stride)
            for _ in range(STEPS):
                places, fitted = projections(some, KdTree.over(np.ascontiguousarray(feet[there].T)), FITTED)
                feet[there], normals[there], reaches[there] = places.T, fitted.normals.T, fitted.reaches
        return feet, normals, reaches


def _strides(n: int) -> list[int]:
    """Return the strides of fits to n points, ascending; none if these are too few.

    The widest fits reach as far, however many points there are.
    """
    widest = n / FEWEST
    if widest < FINER:
        return []
    steps = round(np.log(widest) / np.log(FINER))
    return [round(widest ** (step / steps)) for step in range(steps + 1)]


def _measured(tree: KdTree, some: KdTree, near: Ints, stride: int) -> tuple[Floats, Floats]:
    """Return the noise about fits to points of a tree, a stride apart, and the reaches of these, at some points."""
    fitted = fit_quadrics(tree.thinned(stride), some, FITTED)
    return np.median(np.abs(fitted.heights)[near], axis=1) / MEDIAN, np.median(fitted.reaches[near], axis=1)


def _decided(spreads: Floats, reaches: Floats) -> tuple[Ints, Floats, Ints]:
    """Tell uneven noise by what fits of each stride measure at some points, (strides, points) both.

    Returns the points where noise is known, the noise there, and the number of the narrowest stride that reaches across
    it; no points if there is little noise, or if it is even.
    """
    nowhere = np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.int64)
    steady = (spreads[1:] <= spreads[:-1] * (reaches[1:] / reaches[:-1]) ** STEADY) & (spreads[:-1] > 0.0)
    counted = steady & (spreads[:-1] > LEAST * reaches[0])
    if counted.mean(axis=1).max() < COMMON:
        return nowhere
    known = np.flatnonzero(steady.any(axis=0))
    seen = steady.argmax(axis=0)[known]  # the narrowest fit that sees the whole layer
    noise = spreads[seen, known]
    low, high = np.quantile(noise, [0.1, 0.9])
    if high < UNEVEN * low:
        return nowhere
    wide = reaches[:, known] >= noise / ACROSS
    wide[-1] = True
    return known, noise, np.maximum(seen, wide.argmax(axis=0))
