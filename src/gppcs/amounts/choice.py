"""Let a method choose what is asked for: a number of points, or as many as reach an accuracy, a spacing or a gap."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.accuracy import Errors, fewest_points
from gppcs.amounts.groups import choose_groups
from gppcs.amounts.guide import Guide
from gppcs.amounts.quotas import Parts
from gppcs.clouds.quantities import Amount, Scale
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.methods import Feature, Method, Selection, Task
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.farthest_points import fill_gaps
from gppcs.spatial.kdtree import KdTree, surface_area

FEWEST_WITHOUT_GAPS = 2.0 / (3.0 * math.sqrt(3.0))  # Discs of radius 1 for each unit of area, if they cover a plane.

Points = NDArray[np.float64]


def choose_amount(
    points: Points, amount: Amount, scale: Scale, guide: Guide | None, method: Method, timer: Timer
) -> Selection:
    """Let the method choose as many of some points, (N, 3), as an amount means."""
    count = amount.known_count(len(points))
    if count is not None and count >= len(points) and guide is None and amount.max_gap is None:
        return Selection(np.arange(len(points)), ranked=False)
    with timer("repeats"):
        among = _Places.of(points, guide)
    chosen = partial(among.choose, method=method, timer=timer)
    if count is not None and guide is not None:
        if guide.parts is not None or guide.groups is not None:
            return _choose_parts(count, guide, among, chosen)
        check_count(count, among.fixed + len(among.again), len(_usable(points, guide)))
    gap = None if amount.max_gap is None else scale.inside(amount.max_gap)
    if amount.tolerance is not None:
        selection, errors = fewest_points(
            among.points, scale.inside(amount.tolerance.length), amount.tolerance.measure, chosen,
            Feature.RANKING in method.supports, max(among.fixed, 1), timer,
        )  # fmt: skip
        selection = _with_errors(selection, errors, scale)
    elif amount.spacing is not None:
        selection = chosen(len(among.points), spacing=scale.inside(amount.spacing))
    elif count is not None:
        selection = chosen(count - len(among.again))
    else:
        assert gap is not None
        selection = chosen(among.fewest_without_gaps(gap))
    if among.rows is not None:
        selection = replace(selection, indices=among.rows[selection.indices])
    if among.fixed:
        selection = with_repeats(selection, among.again, among.fixed)
    if (missing := (count or 0) - len(selection.indices)) > 0:
        selection = with_others(selection, np.setdiff1d(_usable(points, guide), selection.indices)[:missing])
    return selection if gap is None else _without_gaps(points, _usable(points, guide), selection, gap, scale, timer)


def _choose_parts(count: int, guide: Guide, among: _Places, chosen: Callable[[int], Selection]) -> Selection:
    """Choose a number of points, of which each quota gets its own, or whole groups; `chosen` ranks places."""

    def ranked(wanted: int) -> Selection:
        assert among.rows is not None
        selection = chosen(wanted)
        return replace(selection, indices=among.rows[selection.indices])

    if guide.parts is not None:
        return choose_quotas(guide.parts, count, guide.keep, among.fixed, among.again, ranked)
    assert guide.groups is not None
    return choose_groups(guide.groups, int(guide.groups.max()) + 1, among.fixed, count, ranked)


def choose_quotas(
    parts: Parts,
    count: int,
    keep: NDArray[np.int64],
    fixed: int,
    again: NDArray[np.int64],
    chosen: Callable[[int], Selection],
) -> Selection:
    """Choose a number of points, of which each quota gets its own.

    `chosen` ranks a number of points, the first `fixed` of those to keep; others to keep repeat their places. Shapes:
    keep (K,), again (k,).
    """
    numbers = parts.numbers(count, keep)
    selection = replace(parts.choose(numbers - parts.count(again), fixed, chosen), ranked=False)
    if fixed:
        selection = with_repeats(selection, again, fixed)
    return with_others(selection, parts.lacking(numbers, selection.indices))


def _usable(points: Points, guide: Guide | None) -> NDArray[np.int64]:
    """Return the rows of the points that may be kept."""
    return np.arange(len(points)) if guide is None else guide.rows(len(points))


@dataclass(frozen=True, eq=False)
class _Places:
    """The places among which is chosen. The first `fixed` of them are kept.

    `rows` are those of the places, None for all points; `again` are rows to keep at the same places.
    """

    points: Points
    rows: NDArray[np.int64] | None
    fixed: int
    again: NDArray[np.int64]
    weights: NDArray[np.float64] | None
    detail: NDArray[np.float32] | None
    values: NDArray[np.float64] | None

    @classmethod
    def of(cls, points: Points, guide: Guide | None) -> _Places:
        """Return the different places of usable points, those to keep first."""
        if guide is None:
            first = first_occurrences(points)
            rows = None if first.all() else np.flatnonzero(first)
            return cls(points if rows is None else points[rows], rows, 0, np.empty(0, dtype=np.int64), None, None, None)
        keep, usable = guide.keep, guide.rows(len(points))
        rows = np.concatenate([keep, np.setdiff1d(usable, keep)]) if len(keep) else usable
        first = first_occurrences(points.take(rows, axis=0))
        among = first[: len(keep)]
        again, rows = keep[~among], rows[first]
        weights = None if guide.weights is None else guide.weights[rows]
        if weights is not None:  # those of points that are kept anyway may be 0
            weights = np.maximum(weights, weights[weights > 0.0].min())
        detail = None if guide.detail is None else guide.detail.take(rows, axis=0)
        values = None if guide.values is None else guide.values[rows]
        return cls(points.take(rows, axis=0), rows, int(among.sum()), again, weights, detail, values)

    def choose(self, wanted: int, method: Method, timer: Timer, spacing: float | None = None) -> Selection:
        """Let a method choose a number of the places, or at most so many with a spacing; all of them in their order."""
        if wanted >= len(self.points) and spacing is None:
            return Selection(np.arange(len(self.points)), ranked=False)
        return method(Task(self.points, wanted, spacing, self.fixed, self.weights, self.detail, self.values, timer))

    def fewest_without_gaps(self, gap: float) -> int:
        """Return how many points an even cover needs so that no point is farther from it than a length."""
        area = surface_area(KdTree.build(self.points))
        wanted = math.ceil(min(FEWEST_WITHOUT_GAPS * area / gap / gap, 1e18))
        return min(max(wanted, self.fixed, 1), len(self.points))


def with_repeats(selection: Selection, again: NDArray[np.int64], fixed: int) -> Selection:
    """Return a selection with other rows to keep after the first points, and tell how many are kept in all."""
    place = np.full(len(again), fixed)
    return replace(
        selection,
        indices=np.insert(selection.indices, place, again),
        diagnostics={**selection.diagnostics, "points_to_keep": float(fixed + len(again))},
        attributes={name: np.insert(values, place, 0.0) for name, values in selection.attributes.items()},
    )


def with_others(selection: Selection, rows: NDArray[np.int64]) -> Selection:
    """Return a selection with further rows behind, which the method did not choose: they repeat others."""
    return replace(
        selection,
        indices=np.concatenate([selection.indices, rows]),
        points=None if len(rows) else selection.points,
        attributes={name: np.pad(values, (0, len(rows))) for name, values in selection.attributes.items()},
    )


def _with_errors(selection: Selection, errors: Errors, scale: Scale) -> Selection:
    """Return a selection whose diagnostics also tell its errors, in the unit of the cloud."""
    found = {f"surface_{name}": scale.outside(error) for name, error in errors.by_measure.items()}
    if errors.largest is not None:
        found = {"largest_error": scale.outside(errors.largest), **found}
    if errors.set_aside:
        found["points_set_aside"] = float(errors.set_aside)
    return replace(selection, diagnostics={**selection.diagnostics, **found})


def _without_gaps(
    points: Points, usable: NDArray[np.int64], selection: Selection, gap: float, scale: Scale, timer: Timer
) -> Selection:
    """Add usable points, each the farthest from all others, until none is farther from one than a length."""
    kept = points[selection.indices] if selection.points is None else selection.points
    with timer("gaps"):
        added, reached = fill_gaps(points[usable], kept, gap)
    found = {"added_in_gaps": float(len(added)), "largest_gap": scale.outside(reached)}
    extended = with_others(selection, usable[added])
    moved = None if selection.points is None else np.concatenate([kept, points[usable[added]]])
    return replace(extended, diagnostics={**selection.diagnostics, **found}, points=moved)


def check_count(count: int, kept: int, usable: int) -> None:
    """Check that there are as many points as are asked for, and that no more are to be kept."""
    if count > usable:
        raise InputError(f"expected at least {count:,} points of a weight above 0, found {usable:,}; ask for fewer")
    if kept > count:
        raise InputError(
            f"{kept:,} points are to be kept whatever happens, but only {count:,} points are asked for; ask for at "
            f"least {kept:,}, or mark fewer points to keep"
        )
