"""The fewest points whose local surface is as near to the original as somebody asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.quantities import MEASURES, Measure
from gppcs.engine.timer import Timer
from gppcs.methods import Selection

if TYPE_CHECKING:
    from gppcs.surface.local_surface import LocalSurface

FIRST = 1000  # Points of the first ranking, by which the number of points is guessed.
SPARE = 1.2  # Points of a ranking for each one that the guess says. A ranking that is too short costs another one.
GROWTH = 100.0  # From one ranking to the next at most.
SOME = 20_000  # Original points from which a guess is measured.
FARTHEST = 0.15  # Share of the original points that may tell that a tolerance is missed. A 95th percentile takes 0.05.
FALL = 1.0  # Errors fall about as the number of points to this power, where two of them do not tell.
# The least and greatest power that two errors may tell. Those of few points tell little of those of many.
FLATTEST, FLATTEST_AT_FIRST, STEEPEST = 0.25, 0.7, 4.0
CLOSE = 1.02  # The fewest points are found up to this factor, and one point.
SURE = 0.97  # A ranking is long enough if the guessed number is at most this share of its points.
FEWER = 0.95  # So few points miss the tolerance.

Points = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Original:
    """The original points, from which errors are measured as `gppcs.evaluate` does."""

    # (N, 3): Each counts. In coordinates of about unit size, and in an order in which neighbours follow each other: so
    # they find each other's surroundings in the cache.
    points: Points

    @classmethod
    def of(cls, points: Points) -> Original:
        """Put points, (N, 3), into such an order."""
        from gppcs.spatial.kdtree import KdTree

        return cls(points[KdTree.build(points).order])

    def some(self) -> Original:
        """Return about `SOME` of the points, at random."""
        if len(self.points) <= SOME:
            return self
        rows = np.random.default_rng(0).choice(len(self.points), SOME, replace=False, shuffle=False)
        return Original(self.points[np.sort(rows)])

    def errors(self, kept: Points) -> dict[Measure, float]:
        """Return the distances from the points to the local surface of others. Shapes: kept (M, 3)."""
        return _errors_of(self.distances(surface_of(kept)))

    def distances(self, surface: LocalSurface) -> NDArray[np.float64]:
        """Return the distance of each point to a local surface. Shapes: returns (N,)."""
        return surface.nearest_to(self.points)[0]

    def farthest(self, distances: NDArray[np.float64]) -> Original:
        """Return the points of the largest distances, a share `FARTHEST` of them. Shapes: distances (N,)."""
        n = len(self.points)
        nearer = int((1.0 - FARTHEST) * n)
        return Original(self.points[np.sort(np.argpartition(distances, nearer)[nearer:])])


def surface_of(kept: Points) -> LocalSurface:
    """Return the local surface of places, (M, 3), which may repeat each other."""
    from gppcs.spatial.cells import first_occurrences
    from gppcs.surface.local_surface import LocalSurface

    return LocalSurface.of(kept[first_occurrences(kept)])


def _errors_of(distances: NDArray[np.float64]) -> dict[Measure, float]:
    return {
        "mean": float(distances.mean()),
        "rms": float(np.sqrt((distances**2).mean())),
        "p95": float(np.quantile(distances, 0.95)),
        "max": float(distances.max()),
    }


def _error_at_least(some: NDArray[np.float64], n: int, measure: Measure) -> float:
    """Return what the 95th percentile or the largest of n distances is at least, given some of them."""
    rank = 1 if measure == "max" else n - math.floor(0.95 * (n - 1))
    return float(np.partition(some, -rank)[-rank]) if rank <= len(some) else 0.0


@dataclass(frozen=True)
class Errors:
    """The errors of all points by measure; `largest` is that of all but those set aside, if it was asked for."""

    by_measure: Mapping[Measure, float]
    largest: float | None = None
    set_aside: int = 0


def fewest_points(
    points: Points,
    tolerance: float,
    measure: Measure | None,
    choose: Callable[[int], Selection],
    ranks: bool,
    least: int,
    timer: Timer,
) -> tuple[Selection, Errors]:
    """Choose the fewest of at least `least` points, (N, 3), without repeats, whose local surface is near enough.

    They are the fewest up to 2 %, and 5 % fewer points miss the tolerance. They are the first ones of a ranking, if the
    method ranks its points; otherwise each number of points is a choice of its own. Without a measure, the largest
    distance counts, of all points but outliers.
    """
    from gppcs.surface.outliers import outliers_among

    aside = np.zeros(len(points), dtype=np.bool_)
    if measure is None:
        with timer("outliers"):
            aside = outliers_among(points)
    counted = Original.of(points[~aside] if aside.any() else points)
    search = _Search(points, counted, counted.some(), tolerance, measure or "max", choose, least, timer)
    selection, errors = search.ranked() if ranks else search.unranked()
    if measure is not None:
        return selection, Errors(errors)
    largest, count = errors["max"], int(np.count_nonzero(aside))
    if count and largest:
        with timer("accuracy"):
            errors = Original.of(points).errors(search.places(selection))
    return selection, Errors(errors, largest, count)


@dataclass
class _Search:
    """The search for the fewest points, of which the local surface misses the original by at most a tolerance."""

    points: Points  # (N, 3), among which is chosen
    whole: Original  # The points whose distances count
    some: Original  # Some of these, from which a guess is measured
    tolerance: float
    measure: Measure
    choose: Callable[[int], Selection]
    least: int  # Points that are chosen at least
    timer: Timer
    farthest: Original | None = None  # Points of the whole that may tell that a tolerance is missed

    def places(self, selection: Selection) -> Points:
        """Return the places of the chosen points, (M, 3)."""
        return self.points[selection.indices] if selection.points is None else selection.points

    def judged(self, kept: Points) -> dict[Measure, float]:
        """Judge first by the points that were farthest from other places: they are mostly so again."""
        with self.timer("accuracy"):
            surface = surface_of(kept)
            if self.farthest is not None:
                error = _error_at_least(self.farthest.distances(surface), len(self.whole.points), self.measure)
                if error > self.tolerance:
                    return {self.measure: error}
            distances = self.whole.distances(surface)
            if self.measure in ("p95", "max"):
                self.farthest = self.whole.farthest(distances)
            return _errors_of(distances)

    def ranked(self) -> tuple[Selection, dict[Measure, float]]:
        """Search among the first points of a ranking that is long enough."""
        n, most = len(self.points), len(self.points) - 1
        count = judged = max(min(FIRST, most), self.least)
        before, error_before, flattest = 0, math.inf, FLATTEST_AT_FIRST
        while 0 < count <= most:
            ranking = self.choose(count)
            places = self.places(ranking)
            error = self._guessed(places[:judged])
            if math.isinf(error_before):
                before = judged // 2
                error_before = self._guessed(places[:before])
            power = _power(before, error_before, judged, error, flattest)
            guess = self._crossing(judged, error, power)
            if guess <= SURE * count or count == most:
                enough, errors = self._fewest(lambda m, places=places: places[:m], guess, count, power)  # type: ignore[misc]
                if errors[self.measure] <= self.tolerance:
                    return _first_of(ranking, enough), errors
            before, error_before, flattest = judged, error, FLATTEST
            judged = min(max(round(guess), count), most)
            count = n if count == most else min(math.ceil(SPARE * judged), most)
        return self.choose(n), dict.fromkeys(MEASURES, 0.0)

    def unranked(self) -> tuple[Selection, dict[Measure, float]]:
        """Search among the choices of all numbers."""
        known: dict[int, Selection] = {}

        def places(m: int) -> Points:
            if m not in known:
                known[m] = self.choose(m)
            return self.places(known[m])

        enough, errors = self._fewest(places, FIRST, len(self.points), FALL)
        return known[enough], errors

    def _fewest(
        self, places: Callable[[int], Points], begin: float, most: int, power: float
    ) -> tuple[int, dict[Measure, float]]:
        """Return the fewest points that reach the tolerance, if `most` do, and their errors; begin the search there."""
        known: dict[int, dict[Measure, float]] = {}

        def error(m: int) -> float:
            if m not in known:
                known[m] = self.judged(places(m))
            return known[m][self.measure]

        guess, enough = min(max(round(begin), self.least), most), most
        while True:
            enough = self._bracketed(error, guess, enough, power)
            guess = math.floor(FEWER * enough)
            if guess < self.least or error(guess) > self.tolerance:
                error(enough)
                return enough, known[enough]
            enough = guess

    def _bracketed(self, error: Callable[[int], float], guess: int, most: int, power: float) -> int:
        """Return a number of points that reaches the tolerance, while a little fewer (`CLOSE`) miss it.

        The search begins at a guess; `most` points are known to reach the tolerance. Each next number is a step from
        the last one, to the other side of where the error should cross the tolerance, or close to there. Steps to the
        same side grow, as the error may stay as it is for long.
        """
        few, enough, run, side = self.least - 1, most, 0, True
        while enough > few + 1 and enough > CLOSE * few:
            found = error(guess)
            side, before = found <= self.tolerance, side
            run = run + 1 if side == before else 1
            step, crossing = CLOSE**2.0 ** max(0, run - 2), self._crossing(guess, found, power) * CLOSE**0.15
            if side:
                enough, guess = guess, math.ceil(min(guess / step, crossing))
            else:
                few, guess = guess, math.floor(max(guess * step, crossing))
            least, largest = few + 1, enough - 1
            if few >= self.least and enough < most:  # go on inside, not too near the ends
                least, largest = (round(few * (enough / few) ** share) for share in (0.2, 0.8))
            guess = min(max(guess, least, few + 1), largest, enough - 1)
        return enough

    def _crossing(self, count: int, error: float, power: float) -> float:
        """Return the number of points where the error would be the tolerance, given that of another number."""
        if error == 0.0:
            return count / GROWTH
        return count * min(max((error / self.tolerance) ** (1.0 / power), 1.0 / GROWTH), GROWTH)

    def _guessed(self, kept: Points) -> float:
        """Return about how large the error of some places is."""
        if not len(kept):
            return math.inf
        with self.timer("accuracy"):
            return self.some.errors(kept)[self.measure]


def _first_of(ranking: Selection, count: int) -> Selection:
    """Return the first points of a ranking."""
    return replace(
        ranking,
        indices=ranking.indices[:count],
        points=None if ranking.points is None else ranking.points[:count],
        attributes={name: values[:count] for name, values in ranking.attributes.items()},
    )


def _power(few: int, error_of_few: float, many: int, error: float, flattest: float) -> float:
    """Return the power of the number of points with which errors fall, from those of two numbers."""
    if not 0.0 < error < error_of_few < math.inf:
        return FALL
    return min(max(math.log(error_of_few / error) / math.log(many / few), flattest), STEEPEST)
