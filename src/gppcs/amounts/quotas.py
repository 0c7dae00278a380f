"""Exact numbers of points for classes: quotas of conditions, and a choice that meets them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.clouds.quantities import size_of
from gppcs.errors import InputError, ParameterError, shown
from gppcs.methods import Selection

SURPLUS, MOST_GROWTH = 1.05, 4.0  # by which a ranking that lacks points of a part is made longer

LEFT_OUT = np.uint8(255)  # labels points that are not to be kept
BLOCK = 1 << 20  # labels that are counted at once

Rows = NDArray[np.int64]
Labels = NDArray[np.uint8]


@dataclass(frozen=True)
class Quota:
    """How many of the kept points meet a condition: a number (int), or a share of all kept points (float below 1)."""

    condition: Expression
    size: float | int

    def number(self, count: int) -> int:
        """Return the number of points, of as many kept ones."""
        return self.size if isinstance(self.size, int) else round(self.size * count)


def quotas_of(quota: Any) -> tuple[Quota, ...]:
    """Check the argument `quota` of `gppcs.simplify`: numbers or shares of conditions."""
    if not isinstance(quota, Mapping) or not quota:
        expected = "expected quota to be a mapping of conditions to numbers or shares of the kept points"
        raise ParameterError(f"{expected}, found {shown(quota)}")
    return tuple(Quota(Expression.of(condition), _size(size)) for condition, size in quota.items())


def _size(given: Any) -> float | int:
    """Return the size of a quota: also 0, for none at all."""
    if isinstance(given, str) and given.strip() in ("0", "0%"):
        return 0
    return 0 if not isinstance(given, str | bool) and np.ndim(given) == 0 and given == 0 else size_of("quota", given)


@dataclass(frozen=True, eq=False)
class Parts:
    """Points by the quotas that count for them."""

    quotas: tuple[Quota, ...]
    # (N,), for each point, the index of its quota; that behind the last one for points of no quota, which share the
    # rest; `LEFT_OUT` for points that are not to be kept.
    labels: Labels

    @classmethod
    def of(cls, cloud: PointCloud, rows: NDArray[Any] | slice, quotas: tuple[Quota, ...]) -> Parts:
        """Look up which quota counts for each point of a cloud; only some rows may be kept."""
        if len(quotas) >= LEFT_OUT:
            raise ParameterError(f"expected at most {LEFT_OUT - 1} quotas, found {len(quotas)}")
        labels = np.full(len(cloud), LEFT_OUT)
        labels[rows] = len(quotas)
        for index, quota in enumerate(quotas):
            met = quota.condition.mask(cloud) & (labels != LEFT_OUT)
            if (both := met & (labels < index)).any():
                other = quotas[labels[np.argmax(both)]].condition.text
                raise InputError(
                    f"expected quotas that do not overlap, found {both.sum():,} points that meet both "
                    f"{shown(other)} and {shown(quota.condition.text)}; narrow one of them"
                )
            labels[met] = index
        return cls(quotas, labels)

    def count(self, rows: Rows | None = None) -> Rows:
        """Return the number of points of each part, of all or some rows, (len(quotas) + 1,)."""
        labels, number = self.labels if rows is None else self.labels[rows], len(self.quotas) + 1
        return sum(
            (np.bincount(some, minlength=number)[:number] for some in np.array_split(labels, 1 + len(labels) // BLOCK)),
            start=np.zeros(number, dtype=np.int64),
        )

    def numbers(self, count: int, keep: Rows) -> Rows:
        """Return how many points each part gets, the last one what the quotas leave; check that this is possible."""
        found, kept = self.count(), self.count(keep)
        numbers = np.array([quota.number(count) for quota in self.quotas] + [0])
        rest = count - int(numbers.sum())
        if rest < 0:
            raise InputError(
                f"expected quotas of at most the {count:,} points asked for, found {numbers.sum():,}; lower a quota, "
                "or ask for more points"
            )
        numbers[-1] = rest
        names = [f"points with {quota.condition.text}" for quota in self.quotas] + ["points of no quota"]
        for name, wanted, there, fixed in zip(names, numbers, found, kept, strict=True):
            if wanted > there:
                raise InputError(f"expected at least {wanted:,} {name}, found {there:,}; change the quotas")
            if fixed > wanted:
                raise InputError(f"{fixed:,} {name} are to be kept whatever happens, but only {wanted:,} are asked for")
        return numbers

    def choose(self, numbers: Rows, fixed: int, chosen: Callable[[int], Selection]) -> Selection:
        """Choose a number of points in each part, as far as there are so many. The first `fixed` ones are kept.

        `chosen` ranks a number of all points. Each part gets the first of its own in one ranking, long enough for the
        part that needs most, so that there are no seams where parts meet. A part that is wanted whole needs none.
        Shapes: numbers (parts,).
        """
        there = self.count()
        n, needed = int(there.sum()), np.where(numbers < there, numbers, 0)
        wanted = max(1, fixed, min(n - 1, int(numbers.sum())))
        while True:
            selection = chosen(wanted)
            found = self.count(selection.indices)
            if (found >= needed).all() or wanted >= n - 1:
                return _first_of_parts(selection, self.labels, numbers)
            growth = min(float((needed / np.maximum(found, 1)).max()), MOST_GROWTH)
            wanted = min(n - 1, math.ceil(SURPLUS * growth * wanted))

    def lacking(self, numbers: Rows, kept: Rows) -> Rows:
        """Return the first other rows, (k,), of each part that fill its number; they may repeat kept places."""
        missing = numbers - self.count(kept)
        found = [
            np.setdiff1d(np.flatnonzero(self.labels == part), kept)[:number]
            for part, number in enumerate(missing)
            if number > 0
        ]
        return np.concatenate([np.empty(0, dtype=np.int64), *found])


def _first_of_parts(selection: Selection, labels: Labels, numbers: Rows) -> Selection:
    """Return a selection without those points that are more than the number of their part, the last ones."""
    of_chosen = labels[selection.indices]
    order = np.argsort(of_chosen, kind="stable")
    starts = np.searchsorted(of_chosen[order], np.arange(len(numbers)))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order)) - starts[of_chosen[order]]
    kept = place < numbers[of_chosen]
    attributes = {name: values[kept] for name, values in selection.attributes.items()}
    return replace(selection, indices=selection.indices[kept], attributes=attributes)
