"""Random samples of points that come in chunks. They depend on nothing but the number of a row, or its place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.boxes import Part
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import squared_reaches
from gppcs.spatial.stored import StoredPoints

HASHES = float(2**64)
WIDE = 0.99  # the share of the points of a part whose neighbours lie within the width of its halo


def place_hashes(points: NDArray[np.float64], seed: int = 0) -> NDArray[np.uint64]:
    """Return a random number for each place. Shapes: points (n, 3); returns (n,)."""
    mixed = np.full(len(points), np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])
    for bits in np.ascontiguousarray(points.T).view(np.uint64):
        mixed = hashes(mixed ^ bits)
    return mixed


def hashes(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a random number for each value, (n,) (SplitMix64; Steele, Lea and Flood 2014)."""
    mixed = (values + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def drawn(rows: NDArray[np.int64], share: float) -> NDArray[np.bool_]:
    """Mark the rows of a random sample. Shapes: rows (n,); returns (n,)."""
    return hashes(rows.astype(np.uint64)) < share * HASHES if share < 1.0 else np.ones(len(rows), dtype=np.bool_)


def smallest_numbers(
    stored: StoredPoints, count: int, seed: int, even: bool, part: Part
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the smallest exponential random numbers of a part, over areas if even, and the rows."""
    near = stored.near(part)
    if even:
        near = stored.near(part, float(np.sqrt(np.quantile(squared_reaches(KdTree.build(near.points)), WIDE))))
    numbers = -np.log((place_hashes(near.points, seed) + 0.5) / HASHES)
    if even:
        numbers /= squared_reaches(KdTree.build(near.points))
    inside = np.flatnonzero(near.inside)
    order = inside[np.argsort(numbers[inside], kind="stable")[:count]]
    return numbers[order], near.rows[order]
