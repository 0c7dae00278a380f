"""Let a method choose what is asked for: a number of points, or as many as reach an accuracy, a spacing or a gap."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.accuracy import Measure, fewest_points
from gppcs.amounts.amount import Amount
from gppcs.amounts.guide import Guide
from gppcs.clouds.lengths import Length
from gppcs.engine.stages import Stages
from gppcs.errors import InputError
from gppcs.methods import Method, Selection

if TYPE_CHECKING:
    from gppcs.spatial.chunks import ChunkedPoints, ChunkedValues, Places

FEWEST_WITHOUT_GAPS = 2.0 / (3.0 * math.sqrt(3.0))  # Discs of radius 1 for each unit of area, if they cover a plane.
SHORTEST, LONGEST = 1e-100, 1e100  # Lengths in sizes of the cloud: squares of others would vanish or overflow.

Points = NDArray[np.float64]


def choose(points: ChunkedPoints, count: int, method: Method, stages: Stages, *, repeats: bool = True) -> Selection:
    """Let the method choose among the points without repeats; add repeats only if there are too few others.

    Parameters
    ----------
    points : ChunkedPoints
        N finite points.
    count : int
        M, from 1 to N.
    method : Method
    stages : Stages
        Times the stages of the method, and "repeats".
    repeats : bool
        Whether to add repeats. Otherwise there may be fewer than M points.

    Returns
    -------
    Selection
        M points. All N are in their order.
    """
    from gppcs.spatial.chunks import first_repeats

    if count >= len(points) and repeats:
        return Selection(np.arange(len(points)), ranked=False)
    selection = method.in_passes(points, count, stages) if count < len(points) else None
    if selection is not None:
        return selection
    with stages("repeats", len(points)) as advanced:
        distinct = points.distinct(advanced)
    if len(distinct.rows) <= count and not repeats:
        return Selection(distinct.rows, ranked=False)
    if len(distinct.rows) <= count:
        return Selection(np.concatenate([distinct.rows, first_repeats(distinct.rows, count)]), ranked=False)
    if len(distinct.rows) == len(points):
        places = distinct.points
        del distinct  # to free the memory of its rows
        return method(places, count, stages)
    selection = method(distinct.points, count, stages)
    return dataclasses.replace(selection, indices=distinct.rows[selection.indices])


def choose_guided(
    points: ChunkedPoints,
    count: int,
    to_keep: Places,
    weights: ChunkedValues | None,
    method: Method,
    stages: Stages,
    *,
    repeats: bool = True,
) -> Selection:
    """Let the method choose points of which some are given, or with a density multiplied by weights.

    Parameters
    ----------
    points : ChunkedPoints
        N finite points.
    count : int
        M, at least 1.
    to_keep : Places
        Some of the points.
    weights : ChunkedValues or None
        One for each point, as shares of the largest one. Above 0, but for points to keep.
    method : Method
    stages : Stages
        Times the stages of the method.
    repeats : bool
        Whether to add repeats where there are too few different places. Otherwise there may be fewer than M points.

    Returns
    -------
    Selection
        M points: first those to keep that repeat no earlier one of them, then those that do, then the others.

    Raises
    ------
    InputError
        If more than M are to be kept, or there are fewer than M points.
    """
    from gppcs.spatial.cells import first_occurrences

    _check_to_keep(len(to_keep.rows), count)
    _check_weighted(len(points), count)
    first = first_occurrences(to_keep.points)
    fixed, again = to_keep.take(np.flatnonzero(first)), to_keep.rows[~first]
    selection = None
    if count < len(points):
        selection = method.guided_in_passes(points, count - len(again), fixed, weights, stages)
    if selection is None:
        asked = _Asked.of(points, to_keep, weights, method, stages)
        return asked.with_repeats(asked.of_number(count), count if repeats else 0)
    return _with_repeats(selection, again, len(fixed.rows))


def fewest_without_gaps(area: float, gap: float, kept: int, n: int) -> int:
    """Return how many points an even cover needs so that no point is farther from it than a length.

    Parameters
    ----------
    area : float
        Of the surface.
    gap : float
        The length.
    kept : int
        So many points at least.
    n : int
        N, the number of points.

    Returns
    -------
    int
        From 1 to N.
    """
    wanted = math.ceil(min(FEWEST_WITHOUT_GAPS * area / gap / gap, 1e18))
    return min(max(wanted, kept, 1), n)


def without_gaps(points: ChunkedPoints, selection: Selection, gap: Length, scale: Scale, stages: Stages) -> Selection:
    """Add points, each the farthest from all others, until no point is farther from one than a length.

    Parameters
    ----------
    points : ChunkedPoints
        N finite points.
    selection : Selection
        Of these points.
    gap : Length
    scale : Scale
    stages : Stages
        Times "gaps".

    Returns
    -------
    Selection
        Its diagnostics also tell how many points are added, and the largest gap, in the unit of the cloud.
    """
    from gppcs.spatial.gaps import fill_gaps

    kept = selection.points
    if kept is None:
        with stages("gaps", len(points)) as advanced:
            kept = points.at(selection.indices, advanced)
    added = fill_gaps(points, kept, scale.inside(gap), stages)
    found = {"added_in_gaps": float(len(added.rows)), "largest_gap": scale.outside(added.reached)}
    return dataclasses.replace(
        selection,
        indices=np.concatenate([selection.indices, added.rows]),
        diagnostics={**selection.diagnostics, **found},
        points=None if selection.points is None else np.concatenate([kept, added.places]),
        attributes={name: np.pad(values, (0, len(added.rows))) for name, values in selection.attributes.items()},
    )


class Scale(NamedTuple):
    """How lengths that somebody asks for become lengths in the coordinates of a method.

    Attributes
    ----------
    diagonal : float
        Of the bounding box, in the coordinates of the method.
    metres : float or None
        The unit of the cloud in metres, if it is known.
    exponent : int
        The unit of the method's coordinates is two to this power, in the unit of the cloud.
    """

    diagonal: float
    metres: float | None
    exponent: int

    def inside(self, length: Length) -> float:
        """Return a length in the coordinates of the method."""
        with np.errstate(over="ignore", under="ignore"):
            scaled = float(np.ldexp(length.in_cloud(self.outside(self.diagonal), self.metres), -self.exponent))
        return min(max(scaled, SHORTEST), LONGEST)

    def outside(self, length: float) -> float:
        """Return a length in the unit of the cloud, given in that of the method."""
        with np.errstate(over="ignore", under="ignore"):
            return float(np.ldexp(length, self.exponent))


def with_errors(selection: Selection, errors: Mapping[Measure, float], scale: Scale) -> Selection:
    """Return a selection whose diagnostics also tell its errors, in the unit of the cloud.

    Parameters
    ----------
    selection : Selection
    errors : mapping of str to float
        By measure, in the coordinates of the method.
    scale : Scale

    Returns
    -------
    Selection
    """
    found = {f"surface_{name}": scale.outside(error) for name, error in errors.items()}
    return dataclasses.replace(selection, diagnostics={**selection.diagnostics, **found})


def choose_amount(
    points: Points, amount: Amount, scale: Scale, guide: Guide | None, method: Method, stages: Stages
) -> Selection:
    """Let the method choose as many points as an amount means.

    Parameters
    ----------
    points : (N, 3) array, float64
        Finite, of about unit size.
    amount : Amount
    scale : Scale
    guide : Guide or None
    method : Method
    stages : Stages
        Times the stages of the method, "repeats", "accuracy" and "gaps".

    Returns
    -------
    Selection
        Its diagnostics also tell the errors, if a tolerance was asked for, and the largest gap, if that was, in the
        unit of the cloud, and the number of points to keep.

    Raises
    ------
    InputError
        If the points to keep are more than are asked for, or too few points have a weight.
    ParameterError
        If the method cannot do what is asked for.
    """
    from gppcs.spatial.chunks import ChunkedPoints

    count, chunked = amount.known_count(len(points)), ChunkedPoints.of(points)
    exact = count is not None
    if amount.spacing is not None:
        method.require_spacing()
    if guide is None and amount.spacing is not None and method.counts_at_spacing:
        count = method.count_at_spacing(chunked, scale.inside(amount.spacing), stages)
    if guide is None and amount.max_gap is None and count is not None:
        return choose(chunked, count, method, stages, repeats=amount.spacing is None)
    if guide is None:
        guide = Guide(np.empty(0, dtype=np.int64), None)
    else:
        method.require_guided()
    rows = guide.rows(len(points))
    if len(rows) < len(points):
        chunked, guide = ChunkedPoints.of(points[rows]), guide.among(rows)
    selection = _of_amount(chunked, count, exact, amount, scale, guide, method, stages)
    if amount.max_gap is not None:
        selection = without_gaps(chunked, selection, amount.max_gap, scale, stages)
    return dataclasses.replace(selection, indices=rows[selection.indices])


def _of_amount(
    points: ChunkedPoints,
    count: int | None,
    exact: bool,
    amount: Amount,
    scale: Scale,
    guide: Guide,
    method: Method,
    stages: Stages,
) -> Selection:
    """Let the method choose a number of the points, or as many as an amount means; gaps are filled later."""
    from gppcs.spatial.chunks import ChunkedValues, Places

    to_keep = Places(guide.keep, points.take(guide.keep), np.zeros(len(guide.keep), dtype=np.float32))
    weights = None if guide.weights is None else ChunkedValues.of(guide.weights)
    if count is None and amount.max_gap is not None and amount.tolerance is None and amount.spacing is None:
        area = method.surface_area(points, stages)
        if area is not None:
            count = fewest_without_gaps(area, scale.inside(amount.max_gap), len(guide.keep), len(points))
    if count is not None:
        return choose_guided(points, count, to_keep, weights, method, stages, repeats=exact)
    asked = _Asked.of(points, to_keep, weights, method, stages)
    if amount.tolerance is not None:
        selection = asked.of_accuracy(amount, scale)
    elif amount.spacing is not None:
        selection = method.at_spacing(asked.places, scale.inside(amount.spacing), stages)
    else:
        assert amount.max_gap is not None
        selection = asked.of_number(asked.fewest_without_gaps(scale.inside(amount.max_gap)))
    return asked.with_repeats(selection, 0)


@dataclass(frozen=True, eq=False)
class _Asked:
    """The places among which is chosen. The first `fixed` of them are kept.

    `rows` are those of the places, `repeats` are rows to keep at the same places.
    """

    places: Points
    rows: NDArray[np.int64]
    fixed: int
    repeats: NDArray[np.int64]
    weights: NDArray[np.float64] | None
    method: Method
    stages: Stages

    @classmethod
    def of(
        cls, points: ChunkedPoints, to_keep: Places, weights: ChunkedValues | None, method: Method, stages: Stages
    ) -> _Asked:
        from gppcs.spatial.cells import first_occurrences
        from gppcs.spatial.chunks import joined_places

        with stages("repeats", len(points)) as advanced:
            found = points.distinct(advanced)
        fixed, repeats = 0, to_keep.rows
        if len(to_keep.rows):
            found = joined_places([to_keep, found])
            first = first_occurrences(found.points)
            among = first[: len(to_keep.rows)]
            fixed, repeats = int(among.sum()), to_keep.rows[~among]
            found = found.take(np.flatnonzero(first))
        of_places = None if weights is None else weights.at(found.rows)
        return cls(found.points, found.rows, fixed, repeats, of_places, method, stages)

    def of_number(self, count: int) -> Selection:
        """Return a number of points, those to keep among them, or all places if there are no more."""
        return self._chosen(count - len(self.repeats))

    def of_accuracy(self, amount: Amount, scale: Scale) -> Selection:
        """Return the fewest points that reach a tolerance."""
        assert amount.tolerance is not None
        selection, errors = fewest_points(
            self.places, scale.inside(amount.tolerance), amount.measure, self._chosen, self.method.ranks,
            max(self.fixed, 1), self.stages,
        )  # fmt: skip
        return with_errors(selection, errors, scale)

    def fewest_without_gaps(self, gap: float) -> int:
        """Return how many points an even cover needs; see the function of this name."""
        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.spacing import surface_area

        area = surface_area(KdTree.build(self.places))
        return fewest_without_gaps(area, gap, self.fixed + len(self.repeats), len(self.places) + len(self.repeats))

    def with_repeats(self, selection: Selection, count: int) -> Selection:
        """Return the rows of chosen places, with the repeats to keep after the places to keep.

        If there are too few places for a number of points, other repeats follow.
        """
        chosen = dataclasses.replace(selection, indices=self.rows[selection.indices])
        found = _with_repeats(chosen, self.repeats, self.fixed)
        lacking = max(0, count - len(found.indices))
        others = np.setdiff1d(np.arange(count), found.indices)[:lacking]
        return dataclasses.replace(
            found,
            indices=np.concatenate([found.indices, others]),
            points=None if len(others) else selection.points,
            attributes={name: np.pad(values, (0, len(others))) for name, values in found.attributes.items()},
        )

    def _chosen(self, count: int) -> Selection:
        """Let the method choose among the places."""
        if count >= len(self.places):
            return Selection(np.arange(len(self.places)), ranked=False)
        if not self.fixed and self.weights is None:
            return self.method(self.places, count, self.stages)
        return self.method.guided(self.places, count, self.fixed, self.weights, self.stages)


def _with_repeats(selection: Selection, repeats: NDArray[np.int64], fixed: int) -> Selection:
    """Return a selection with repeats to keep after the first points, and tell how many are kept in all."""
    place = np.full(len(repeats), fixed)
    kept = fixed + len(repeats)
    return dataclasses.replace(
        selection,
        indices=np.insert(selection.indices, place, repeats),
        diagnostics={**selection.diagnostics, **({"points_to_keep": float(kept)} if kept else {})},
        attributes={name: np.insert(values, place, 0.0) for name, values in selection.attributes.items()},
    )


def _check_weighted(n: int, count: int) -> None:
    """Check that there are as many points to choose among as are asked for."""
    if count > n:
        raise InputError(f"expected at least {count:,} points of a weight above 0, found {n:,}; ask for fewer")


def _check_to_keep(kept: int, count: int) -> None:
    """Check that no more points are to be kept than are asked for."""
    if kept > count:
        found = f"points to keep: expected at most {count:,}, as many as are asked for, found {kept:,}"
        raise InputError(f"{found}; select fewer or ask for more")
