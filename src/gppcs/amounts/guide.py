"""The class `Guide`: what users ask of single points, such as which are kept whatever happens, and what counts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.groups import group_columns, groups_of
from gppcs.amounts.quotas import Parts, Quota
from gppcs.amounts.request import Request
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.clouds.lookup import as_floats, check_named, numbers_in
from gppcs.clouds.ranges import Details, columns_of_detail
from gppcs.errors import InputError, ParameterError, shown

LEAST_WEIGHT = 1e-4  # As a share of the largest. A smaller one counts as this: wider spacings would only take time.


@dataclass(frozen=True, eq=False)
class Guide:
    """What users know of the points that the method does not."""

    keep: NDArray[np.int64]  # (K,), rows that are kept whatever happens, ascending
    # (N,): Multiplies the density of the points that are kept. Points of weight 0 are not kept, unless they are in
    # `keep`.
    weights: NDArray[np.float64] | None
    # (N, k), attributes that count beside the shape, in their ranges times their weights.
    detail: NDArray[np.float32] | None
    parts: Parts | None  # Which quota counts for each of the N points
    groups: NDArray[np.int64] | None  # (N,), numbers of groups that are kept or dropped whole, from 0
    values: NDArray[np.float64] | None  # (N,), of the attribute at which the method looks

    @classmethod
    def of(cls, cloud: PointCloud, rows: NDArray[np.int64] | None, request: Request) -> Guide:
        """Look up what is asked of all or some rows of a cloud. Shapes: rows (N,)."""
        keep, weight, values_of = request.keep, request.weight, request.method.reads_attribute
        mask = np.zeros(len(cloud), dtype=np.bool_) if keep is None else _mask(cloud, keep)
        weights = None if weight is None else weights_of(cloud, weight)
        if rows is not None:
            mask, weights = mask[rows], None if weights is None else weights[rows]
        if isinstance(keep, str) and not mask.any():
            raise nothing_to_keep(keep)
        if weights is not None:
            known = WeightRange.of(weights)
            known.check()
            weights = known.in_shares(weights)
        some = cloud if rows is None else cloud.take(rows)
        return cls(
            np.flatnonzero(mask),
            weights,
            Details.of(some, request.detail).values(some) if request.detail else None,
            Parts.of(some, slice(None) if weights is None else mask | (weights > 0.0), request.quotas)
            if request.quotas
            else None,
            groups_of(group_columns(some, request.group)) if request.group else None,
            None if values_of is None else numbers_in(some, values_of, "to choose points by"),
        )

    def rows(self, n: int) -> NDArray[np.int64]:
        """Return the rows among which is chosen, ascending. Shapes: returns (n,)."""
        if self.weights is None:
            return np.arange(n)
        usable = self.weights > 0.0
        usable[self.keep] = True
        return np.flatnonzero(usable)


class WeightRange(NamedTuple):
    """What is known of some weights."""

    # Number of weights, and of those that are negative or not finite.
    n: int = 0
    bad: int = 0
    first_bad: int = 0  # Index of the first of these
    found: float = math.nan  # Its value
    largest: float = 0.0  # Of the others; 0 if there are none
    # Number of those above 0, and their sum in units of the largest.
    positive: int = 0
    shares: float = 0.0

    @classmethod
    def of(cls, weights: NDArray[np.float64]) -> WeightRange:
        """Look at weights, (n,)."""
        good = (weights >= 0.0) & np.isfinite(weights)
        bad = np.flatnonzero(~good)
        first, found = (int(bad[0]), float(weights[bad[0]])) if len(bad) else (0, math.nan)
        some = weights[good & (weights > 0.0)]
        largest = float(some.max(initial=0.0))
        return cls(len(weights), len(bad), first, found, largest, len(some), float((some / (largest or 1.0)).sum()))

    def followed_by(self, other: WeightRange) -> WeightRange:
        """Return what is known of these weights and others behind them."""
        first, found = (self.first_bad, self.found) if self.bad else (self.n + other.first_bad, other.found)
        largest, positive = max(self.largest, other.largest), self.positive + other.positive
        shares = sum(known.shares * (known.largest / (largest or 1.0)) for known in (self, other))
        return WeightRange(self.n + other.n, self.bad + other.bad, first, found, largest, positive, shares)

    @property
    def mean_share(self) -> float:
        """Mean of the weights above 0, in units of the largest."""
        return self.shares / self.positive if self.positive else 1.0

    def check(self) -> None:
        """Check that they are weights."""
        if self.bad:
            raise InputError(
                f"expected finite weights from 0 on, found {self.found:g} at index {self.first_bad} and "
                f"{self.bad - 1} more"
            )
        if not self.largest:
            raise InputError("expected a weight above 0 of at least one point, found 0 of all")

    def in_shares(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return some of the weights, (n,), as shares of the largest one, but 0 or at least `LEAST_WEIGHT`."""
        return np.where(weights > 0.0, np.maximum(weights / self.largest, LEAST_WEIGHT), 0.0)


