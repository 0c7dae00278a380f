"""Exact numbers of points for classes: quotas of conditions, and a choice that meets them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.clouds.quantities import PERCENT, ratio_of, size_of
from gppcs.engine.arrays import Flags, Ints
from gppcs.errors import InputError, ParameterError, shown
from gppcs.methods import Selection

EXCLUDED = np.uint8(255)  # label of points that must not be kept

Labels = NDArray[np.uint8]


@dataclass(frozen=True)
class Quota:
    """How many kept points meet a condition: a number (int), or a fraction of all kept points (float)."""

    condition: Expression
    size: float | int

    def number(self, count: int) -> int:
        """Return the number of points, of as many kept ones."""
        return self.size if isinstance(self.size, int) else round(self.size * count)


def quotas_of(quota: Any) -> tuple[Quota, ...]:
    """Check the option `quota`: numbers or fractions of the kept points that meet conditions."""
    if not isinstance(quota, Mapping) or not quota:
        expected = "expected `quota` to be a mapping of conditions to numbers or shares of the kept points"
        raise ParameterError(f"{expected}, found {shown(quota)}")
    if len(quota) >= EXCLUDED:
        raise ParameterError(f"expected at most {EXCLUDED - 1} quotas, found {len(quota)}")
    return tuple(Quota(Expression.from_text(condition), _size(size)) for condition, size in quota.items())


def _size(value: Any) -> float | int:
    """Return the size of a quota: also 0, for no points, and 100%, for all."""
    if isinstance(value, str) and value.strip() in ("0", "0%"):
        return 0
    if isinstance(value, str) and value.strip().endswith(PERCENT):
        return ratio_of("quota", value)
    is_zero = not isinstance(value, str | bool) and np.ndim(value) == 0 and value == 0
    return 0 if is_zero else size_of("quota", value)


def quota_labels(cloud: PointCloud, usable: Ints, quotas: Sequence[Quota]) -> Labels:
    """Return the index of the quota of each point, (N,): `len(quotas)` for none, `EXCLUDED` for unusable points."""
    labels = np.full(len(cloud), EXCLUDED)
    labels[usable] = len(quotas)
    for index, quota in enumerate(quotas):
        is_met = quota.condition.mask(cloud) & (labels != EXCLUDED)
        is_met_twice = is_met & (labels < index)
        if is_met_twice.any():
            other = quotas[labels[np.argmax(is_met_twice)]].condition.text
            raise InputError(
                f"expected quotas that do not overlap, found {is_met_twice.sum():,} points that meet both "
                f"{shown(other)} and {shown(quota.condition.text)}; narrow one of them"
            )
        labels[is_met] = index
    return labels


def choose_quotas(
    quotas: Sequence[Quota], labels: Labels, count: int, keep: Ints, repeats: Ints, rank: Callable[[int], Selection]
) -> tuple[Selection, Ints]:
    """Choose points so that each quota gets its own; return also the indices that fill it with repeats.

    `rank` ranks a number of points, the first of which are those of `keep` that do not repeat positions of others; the
    latter are `repeats`. Each quota gets the first of its own in one ranking, which is long enough for the quota that
    needs most, so that there are no seams. Shapes: labels (N,).
    """
    parts = len(quotas) + 1
    n_points = _count(labels, parts)
    numbers = numbers_of(quotas, n_points, _count(labels[keep], parts), count)
    n_ranked = numbers - _count(labels[repeats], parts)
    needed = np.where(n_ranked < n_points, n_ranked, 0)  # all points of a quota need no ranking
    n = int(n_points.sum())
    length = max(1, len(keep) - len(repeats), min(n - 1, int(n_ranked.sum())))
    while True:
        selection = rank(length)
        reached = _count(labels[selection.indices], parts)
        if (reached >= needed).all() or length >= n - 1:
            break
        growth = min(float((needed / np.maximum(reached, 1)).max()), 4.0)
        length = min(n - 1, math.ceil(1.05 * growth * length))  # a little longer: another ranking costs more
    first = selection.indices[first_of_parts(labels[selection.indices], n_ranked)]
    selection = replace(selection.arranged(first), ranked=False)
    taken = np.concatenate([selection.indices, repeats])
    missing = numbers - _count(labels[taken], parts)
    fill = [np.setdiff1d(np.flatnonzero(labels == part), taken)[: max(0, k)] for part, k in enumerate(missing)]
    return selection, np.concatenate(fill)


def _count(labels: Labels, parts: int) -> Ints:
    """Return how many labels each part has, (parts,), counted in blocks to save memory."""
    blocks = np.array_split(labels, 1 + len(labels) // (1 << 20))
    return sum((np.bincount(block, minlength=parts)[:parts] for block in blocks), start=np.zeros(parts, dtype=np.int64))


def numbers_of(quotas: Sequence[Quota], n_points: Ints, n_keep: Ints, count: int) -> Ints:
    """Return how many points each part gets, the last one what the quotas leave; check that this is possible.

    Shapes: n_points, n_keep (parts,), the points of each part, and those to keep.
    """
    numbers = np.array([quota.number(count) for quota in quotas] + [0])
    rest = count - int(numbers.sum())
    if rest < 0:
        raise InputError(
            f"expected quotas of at most the {count:,} points asked for, found {numbers.sum():,}; lower a quota, "
            "or ask for more points"
        )
    numbers[-1] = rest
    names = [f"points with {quota.condition.text}" for quota in quotas] + ["points of no quota"]
    for name, number, n, fixed in zip(names, numbers, n_points, n_keep, strict=True):
        if number > n:
            raise InputError(f"expected at least {number:,} {name}, found {n:,}; change the quotas")
        if fixed > number:
            raise InputError(f"{fixed:,} {name} are to be kept whatever happens, but only {number:,} are asked for")
    return numbers


def first_of_parts(labels: Labels, numbers: Ints) -> Flags:
    """Return which points, (n,), are among the first of their part, of each as many as its number, (parts,)."""
    order = np.argsort(labels, kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order)) - np.searchsorted(labels[order], labels[order])
    return place < numbers[labels]
