"""Groups of points that are kept or dropped whole, such as the returns of a laser pulse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.lookup import check_named
from gppcs.errors import InputError, shown
from gppcs.methods import Selection

PULSE, CHANNEL = "gps_time", "scanner_channel"  # each channel of a scanner emits pulses of its own
STEP = 1.02  # Least growth of the number of points whose groups are taken.

Rows = NDArray[np.int64]


def groups_of(cloud: PointCloud, rows: Rows | None, name: str) -> Rows:
    """Return the group of each of all or some rows of a cloud, from 0: points with an equal attribute.

    Shapes: rows (n,); returns (n,).
    """
    check_named(name, cloud.attributes, "to group its points by")
    values = cloud.attributes[name] if rows is None else cloud.attributes[name][rows]
    if values.ndim > 1 or values.dtype.kind not in "biufUS":
        raise InputError(f"expected attribute {shown(name)} to hold one number or text for each point")
    if values.dtype.kind == "f" and (bad := int(np.isnan(values).sum())):
        raise InputError(f"expected the group of each point in attribute {shown(name)}, found {bad:,} that are NaN")
    groups = np.unique(values, return_inverse=True)[1]
    if name == PULSE and CHANNEL in cloud.attributes:
        channels = cloud.attributes[CHANNEL] if rows is None else cloud.attributes[CHANNEL][rows]
        groups = np.unique(groups * (int(channels.max()) + 1) + channels, return_inverse=True)[1]
    return groups


def choose_groups(groups: Rows, rows: Rows, fixed: int, count: int, chosen: Callable[[int], Selection]) -> Selection:
    """Choose whole groups with as near to a number of points as they allow.

    `chosen` ranks a number of places, which are given `rows`; the first `fixed` ones are kept. A group is taken when
    the ranking meets one of its points. Shapes: groups (N,), rows (n,); the indices of the result are among N.
    """
    sizes = np.bincount(groups)
    places, wanted = len(rows), max(1, fixed, math.ceil(count * len(sizes) / len(groups)))
    while True:
        selection = chosen(min(wanted, places))
        met, first = np.unique(groups[rows[selection.indices]], return_index=True)
        order = np.argsort(first)
        totals = np.cumsum(sizes[met[order]])
        if totals[-1] >= count or wanted >= places:
            break
        wanted = math.ceil(wanted * max(STEP, count / totals[-1]))
    least = int((first < fixed).sum())  # groups of points to keep
    taken = max(least, 1 + int(np.argmin(np.abs(totals - count))))
    return _whole(selection, rows, groups, met[order][:taken])


def _whole(selection: Selection, rows: Rows, groups: Rows, taken: Rows) -> Selection:
    """Return all points of the groups that are taken, in their order."""
    rank = np.full(int(groups.max()) + 1, len(taken))
    rank[taken] = np.arange(len(taken))
    members = np.flatnonzero(rank[groups] < len(taken))
    members = members[np.argsort(rank[groups[members]], kind="stable")]
    by_choice = np.zeros(len(groups))
    attributes = {}
    for name, values in selection.attributes.items():
        by_choice[rows[selection.indices]] = values
        attributes[name] = by_choice[members]
    found = {"groups": float(len(taken)), "groups_in_cloud": float(len(np.bincount(groups)))}
    return replace(
        selection, indices=members, diagnostics={**selection.diagnostics, **found}, attributes=attributes, ranked=False
    )
