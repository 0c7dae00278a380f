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
from gppcs.surface.noise import SAMPLES, projections
from gppcs.surface.quadrics import fit_quadrics

STRIDES = 1, 4, 16, 64  # fits are made to every 1st, 4th and so on point: each time, they reach about twice as far
FITTED = 80  # points of each fit
AROUND = 16  # samples by whose median the noise at a sample is told
STEADY = 2.0**0.5  # noise is what a fit of twice the reach raises by at most this factor; detail about doubles
LEAST = 0.1  # noise that counts, in reaches of the narrowest fit
COMMON = 0.25  # share of the samples with noise from which on a cloud has noise
UNEVEN = 2.5  # times the noise that a tenth lies below, for a tenth above: that of even noise is about 2
FEWEST = 10_000  # points of the wider fits by which noise is told: in fewer, thin parts pass for it
ACROSS = 0.3  # a fit reaches across noise of at most this share of its reach
STEPS = 2  # projections of each point
NORMAL = 0.6745  # median of the absolute value of standard normal numbers


@dataclass(frozen=True)
class Layers:
    """The layers of noise around the points of a tree, (n,) each."""

    noise: Floats  # standard deviation of the points from the surface
    width: Ints  # number of the stride of the narrowest fit that reaches across the noise

    @classmethod
    def of(cls, tree: KdTree) -> Layers | None:
        """Measure the noise around all points; return None if there is little, if it is even, or if it is detail."""
        n = tree.points.shape[1]
        some = KdTree.over(np.ascontiguousarray(tree.points[:, :: -(-n // SAMPLES)]))
        strides = [stride for stride in STRIDES if n >= FEWEST * stride]
        if len(strides) < 2:
            return None
        near, _ = some.neighbours(AROUND)
        spreads, reaches = (
            np.array(part) for part in zip(*(_layer(tree, some, near, s) for s in strides), strict=True)
        )
        steady = (spreads[1:] <= STEADY * spreads[:-1]) & (spreads[:-1] > 0.0)
        counted = steady & (spreads[:-1] > LEAST * reaches[0])
        if counted.mean(axis=1).max() < COMMON:
            return None
        known = steady.any(axis=0)
        seen = steady.argmax(axis=0)[known]  # the narrowest fit that sees the whole layer
        noise, reaches = spreads[:, known][seen, np.arange(len(seen))], reaches[:, known]
        low, high = np.quantile(noise, [0.1, 0.9])
        if high < UNEVEN * low:
            return None
        wide = reaches >= noise / ACROSS
        wide[-1] = True
        width = np.maximum(seen, wide.argmax(axis=0))
        nearest, _ = KdTree.build(np.ascontiguousarray(some.points.T[known])).nearest_of(tree.points.T, 1)
        return cls(noise[nearest[:, 0]], width[nearest[:, 0]])

    def projected(self, tree: KdTree) -> tuple[Floats, Floats, Floats]:
        """Return the feet, (n, 3), of the points on fits across the noise, with normals, (n, 3), and reaches, (n,)."""
        feet, normals, reaches = np.ascontiguousarray(tree.points.T), np.empty((len(self.width), 3)), self.noise.copy()
        for number, stride in enumerate(STRIDES):
            there = np.flatnonzero(self.width == number)
            if not len(there):
                continue
            fitted_to = tree if stride == 1 else KdTree.over(np.ascontiguousarray(tree.points[:, ::stride]))
            for _ in range(STEPS):
                places, fitted = projections(fitted_to, KdTree.over(np.ascontiguousarray(feet[there].T)), FITTED)
                feet[there], normals[there], reaches[there] = places.T, fitted.normals.T, fitted.reaches
        return feet, normals, reaches


def _layer(tree: KdTree, some: KdTree, near: Ints, stride: int) -> tuple[Floats, Floats]:
    """Return the noise about fits to points of a tree, a stride apart, and the reaches of these, at some points."""
    thinned = tree if stride == 1 else KdTree.over(np.ascontiguousarray(tree.points[:, ::stride]))
    fitted = fit_quadrics(thinned, some, FITTED)
    return np.median(np.abs(fitted.heights)[near], axis=1) / NORMAL, np.median(fitted.reaches[near], axis=1)
