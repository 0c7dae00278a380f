"""Groups of points that are kept or dropped whole, such as the returns of a laser pulse."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.lookup import check_named
from gppcs.engine.arrays import Ints
from gppcs.errors import InputError, shown
from gppcs.methods import Selection


def group_columns(cloud: PointCloud, name: str) -> list[NDArray[Any]]:
    """Return the attributes whose equal values make groups of points, each (N,)."""
    check_named(name, cloud.attributes, "to group its points by")
    values = cloud.attributes[name]
    if values.ndim > 1 or values.dtype.kind not in "biufUS":
        raise InputError(f"expected attribute {shown(name)} to hold one number or text for each point")
    if values.dtype.kind == "f" and (n_bad := int(np.isnan(values).sum())):
        raise InputError(f"expected the group of each point in attribute {shown(name)}, found {n_bad:,} that are NaN")
    if name == "gps_time" and "scanner_channel" in cloud.attributes:  # each channel emits pulses of its own
        return [values, cloud.attributes["scanner_channel"]]
    return [values]


def group_numbers(columns: Sequence[NDArray[Any]]) -> Ints:
    """Return the group of each point, (N,), from 0: points with equal values in all columns, each (N,)."""
    groups = np.unique(columns[0], return_inverse=True)[1]
    for values in columns[1:]:
        other = np.unique(values, return_inverse=True)[1]
        groups = np.unique(groups * (int(other.max()) + 1) + other, return_inverse=True)[1]
    return groups


def choose_groups(groups: Ints, number: int, fixed: int, count: int, rank: Callable[[int], Selection]) -> Selection:
    """Choose whole groups with as near to a number of points as they allow.

    `rank` ranks a number of points; the first `fixed` ones are kept. A group is taken when the ranking meets one of its
    points. Points of the group `number`, behind all groups, are excluded. Shapes: groups (N,).
    """
    sizes = np.bincount(groups, minlength=number)[:number]
    n = int(sizes.sum())
    length = max(1, fixed, math.ceil(count * number / n))
    while True:
        selection = rank(min(length, n))
        ranked, first = np.unique(groups[selection.indices], return_index=True)
        order = np.argsort(first)
        totals = np.cumsum(sizes[ranked[order]])
        if totals[-1] >= count or length >= n:
            break
        length = math.ceil(length * max(1.02, count / totals[-1]))
    minimum = int((first < fixed).sum())  # groups of points to keep
    n_groups = max(minimum, 1 + int(np.argmin(np.abs(totals - count))))
    turn = np.full(number + 1, n_groups)
    turn[ranked[order][:n_groups]] = np.arange(n_groups)
    members = np.flatnonzero(turn[groups] < n_groups)
    chosen = selection.arranged(members[np.argsort(turn[groups[members]], kind="stable")])
    diagnostics = {**selection.diagnostics, "groups": float(n_groups), "groups_in_cloud": float(number)}
    return replace(chosen, diagnostics=diagnostics, ranked=False)
