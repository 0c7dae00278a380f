"""Boxes that divide space, and tiles: runs of boxes that are worked on one after another.

The boxes are the leaves of a k-d tree over a sample. So each holds about as many points, wherever a cloud is dense. A
tile is a node of that tree. What is done in a tile may look at a *halo*: the points within some distance of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges

BOXES = 1 << 14  # Boxes at most.
SAMPLED_PER_BOX, POINTS_PER_BOX = 16, 1024  # At least.
FLAT = 0.25  # Of the mean distance of coordinates: where they are nearer to each other, points lie on a face.


class Tile(NamedTuple):
    """Some boxes that follow each other."""

    first: int
    last: int  # excluded
    lower: Floats  # (3,), corner of the box around them
    upper: Floats  # (3,)


@dataclass(frozen=True, eq=False)
class Boxes:
    """A division of a cloud's box into 2^d boxes, the leaves of a perfect binary tree with root 1."""

    axes: Ints  # (nodes,), the axis along which a node is cut
    cuts: Floats  # (nodes,), where it is cut: points on the cut belong to the upper child
    lower: Floats  # (2 nodes, 3), lower corners of all nodes, the last half of which are the boxes; row 0 is unused
    upper: Floats  # (2 nodes, 3)

    @classmethod
    def from_sample(cls, sample: Floats, lowest: Floats, highest: Floats, n_points: int) -> Boxes:
        """Divide the box between two corners, (3,), into boxes with about as many points of a sample, (n, 3), each."""
        at_most = min(BOXES, len(sample) // SAMPLED_PER_BOX, n_points // POINTS_PER_BOX)
        count = 1 << max(1, at_most).bit_length() - 1
        axes, cuts = np.zeros(count, dtype=np.int64), np.zeros(count)
        lower, upper = np.empty((2, 2 * count, 3))
        lower[1], upper[1] = lowest, highest
        inside = {1: sample}
        for node in range(1, count):
            points = inside.pop(node)
            sides = np.ptp(points, axis=0) if len(points) else upper[node] - lower[node]
            axis = int(np.argmax(sides))
            cut = _cut(points[:, axis]) if len(points) else (lower[node, axis] + upper[node, axis]) / 2.0
            axes[node], cuts[node] = axis, cut
            lower[2 * node : 2 * node + 2], upper[2 * node : 2 * node + 2] = lower[node], upper[node]
            upper[2 * node, axis] = lower[2 * node + 1, axis] = cut
            above = points[:, axis] >= cut
            inside[2 * node], inside[2 * node + 1] = points[~above], points[above]
        return cls(axes, cuts, lower, upper)

    def __len__(self) -> int:
        return len(self.cuts)

    def box_of(self, points: Floats) -> NDArray[np.uint16]:
        """Return the box, (n,), of each point, (n, 3), from 0; points outside belong to the nearest along each cut."""
        boxes = np.empty(len(points), dtype=np.uint16)
        on_ranges(_find_boxes, len(points), points, self.axes, self.cuts, boxes, minimum=1 << 12)
        return boxes

    def tiles(self, counts: NDArray[np.floating[Any]], maximum: float) -> list[Tile]:
        """Return the largest nodes that hold few enough points, by the counts of boxes."""
        below = np.concatenate([[0.0], np.cumsum(counts)])
        tiles: list[Tile] = []
        waiting = [(1, 0, len(self))]
        while waiting:
            node, first, last = waiting.pop()
            if below[last] - below[first] > maximum and last - first > 1:
                middle = (first + last) // 2
                waiting += [(2 * node + 1, middle, last), (2 * node, first, middle)]
            else:
                tiles.append(Tile(first, last, self.lower[node], self.upper[node]))
        return tiles

    def meeting(self, lower: Floats, upper: Floats) -> Flags:
        """Return which boxes, (boxes,), may hold points between two corners, (3,)."""
        own_lower, own_upper = self.lower[len(self) :], self.upper[len(self) :]
        return np.asarray(((own_lower <= upper) & (own_upper >= lower)).all(axis=1))


def _cut(values: Floats) -> float:
    """Return the median of coordinates, (n,), or near it one where fewer lie, if it runs along a face of the cloud."""
    values = np.sort(values)
    n, width = len(values), len(values) // 16
    spans = values[2 * width :] - values[: n - 2 * width]  # around each but the first and last
    middle = n // 2 - width
    if width and spans[middle] < FLAT * 2.0 * width / n * (values[-1] - values[0]):
        first = n // 4 - width
        middle = first + int(np.argmax(spans[first : 3 * n // 4 - width]))
    return float(values[middle + width])


def inside(points: Floats, lower: Floats, upper: Floats) -> Flags:
    """Return which points, (n, 3), lie between two corners, (3,), borders included."""
    return np.all([(x >= a) & (x <= b) for x, a, b in zip(points.T, lower, upper, strict=True)], axis=0)


def neighbours_before(tiles: Sequence[Tile], distance: Floats) -> list[list[int]]:
    """Return of each tile those within a distance, along each axis (3,), that go before it.

    Tiles are coloured so that none has the colour of a neighbour, and go colour by colour: many can go at once.
    """
    lower, upper = np.array([tile.lower for tile in tiles]), np.array([tile.upper for tile in tiles])
    colours = np.full(len(tiles), len(tiles))
    neighbours = []
    for i in range(len(tiles)):
        near = np.flatnonzero(((lower <= upper[i] + distance) & (upper >= lower[i] - distance)).all(axis=1))
        neighbours.append(near)
        colours[i] = np.setdiff1d(np.arange(len(near)), colours[near])[0]
    return [near[colours[near] < colours[i]].tolist() for i, near in enumerate(neighbours)]


@kernel(allocates=False)
def _find_boxes(begin, end, points, axes, cuts, boxes):
    """Fill `boxes`, (n,), for a range of points, (n, 3), by the cuts of the nodes."""
    for i in range(begin, end):
        node = 1
        while node < len(cuts):
            node = 2 * node + (1 if points[i, axes[node]] >= cuts[node] else 0)
        boxes[i] = node - len(cuts)
