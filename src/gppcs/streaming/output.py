"""Reads the kept points again, with all their attributes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gppcs.clouds.cloud import PointCloud, with_normals
from gppcs.engine.arrays import Ints
from gppcs.engine.timer import Timer
from gppcs.io.joining import JointColumns
from gppcs.streaming.graph import Engine
from gppcs.streaming.plan import CHUNK
from gppcs.streaming.source import Part
from gppcs.streaming.tiles import Kept
from gppcs.surface.normals import with_signs_of


def take(parts: Sequence[Part], kept: Kept, columns: JointColumns, run_on: Engine, timer: Timer) -> PointCloud:
    """Read the kept points of all parts of a cloud, with all their attributes, in their order."""
    order = np.argsort(kept.indices)
    tasks = []
    for part in parts:
        begin, end = np.searchsorted(kept.indices[order], [part.first, part.first + (part.count or 0)])
        if begin < end:
            tasks.append((part, kept.indices[order[begin:end]]))
    with timer("kept points", len(tasks)) as on_progress:
        clouds = run_on.run(rows_of, tasks, on_progress=on_progress)
    return finished(columns.joined(clouds).take(np.argsort(order)), kept)


def rows_of(task: tuple[Part, Ints]) -> PointCloud:
    """Read the points of a part at some indices in the cloud, (n,), ascending."""
    part, indices = task
    first, clouds, columns = part.first, list[PointCloud](), JointColumns()
    with part.files as files:
        for cloud in files.chunks(CHUNK):
            begin, end = np.searchsorted(indices, [first, first + len(cloud)])
            columns.add(cloud)
            clouds.append(cloud.take(indices[begin:end] - first))
            first += len(cloud)
    part.check_count(first - part.first)
    return columns.joined(clouds)


def finished(cloud: PointCloud, kept: Kept) -> PointCloud:
    """Return kept points with their new positions and normals, if they have some."""
    if kept.moved is not None:
        cloud = cloud.moved(kept.moved)
    if kept.normals is None:
        return cloud
    original = cloud.normals()
    return with_normals(cloud, kept.normals if original is None else with_signs_of(kept.normals, original))
