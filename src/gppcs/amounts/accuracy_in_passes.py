"""The fewest points that reach an accuracy, of a cloud that need not fit into memory."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.accuracy import SOME, Measure, Original, Points, Search, surface_of
from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.methods import Selection
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.exact_sums import exact_sum, mean_of

if TYPE_CHECKING:
    from gppcs.surface.local_surface import LocalSurface

# Shares of the distances that are not held, where the 95th percentile is looked for. The first should do.
NEAR = (0.94, 0.8, 0.0)


def fewest_points_in_passes(
    points: ChunkedPoints,
    tolerance: float,
    measure: Measure,
    choose: Callable[[int], Selection],
    least: int,
    most: int,
    stages: Stages,
    journal: Journal,
) -> tuple[Selection, dict[Measure, float]]:
    """Choose as `fewest_points` the first points of a ranking. Each number of first points is judged by a pass.

    They need not be as many as in memory, where another sample tells the guess that the search begins with.

    Parameters
    ----------
    points : ChunkedPoints
        N finite points of about unit size. If they repeat each other, each counts.
    tolerance : float
        Above 0.
    measure : str
        Which error is meant.
    choose : callable
        Lets the method rank a number of them.
    least : int
        The fewest points that may be chosen, from 1 to N.
    most : int
        The most points that can be ranked.
    stages : Stages
        Times the stages of the method, and "accuracy". A step of the latter is a point read.
    journal : Journal
        Keeps what passes have found.

    Returns
    -------
    selection : Selection
        M points.
    errors : dict of str to float
        Of these points, by measure. They do not depend on the chunks.

    Raises
    ------
    InputError
        If `most` points miss the tolerance, or more have to be chosen.
    """
    rows = np.unique(np.random.default_rng(0).integers(0, len(points), SOME))

    def read() -> Original:
        with stages("accuracy", len(points)) as advanced:
            return Original.of(points.take(rows, advanced))

    some = journal.once("sample of the original", read)
    judge = _ChunkJudge(points, some, stages, journal)
    return Search(judge, some, len(points), tolerance, measure, choose, least, most, stages).ranked()


class _ChunkJudge:
    """Judges by points that come in chunks. A sample of them tells which distances are large."""

    def __init__(self, points: ChunkedPoints, some: Original, stages: Stages, journal: Journal) -> None:
        self._points, self._some, self._stages, self._journal = points, some, stages, journal

    def places(self, selection: Selection) -> Points:
        if selection.points is not None:
            return selection.points

        def read() -> Points:
            with self._stages("accuracy", len(self._points)) as advanced:
                return self._points.at(selection.indices, advanced)

        return self._journal.once(f"places {_digest(selection.indices)}", read)

    def judged(self, kept: Points) -> dict[Measure, float]:
        return self._journal.once(f"errors {_digest(kept)}", lambda: self._measure(kept))

    def _measure(self, kept: Points) -> dict[Measure, float]:
        with self._stages("accuracy"):
            surface = surface_of(kept)
            of_some = self._some.distances(surface)
        for share in NEAR:
            far = float(np.quantile(of_some, share)) if share else 0.0
            with self._stages("accuracy", len(self._points)) as advanced:
                found = list(self._points.each(partial(_measured, surface, far), advanced))
            farther = np.concatenate([each.farther for each in found])
            n = len(self._points)
            lacking = max(0, n - _rank(n) - len(farther))
            if sum(each.ties for each in found) >= lacking:
                break
        distances = np.concatenate([np.full(lacking, far), farther])
        return {
            "mean": mean_of(sum(each.total for each in found), n),
            "rms": math.sqrt(mean_of(sum(each.squares for each in found), n)),
            "p95": _percentile(distances, n),
            "max": float(distances.max()),
        }


def _digest(values: NDArray[Any]) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()[:16]


class _Measured(NamedTuple):
    """What is known of the distances of a chunk: exact sums of them and of their squares, and the largest ones.

    Distances that equal the least one that counts are only counted, as on a plane they can be many.
    """

    total: int
    squares: int
    ties: int
    farther: NDArray[np.float64]


def _measured(surface: LocalSurface, far: float, first: int, chunk: NDArray[np.float64]) -> _Measured:
    """Measure the points of a chunk; return the distances above `far`, and how many are equal to it."""
    distances = surface.nearest_to(chunk)[0]
    ties = int((distances == far).sum())
    return _Measured(exact_sum(distances), exact_sum(distances**2), ties, distances[distances > far])


def _rank(n: int) -> int:
    """Return how many of n distances are below those between which the 95th percentile lies."""
    return math.floor(0.95 * (n - 1))


def _percentile(largest: NDArray[np.float64], n: int) -> float:
    """Return the 95th percentile of n distances, given the largest of them, as `np.quantile` does."""
    rank = _rank(n)
    low = len(largest) - (n - rank)
    between = np.partition(largest, [low, min(low + 1, len(largest) - 1)])[low : low + 2]
    return float(np.quantile(between, 0.95 * (n - 1) - rank))
