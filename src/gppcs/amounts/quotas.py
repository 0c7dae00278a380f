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

Labels = NDArray[np.int64]


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
    if quota is None:
        return ()
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
    """Points by the quotas that count for them.

    Attributes
    ----------
    quotas : tuple of Quota
    labels : (N,) array
        For each point, the index of its quota; that behind the last one for points of no quota, which share the rest.
    """

    quotas: tuple[Quota, ...]
    labels: Labels

    @classmethod
    def of(cls, cloud: PointCloud, rows: NDArray[np.int64] | None, quotas: tuple[Quota, ...]) -> Parts:
        """Look up which quota counts for each of all or some rows of a cloud."""
        some = cloud if rows is None else cloud.take(rows)
        labels = np.full(len(some), len(quotas))
        for index, quota in enumerate(quotas):
            met = quota.condition.mask(some)
            if (both := met & (labels < index)).any():
                other = quotas[labels[np.argmax(both)]].condition.text
                raise InputError(
                    f"expected quotas that do not overlap, found {both.sum():,} points that meet both "
                    f"{shown(other)} and {shown(quota.condition.text)}; narrow one of them"
                )
            labels[met] = index
        return cls(quotas, labels)

    def numbers(self, count: int, usable: NDArray[np.int64], keep: NDArray[np.int64]) -> Labels:
        """Return how many points each part gets, the last one what the quotas leave; check that this is possible.

        Shapes: usable (n,), keep (K,); returns (len(quotas) + 1,).
        """
        found, kept = (np.bincount(self.labels[rows], minlength=len(self.quotas) + 1) for rows in (usable, keep))
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


def choose_in_parts(labels: Labels, numbers: Labels, fixed: int, chosen: Callable[[int], Selection]) -> Selection:
    """Choose a number of places in each part, as far as there are so many. The first `fixed` ones are kept.

    `chosen` ranks a number of all places. Each part gets the first of its own in one ranking, long enough for the part
    that needs most, so that there are no seams where parts meet. Shapes: labels (n,), numbers (parts,).
    """
    n, most = len(labels), np.minimum(numbers, np.bincount(labels, minlength=len(numbers)))
    wanted = max(1, fixed, min(n - 1, int(most.sum())))
    while True:
        selection = chosen(wanted)
        found = np.bincount(labels[selection.indices], minlength=len(numbers))
        if (found >= most).all() or wanted >= n - 1:
            return _first_of_parts(selection, labels, numbers)
        growth = min(float((most / np.maximum(found, 1)).max()), MOST_GROWTH)
        wanted = min(n - 1, math.ceil(SURPLUS * growth * wanted))


def _first_of_parts(selection: Selection, labels: Labels, numbers: Labels) -> Selection:
    """Return a selection without those points that are more than the number of their part, the last ones."""
    of_chosen = labels[selection.indices]
    order = np.argsort(of_chosen, kind="stable")
    starts = np.searchsorted(of_chosen[order], np.arange(len(numbers)))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order)) - starts[of_chosen[order]]
    kept = place < numbers[of_chosen]
    attributes = {name: values[kept] for name, values in selection.attributes.items()}
    return replace(selection, indices=selection.indices[kept], attributes=attributes)


def with_whole_parts(keep: NDArray[np.int64], parts: Parts, numbers: Labels, usable: NDArray[np.int64]) -> Labels:
    """Return the rows to keep, with all usable rows of the parts that are wanted whole, ascending.

    Shapes: keep (K,), numbers (parts,), usable (n,); returns (k,).
    """
    whole = numbers == np.bincount(parts.labels[usable], minlength=len(numbers))
    return np.union1d(keep, usable[whole[parts.labels[usable]]])


def lacking(parts: Parts, numbers: Labels, kept: NDArray[np.int64], usable: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first usable rows of each part that make its number full. They repeat kept places, if not one each.

    Shapes: kept (m,), usable (n,); returns (k,).
    """
    others = np.setdiff1d(usable, kept)
    missing = numbers - np.bincount(parts.labels[kept], minlength=len(numbers))
    found = [others[parts.labels[others] == part][:number] for part, number in enumerate(missing) if number > 0]
    return np.concatenate([np.empty(0, dtype=np.int64), *found])
