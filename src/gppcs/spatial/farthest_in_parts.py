"""Farthest point sampling of a cloud on disk, part by part.

All parts choose down to one distance; it is lowered level by level until enough points are chosen. A part chooses with
a halo, keeps what lies in itself, and takes what the parts of earlier classes chose in its halo as given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.timer import Timer
from gppcs.spatial.boxes import Each, Part, classes
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.stored import StoredPoints, within

PART = 1 << 18  # Points of a part at most.
FIRST = 4096  # Points that the first level chooses, about: so many of a sample tell its distance.
LEVEL_HALO = 3.0  # In units of the distance of the level.
SPARE = 1.05  # Points chosen for each one wanted: the last level is aimed a little too low.
LEAST_STEP = 0.5  # From one level to the next, at most.
NEGLIGIBLE = 1e-150  # A smaller distance counts as none; its square would vanish.


class Farthest(NamedTuple):
    """Chosen points, the farthest first."""

    rows: NDArray[np.int64]  # (n,)
    places: NDArray[np.float64]  # (n, 3)
    distances: NDArray[np.float64]  # (n,), distance of each to the points that were chosen before it


def farthest_in_parts(
    stored: StoredPoints, n_points: int, timer: Timer, each: Each, least: float = 0.0
) -> NDArray[np.int64]:
    """Choose M points, at least some distance apart, and return their rows; fewer if no other place is far enough."""
    sample = stored.sample
    first = min(FIRST, n_points, len(sample))
    level = max(float(farthest_points(sample, first)[1][-1]) if first > 1 else math.inf, least)
    chosen = Farthest(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0))
    parts = stored.parts(PART)
    with timer("farthest points", n_points) as advanced:
        while len(chosen.rows) < n_points:
            before = len(chosen.rows)
            for added in _round(stored, parts, chosen, level, each):
                chosen = Farthest._make(map(np.concatenate, zip(chosen, added, strict=True)))
            advanced(max(0, min(len(chosen.rows), n_points) - before))
            # At the last level, rounds go on: what a part chose in its halo, and did not keep, leaves places open.
            if level <= least and (level == 0.0 or len(chosen.rows) == before):
                break
            step = math.sqrt(max(1, len(chosen.rows)) / (SPARE * n_points))
            level = max(_lower(level, step) if math.isfinite(level) else 0.0, least)
    order = np.lexsort([chosen.rows, -chosen.distances])
    return chosen.rows[order[:n_points]]


def _lower(level: float, step: float) -> float:
    """Return the next level; zero, with which every place is chosen, once it is negligible."""
    lower = level * max(LEAST_STEP, step)
    return lower if lower > NEGLIGIBLE and lower < level else 0.0


def _round(stored: StoredPoints, parts: list[Part], chosen: Farthest, level: float, each: Each) -> Iterator[Farthest]:
    """Yield what each class of parts chooses down to a level, after what is `chosen`."""
    halo = LEVEL_HALO * level if math.isfinite(level) else 0.0
    settled, known = np.zeros(len(stored.boxes), dtype=np.bool_), chosen.places
    for some in classes(parts, halo):
        asked = [_Asked(part, known[within(known, part.low - halo, part.high + halo)]) for part in some]
        found = list(each(partial(_choose, stored, level, halo, settled), asked))
        added = Farthest._make(map(np.concatenate, zip(*found, strict=True)))
        known = np.concatenate([known, added.places])
        settled = settled.copy()
        for part in some:
            settled[part.first : part.last] = True
        yield added


class _Asked(NamedTuple):
    """A part, and what is chosen in it and its halo, (n, 3)."""

    part: Part
    others: NDArray[np.float64]


def _choose(stored: StoredPoints, level: float, halo: float, settled: NDArray[np.bool_], asked: _Asked) -> Farthest:
    """Choose the points of a part that are at least as far as `level` from others; none in boxes that are `settled`."""
    near = stored.near(asked.part, halo)
    open_ = np.flatnonzero(~settled[stored.boxes.box_of(near.points)])
    places = near.points[open_]
    found, distances = farthest_points(places, len(places), others=asked.others, least=max(level, NEGLIGIBLE))
    inside = near.inside[open_[found]]
    found = found[inside]
    return Farthest(near.rows[open_[found]], places[found], distances[inside])
