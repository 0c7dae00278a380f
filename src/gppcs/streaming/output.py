"""Reads the kept points again, with all their attributes."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from gppcs.clouds.cloud import PointCloud, with_normals
from gppcs.engine.arrays import Ints
from gppcs.io.joining import JointColumns, joined
from gppcs.streaming.rows import Rows
from gppcs.streaming.source import Part
from gppcs.surface.normals import with_signs_of


def take(
    parts: Sequence[Part],
    kept: Rows,
    columns: JointColumns | None = None,
    apply: Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]] = map,
) -> PointCloud:
    """Read the kept points of some parts of a cloud, with all their attributes, in their order.

    They get the types of the values of these parts, or those that `columns` has seen; `apply` reads parts like `map`.
    """
    order = np.argsort(kept.indices)
    tasks = []
    for part in parts:
        begin, end = np.searchsorted(kept.indices[order], [part.first, part.first + (part.count or 0)])
        tasks.append((part, kept.indices[order[begin:end]]))
    clouds = list(apply(rows_of, tasks))
    cloud = joined(clouds) if columns is None else columns.joined(clouds)
    cloud = cloud.take(np.argsort(order))
    if "moved" in kept.columns:
        cloud = cloud.moved(kept.positions)
    normals, original = kept.columns.get("normals"), cloud.normals()
    if normals is None:
        return cloud
    return with_normals(cloud, normals if original is None else with_signs_of(normals, original))


def rows_of(task: tuple[Part, Ints]) -> PointCloud:
    """Read the points of a part at some indices in the cloud, (n,), ascending."""
    part, indices = task
    if not len(indices):
        with part.files as files:
            return files.preview[:0]
    clouds, columns = list[PointCloud](), JointColumns()
    for n, cloud in part.clouds():
        first = part.first + n
        begin, end = np.searchsorted(indices, [first, first + len(cloud)])
        columns.add(cloud)
        clouds.append(cloud.take(indices[begin:end] - first))
    return columns.joined(clouds)
