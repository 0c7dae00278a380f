"""Outliers of a cloud on disk: each part is looked at with a halo."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.boxes import Each, Part
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.stored import StoredPoints
from gppcs.surface.outliers import outliers_among
from gppcs.surface.outliers.definition import NEIGHBOURS

PART = 1 << 17  # Points of a part at most.
TRIED = 1 << 10  # Points of the sample that tell how wide the halos must be.
SHARE = 0.99  # Of these points, the neighbours and theirs are to be in the halo.
WIDER = 2.5  # Width of the halo, relative to the distance to the 16th neighbour: these have neighbours, too.


def outliers_in_parts(stored: StoredPoints, each: Each, advanced: Callable[[int], None]) -> NDArray[np.int64]:
    """Find the rows of the outliers of stored points, ascending: those of `find_outliers`, part by part."""
    parts = stored.parts(PART)
    found = [np.empty(0, dtype=np.int64)]
    for part, rows in zip(parts, each(partial(_outliers, stored), parts), strict=True):
        found.append(rows)
        advanced(int(stored.counts[part.first : part.last].sum()))
    return np.sort(np.concatenate(found))


def _outliers(stored: StoredPoints, part: Part) -> NDArray[np.int64]:
    """Find the outliers of a part, with a halo in which the neighbours of most points lie, and theirs."""
    own = stored.near(part)
    tree = KdTree.build(own.points)
    tried = own.points[:: max(1, len(own.rows) // TRIED)]
    reach = np.sqrt(tree.nearest_of(tried, min(NEIGHBOURS + 1, len(own.rows)))[1][:, -1])
    near = stored.near(part, WIDER * float(np.quantile(reach, SHARE)), repeats=True)
    outside = outliers_among(near.points) & near.inside
    return near.rows[outside]
