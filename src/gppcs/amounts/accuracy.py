"""The fewest points whose local surface is as near to the original points as a tolerance says."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from gppcs.clouds.quantities import MEASURES, Measure, Scale, Tolerance
from gppcs.engine.arrays import Floats
from gppcs.engine.timer import Timer
from gppcs.methods import Selection
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.outliers import outliers_among

MINIMUM_EXPONENT, MAXIMUM_EXPONENT = 0.25, 4.0  # Bounds on the estimated exponent p in error ~ M^-p.
MAXIMUM_STEP = 100.0  # Growth of the number of points from one estimate to the next.
RESOLUTION = 1.02  # The result is at most this factor above the smallest number that reaches the tolerance.

Errors: TypeAlias = Callable[[int], dict[Measure, float]]  # of a number of points


def fewest_points(
    points: Floats,
    tolerance: Tolerance,
    scale: Scale,
    choose: Callable[[int], Selection],
    is_ranking: bool,
    minimum: int,
    timer: Timer,
) -> Selection:
    """Choose the fewest of the points, (N, 3), without repeats, whose local surface is within the tolerance.

    They are the fewest up to 2 %, and 5 % fewer points miss the tolerance; at least `minimum`. They are the first ones
    of a ranking, if `choose` ranks points; otherwise each number of points is a choice of its own. Without a measure,
    the largest distance counts, of all points but outliers.
    """
    outliers = np.zeros(len(points), dtype=np.bool_)
    if tolerance.measure is None:
        with timer("outliers"):
            outliers = outliers_among(points)
    judged = in_tree_order(points[~outliers] if outliers.any() else points)
    goal = Goal(tolerance.measure or "max", scale.inside(tolerance.length), minimum)
    search = _Search(points, judged, goal, choose, timer)
    selection, errors = search.among_prefixes() if is_ranking else search.among_numbers()
    diagnostics = {"tolerance": scale.outside(goal.tolerance)}
    if tolerance.measure is None:
        diagnostics["largest_error"] = scale.outside(errors["max"])
        if outliers.any() and errors["max"]:
            diagnostics["points_set_aside"] = float(np.count_nonzero(outliers))
            with timer("accuracy"):
                errors = errors_of(distances_to(search.positions(selection), in_tree_order(points)))
    diagnostics |= {f"surface_{measure}": scale.outside(error) for measure, error in errors.items()}
    return replace(selection, diagnostics={**selection.diagnostics, **diagnostics})


def in_tree_order(points: Floats) -> Floats:
    """Return points, (N, 3), so that neighbours follow each other: they find each other's surface in the cache."""
    return points[KdTree.build(points).order]


def distances_to(kept: Floats, points: Floats) -> Floats:
    """Return the distance, (N,), of points, (N, 3), to the local surface of others, (M, 3), which may repeat."""
    return LocalSurface.from_points(kept[first_occurrences(kept)]).nearest_to(points)[0]


def errors_of(distances: Floats) -> dict[Measure, float]:
    """Return the errors that distances, (N,), make."""
    return {
        "mean": float(distances.mean()),
        "rms": float(np.sqrt((distances**2).mean())),
        "p95": float(np.quantile(distances, 0.95)),
        "max": float(distances.max()),
    }


def _lower_bound(distances: Floats, n: int, measure: Measure) -> float:
    """Return a lower bound of the 95th percentile or maximum of n distances, given the distances of a subset."""
    rank = 1 if measure == "max" else n - math.floor(0.95 * (n - 1))
    return float(np.partition(distances, -rank)[-rank]) if rank <= len(distances) else 0.0


class Goal(NamedTuple):
    """The error that points may have, and their least number."""

    measure: Measure
    tolerance: float
    minimum: int

    def smallest(
        self, errors: Errors, maximum: int, start: float, exponent: float = 1.0
    ) -> tuple[int, dict[Measure, float]]:
        """Return the smallest number of points that reaches it, up to 2 %, and its errors; `maximum` points do.

        The search begins at `start`, and takes error ~ M^-p with about this exponent p.
        """
        errors = cache(errors)
        estimate, enough = min(max(round(start), self.minimum), maximum), maximum
        while True:
            enough = self._bracketed(errors, estimate, enough, exponent)
            estimate = math.floor(0.95 * enough)
            if estimate < self.minimum or errors(estimate)[self.measure] > self.tolerance:
                return enough, errors(enough)
            enough = estimate

    def _bracketed(self, errors: Errors, estimate: int, maximum: int, exponent: float) -> int:
        """Return a number of points that reaches it, while a little fewer miss it."""
        few, enough, steps, is_enough = self.minimum - 1, maximum, 0, True
        while enough > few + 1 and enough > RESOLUTION * few:
            error = errors(estimate)[self.measure]
            was_enough, is_enough = is_enough, error <= self.tolerance
            steps = steps + 1 if is_enough == was_enough else 1  # to one side, which grow: the error may stay for long
            step = RESOLUTION**2.0 ** max(0, steps - 2)
            crossing = _crossing(estimate, error, self.tolerance, exponent) * RESOLUTION**0.15
            if is_enough:
                enough, estimate = estimate, math.ceil(min(estimate / step, crossing))
            else:
                few, estimate = estimate, math.floor(max(estimate * step, crossing))
            lower, upper = few + 1, enough - 1
            if few >= self.minimum and enough < maximum:  # bracketed: not too near the ends
                lower, upper = (round(few * (enough / few) ** fraction) for fraction in (0.2, 0.8))
            estimate = min(max(estimate, lower, few + 1), upper, enough - 1)
        return enough


