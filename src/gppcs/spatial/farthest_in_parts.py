"""Farthest point sampling of a cloud on disk: all parts choose down to one distance, which is lowered step by step."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.lib.recfunctions import require_fields
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.spatial.boxes import MapParts, Part, chosen_by_classes
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.stored import RECORD, StoredPoints

PART = 1 << 18  # Points of a part at most.
CHOSEN = np.dtype([*RECORD.descr, ("distance", np.float64)])  # the distance to the points that were chosen before
NEGLIGIBLE = 1e-150  # A smaller distance counts as none; its square would vanish.


def farthest_in_parts(
    stored: StoredPoints,
    n_points: int,
    keep: tuple[Ints, Floats],
    timer: Timer,
    map_parts: MapParts,
    minimum: float = 0.0,
) -> Ints:
    """Choose M points, at least some distance apart, and return their indices; fewer if no other is far enough.

    The first ones are those to keep, of some indices and coordinates, (fixed, 3).
    """
    sample = stored.sample
    first = min(4096, n_points, len(sample))  # so many of a sample tell the first distance
    distance = max(float(farthest_points(sample, first)[1][-1]) if first > 1 else math.inf, minimum)
    chosen = np.empty(len(keep[0]), dtype=CHOSEN)
    chosen["row"], chosen["place"], chosen["distance"] = *keep, math.inf
    parts = stored.parts(PART)
    with timer("farthest points", n_points) as on_progress:
        while len(chosen) < n_points:
            before = len(chosen)
            halo = 3.0 * distance if math.isfinite(distance) else 0.0
            chosen = chosen_by_classes(
                stored.boxes, parts, halo, map_parts, partial(_choose, stored, distance, halo), chosen
            )
            on_progress(max(0, min(len(chosen), n_points) - before))
            # At the last distance, rounds go on: what a part chose in its halo, and did not keep, leaves gaps.
            if distance <= minimum and (distance == 0.0 or len(chosen) == before):
                break
            # The last distance is aimed a little too low, so that 5 % more points are chosen than are needed.
            step = math.sqrt(max(1, len(chosen)) / (1.05 * n_points))
            distance = max(_lower(distance, step) if math.isfinite(distance) else 0.0, minimum)
    order = np.lexsort([chosen["row"], -chosen["distance"], np.arange(len(chosen)) >= len(keep[0])])
    return chosen["row"][order[:n_points]]


def _lower(distance: float, step: float) -> float:
    """Return the next distance; zero, with which every point is chosen, once it is negligible."""
    lower = distance * max(0.5, step)
    return lower if lower > NEGLIGIBLE and lower < distance else 0.0


def _choose(
    stored: StoredPoints, distance: float, halo: float, settled: Flags, task: tuple[Part, NDArray[Any]]
) -> NDArray[Any]:
    """Choose the points of a part that are at least so far from those chosen; none in boxes that are `settled`."""
    part, chosen = task
    near = stored.near(part, halo)
    near = near.take(np.flatnonzero(~settled[stored.boxes.box_of(near.points)]))
    points = near.points
    indices, distances = farthest_points(points, len(points), before=chosen["place"], minimum=max(distance, NEGLIGIBLE))
    inside = near.inside[indices]
    added = require_fields(near.records[indices[inside]], CHOSEN)
    added["distance"] = distances[inside]
    return added