class Guided(NamedTuple):
    """What a `ChunkGuide` says of some points."""

    rows: NDArray[np.int64]  # (n,), the finite points among which is chosen, ascending
    keep: NDArray[np.int64]  # (K,), which of these are kept whatever happens, ascending
    weights: NDArray[np.float64] | None  # (n,), of these points, as they are given
    columns: Mapping[str, NDArray[Any]]  # The attributes of these points that the choice needs
    labels: NDArray[np.uint8] | None  # (N,), of all points, as in `Parts`; where there are groups, of no quota
    groups: Sequence[NDArray[Any]]  # The attributes that make groups
    known: WeightRange  # Of all finite points


@dataclass(frozen=True)
class ChunkGuide:
    """What users know of the points of a cloud in chunks, by their attributes."""

    keep: Expression | None  # Which points are kept whatever happens
    weight: str | None  # The attribute that multiplies the density
    detail: tuple[str, ...]  # Attributes that count beside the shape
    values_of: str | None  # The attribute at which the method looks
    quotas: tuple[Quota, ...]
    group: str | None  # The attribute that makes groups

    @classmethod
    def of(cls, request: Request) -> ChunkGuide:
        """Return what is asked by attributes; arrays need all points at once."""
        keep, weight = (given if isinstance(given, str) else None for given in (request.keep, request.weight))
        known = None if keep is None else Expression.of(keep)
        values_of = request.method.reads_attribute
        return cls(known, weight, tuple(request.detail), values_of, request.quotas, request.group)

    def of_chunk(self, cloud: PointCloud) -> Guided:
        """Return what it says of the points of a chunk."""
        finite = rows = cloud.finite_rows()
        mask = np.zeros(len(rows), dtype=np.bool_) if self.keep is None else self.keep.mask(cloud)[rows]
        weights, known = None, WeightRange()
        if self.weight is not None:
            weights = weights_of(cloud, self.weight)[rows]
            known, usable = WeightRange.of(weights), mask | (weights > 0.0)
            rows, mask, weights = rows[usable], mask[usable], weights[usable]
        columns = {name: values[rows] for name, values in self.columns(cloud).items()}
        labels: NDArray[np.uint8] | None = None
        groups: list[NDArray[Any]] = []
        if self.quotas:
            labels = Parts.of(cloud, rows, self.quotas).labels
        elif self.group is not None:
            labels, groups = Parts.of(cloud, finite, ()).labels, group_columns(cloud, self.group)
        return Guided(rows, np.flatnonzero(mask), weights, columns, labels, groups, known)

    def columns(self, cloud: PointCloud) -> dict[str, NDArray[Any]]:
        """Return the attributes that the choice needs, with their own types."""
        names = columns_of_detail(cloud, self.detail)
        if self.values_of is not None:
            check_named(self.values_of, cloud.attributes, "to choose points by")
            names.append(self.values_of)
        return {name: cloud.attributes[name] for name in names}


def nothing_to_keep(condition: str) -> InputError:
    """Return the error for a condition of points to keep that none meets."""
    return InputError(
        f"expected points with {condition.strip()} to keep, found none; change the condition or omit keep"
    )


def _mask(cloud: PointCloud, keep: Any) -> NDArray[np.bool_]:
    """Return which points are to be kept."""
    if isinstance(keep, str):
        return Expression.of(keep).mask(cloud)
    expected = f"expected keep to be a condition, a mask of the {len(cloud):,} points, or rows"
    try:
        given = np.asarray(keep)
    except ValueError:
        raise ParameterError(f"{expected}, found {shown(keep)}") from None
    if given.dtype == np.bool_ and given.shape == (len(cloud),):
        return given
    if given.ndim != 1 or not (np.issubdtype(given.dtype, np.integer) or given.size == 0):
        raise ParameterError(f"{expected}, found {shown(keep)}")
    bad = (given < 0) | (given >= len(cloud))
    if bad.any():
        raise ParameterError(f"{expected} from 0 to {len(cloud) - 1}, found {given[bad][0]}")
    mask = np.zeros(len(cloud), dtype=np.bool_)
    mask[given.astype(np.int64)] = True
    return mask


def weights_of(cloud: PointCloud, weight: Any) -> NDArray[np.float64]:
    """Return the weight of each point. Shapes: returns (N,)."""
    if isinstance(weight, str):
        return numbers_in(cloud, weight, "to weigh its points by")
    expected = f"expected weight to be an attribute, or a number for each of the {len(cloud):,} points"
    try:
        given = np.asarray(weight)
    except ValueError:
        raise ParameterError(f"{expected}, found {shown(weight)}") from None
    if given.shape != (len(cloud),) or given.dtype.kind not in "biuf":
        raise ParameterError(f"{expected}, found {shown(weight)}")
    return as_floats(given)
