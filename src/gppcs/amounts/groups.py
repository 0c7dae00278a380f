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
from gppcs.errors import InputError, shown
from gppcs.methods import Selection

PULSE, CHANNEL = "gps_time", "scanner_channel"  # each channel of a scanner emits pulses of its own
STEP = 1.02  # Least growth of the number of points whose groups are taken.

Rows = NDArray[np.int64]


def group_columns(cloud: PointCloud, name: str) -> list[NDArray[Any]]:
    """Return the attributes whose equal values make groups of points, each (N,); a pulse has a channel, too."""
    check_named(name, cloud.attributes, "to group its points by")
    values = cloud.attributes[name]
    if values.ndim > 1 or values.dtype.kind not in "biufUS":
        raise InputError(f"expected attribute {shown(name)} to hold one number or text for each point")
    if values.dtype.kind == "f" and (bad := int(np.isnan(values).sum())):
        raise InputError(f"expected the group of each point in attribute {shown(name)}, found {bad:,} that are NaN")
    return [values, cloud.attributes[CHANNEL]] if name == PULSE and CHANNEL in cloud.attributes else [values]


def groups_of(columns: Sequence[NDArray[Any]]) -> Rows:
    """Return the group, (N,), of each point, from 0: points with equal values in all columns, each (N,)."""
    groups = np.unique(columns[0], return_inverse=True)[1]
    for values in columns[1:]:
        other = np.unique(values, return_inverse=True)[1]
        groups = np.unique(groups * (int(other.max()) + 1) + other, return_inverse=True)[1]
    return groups


def choose_groups(groups: Rows, number: int, fixed: int, count: int, chosen: Callable[[int], Selection]) -> Selection:
    """Choose whole groups with as near to a number of points as they allow.

    `chosen` ranks a number of points; the first `fixed` ones are kept. A group is taken when the ranking meets one of
    its points. Points of the group `number`, behind all groups, are left out. Shapes: groups (N,).
    """
    sizes = np.bincount(groups, minlength=number)[:number]
    n = int(sizes.sum())
    wanted = max(1, fixed, math.ceil(count * number / n))
    while True:
        selection = chosen(min(wanted, n))
        met, first = np.unique(groups[selection.indices], return_index=True)
        order = np.argsort(first)
        totals = np.cumsum(sizes[met[order]])
        if totals[-1] >= count or wanted >= n:
            break
        wanted = math.ceil(wanted * max(STEP, count / totals[-1]))
    least = int((first < fixed).sum())  # groups of points to keep
    taken = max(least, 1 + int(np.argmin(np.abs(totals - count))))
    return _whole(selection, groups, number, met[order][:taken])


def _whole(selection: Selection, groups: Rows, number: int, taken: Rows) -> Selection:
    """Return all points of the groups that are taken, in their order."""
    rank = np.full(number + 1, len(taken))
    rank[taken] = np.arange(len(taken))
    members = np.flatnonzero(rank[groups] < len(taken))
    members = members[np.argsort(rank[groups[members]], kind="stable")]
    order = np.argsort(members)
    places = order[np.searchsorted(members[order], selection.indices).clip(max=len(members) - 1)]
    there = members[places] == selection.indices
    attributes = {}
    for name, values in selection.attributes.items():
        attributes[name] = np.zeros(len(members))
        attributes[name][places[there]] = values[there]
    found = {"groups": float(len(taken)), "groups_in_cloud": float(number)}
    return replace(
        selection, indices=members, diagnostics={**selection.diagnostics, **found}, attributes=attributes, ranked=False
    )