@dataclass
class _Search:
    """Search for the smallest number of points whose local surface lies within the tolerance of the original."""

    points: Floats  # (N, 3), among which is chosen
    judged: Floats  # whose distances count
    goal: Goal
    choose: Callable[[int], Selection]
    timer: Timer
    farthest: Floats | None = None  # of the judged points, at the last exact measurement: mostly farthest again

    @cached_property
    def sample(self) -> Floats:
        """At most 20,000 of the judged points at random, from which an error is estimated."""
        if len(self.judged) <= 20_000:
            return self.judged
        indices = np.random.default_rng(0).choice(len(self.judged), 20_000, replace=False, shuffle=False)
        return self.judged[np.sort(indices)]

    def positions(self, selection: Selection) -> Floats:
        """Return the positions of the chosen points, (M, 3)."""
        return self.points[selection.indices] if selection.points is None else selection.points

    def errors(self, kept: Floats) -> dict[Measure, float]:
        """Return the errors of a choice; only a lower bound of one of them if that misses the tolerance already."""
        n = len(self.judged)
        with self.timer("accuracy"):
            if self.farthest is not None:
                error = _lower_bound(distances_to(kept, self.farthest), n, self.goal.measure)
                if error > self.goal.tolerance:
                    return {self.goal.measure: error}
            distances = distances_to(kept, self.judged)
            if self.goal.measure in ("p95", "max"):
                nearer = int(0.85 * n)  # the 95th percentile needs the farthest 5 %, here with a margin
                self.farthest = self.judged[np.sort(np.argpartition(distances, nearer)[nearer:])]
            return errors_of(distances)

    def estimated_error(self, kept: Floats) -> float:
        """Return the error at the sample."""
        if not len(kept):
            return math.inf
        with self.timer("accuracy"):
            return errors_of(distances_to(kept, self.sample))[self.goal.measure]

    def among_prefixes(self) -> tuple[Selection, dict[Measure, float]]:
        """Search among the first points of a ranking, which is made longer until it suffices."""
        n = len(self.points)
        count = judged = max(min(1000, n - 1), self.goal.minimum)
        previous, previous_error = 0, math.inf
        lower = 0.7  # of the exponent: estimates from few points are unreliable, so the first bound is tighter
        while 0 < count < n:
            ranking = self.choose(count)
            positions = self.positions(ranking)
            error = self.estimated_error(positions[:judged])
            if math.isinf(previous_error):
                previous = judged // 2
                previous_error = self.estimated_error(positions[:previous])
            exponent = _exponent(previous, previous_error, judged, error, lower)
            estimate = _crossing(judged, error, self.goal.tolerance, exponent)
            if estimate <= 0.97 * count or count == n - 1:  # long enough, with a margin
                enough, errors = self.goal.smallest(
                    lambda m: self.errors(positions[:m]),  # noqa: B023
                    count,
                    estimate,
                    exponent,
                )
                if errors[self.goal.measure] <= self.goal.tolerance:
                    return ranking.arranged(ranking.indices[:enough]), errors
            previous, previous_error, lower = judged, error, MINIMUM_EXPONENT
            judged = min(max(round(estimate), count), n - 1)
            spare = 1.2  # longer than estimated, as a ranking that is too short costs another one
            count = n if count == n - 1 else min(math.ceil(spare * judged), n - 1)
        return self.choose(n), dict.fromkeys(MEASURES, 0.0)

    def among_numbers(self) -> tuple[Selection, dict[Measure, float]]:
        """Search among choices of all numbers of points."""
        choose = cache(self.choose)
        enough, errors = self.goal.smallest(lambda m: self.errors(self.positions(choose(m))), len(self.points), 1000)
        return choose(enough), errors


def _crossing(count: int, error: float, tolerance: float, exponent: float) -> float:
    """Return the number of points where the error would be the tolerance, given that of another number."""
    if error == 0.0:
        return count / MAXIMUM_STEP
    return count * min(max((error / tolerance) ** (1.0 / exponent), 1.0 / MAXIMUM_STEP), MAXIMUM_STEP)


def _exponent(few: int, error_of_few: float, many: int, error: float, lower: float) -> float:
    """Estimate p in error ~ M^-p from two numbers of points; 1 if these are the same or the errors do not fall."""
    if few == many or not 0.0 < error < error_of_few < math.inf:
        return 1.0
    return min(max(math.log(error_of_few / error) / math.log(many / few), lower), MAXIMUM_EXPONENT)
