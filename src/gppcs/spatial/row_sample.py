"""Random samples of points that come in chunks. They depend on nothing but the number of a row, or its place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

HASHES = float(2**64)


def row_hashes(rows: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return a random number for each row (SplitMix64; Steele, Lea and Flood 2014).

    Parameters
    ----------
    rows : (n,) array, int64

    Returns
    -------
    (n,) array, uint64
    """
    return _mixed(rows.astype(np.uint64))


def place_hashes(points: NDArray[np.float64], seed: int = 0) -> NDArray[np.uint64]:
    """Return a random number for each place.

    Parameters
    ----------
    points : (n, 3) array, float64
        No coordinate is a negative zero.
    seed : int
        Not negative.

    Returns
    -------
    (n,) array, uint64
        The same for equal points.
    """
    mixed = np.full(len(points), np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])
    for bits in np.ascontiguousarray(points.T).view(np.uint64):
        mixed = _mixed(mixed ^ bits)
    return mixed


def _mixed(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    mixed = (values + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def drawn(rows: NDArray[np.int64], share: float) -> NDArray[np.bool_]:
    """Mark the rows of a random sample.

    Parameters
    ----------
    rows : (n,) array, int64
    share : float
        The probability of each row.

    Returns
    -------
    (n,) array, bool
    """
    return row_hashes(rows) < share * HASHES if share < 1.0 else np.ones(len(rows), dtype=np.bool_)


class PlaceSample:
    """A random sample of the places of points that come in chunks: those with the smallest hashes.

    Parameters
    ----------
    size : int
        Number of places; all if there are fewer.
    seed : int
        Not negative.
    """

    def __init__(self, size: int, seed: int) -> None:
        self._size, self._seed = size, seed
        self._hashes, self._rows = np.empty(0, dtype=np.uint64), np.empty(0, dtype=np.int64)
        self._seen = 0

    def add(self, points: NDArray[np.float64]) -> None:
        """Take the next points into account.

        Parameters
        ----------
        points : (n, 3) array
        """
        hashes, rows = place_hashes(points, self._seed), np.arange(self._seen, self._seen + len(points))
        self._seen += len(points)
        if len(self._hashes) == self._size:
            few = np.flatnonzero(hashes < self._hashes[-1])
            hashes, rows = hashes[few], rows[few]
        hashes, first = np.unique(np.concatenate([self._hashes, hashes]), return_index=True)
        self._hashes, self._rows = hashes[: self._size], np.concatenate([self._rows, rows])[first[: self._size]]

    @property
    def rows(self) -> NDArray[np.int64]:
        """The row of the first point at each place of the sample, in an order that is as random."""
        return self._rows
