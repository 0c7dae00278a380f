"""Boxes that divide space, and parts: runs of boxes that are worked on one after another.

The boxes are the leaves of a k-d tree over a sample. So each holds about as many points, wherever a cloud is dense. A
part is a node of that tree with no more points than fit into memory. What is done in a part may look at a *halo*: the
points of other boxes within some distance of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges

MapParts = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]  # Like `map`: results in the order of parts.


class Part(NamedTuple):
    """Some boxes that follow each other."""

    first: int
    last: int  # excluded
    lower: Floats  # (3,), corner of the box around them
    upper: Floats  # (3,)

    def near(self, records: NDArray[Any], width: float) -> NDArray[Any]:
        """Return the records that lie in the part or within some distance of it along each axis."""
        inside = np.empty(len(records), dtype=np.bool_)
        _mark_inside(records["place"], self.lower - width, self.upper + width, inside)
        return records.compress(inside)


@dataclass(frozen=True, eq=False)
class Boxes:
    """A division of a cloud's box into 2^d boxes, the leaves of a perfect binary tree with root 1."""

    axes: Ints  # (nodes,), the axis along which a node is cut
    cuts: Floats  # (nodes,): Where it is cut. Points on the cut belong to the upper child.
    lower: Floats  # (2 nodes, 3), lower corners of all nodes, the last half of which are the boxes; row 0 is unused
    upper: Floats  # (2 nodes, 3)

    @classmethod
    def from_sample(cls, sample: Floats, count: int) -> Boxes:
        """Divide space so that each box holds about as many points of a sample. Shapes: sample (n, 3)."""
        axes, cuts = np.zeros(count, dtype=np.int64), np.zeros(count)
        lower, upper = np.empty((2, 2 * count, 3))
        lower[1], upper[1] = sample.min(axis=0), sample.max(axis=0)
        inside = {1: sample}
        for node in range(1, count):
            points = inside.pop(node)
            sides = np.ptp(points, axis=0) if len(points) else upper[node] - lower[node]
            axis = int(np.argmax(sides))
            cut = float(np.median(points[:, axis])) if len(points) else (lower[node, axis] + upper[node, axis]) / 2.0
            axes[node], cuts[node] = axis, cut
            lower[2 * node : 2 * node + 2], upper[2 * node : 2 * node + 2] = lower[node], upper[node]
            upper[2 * node, axis] = lower[2 * node + 1, axis] = cut
            above = points[:, axis] >= cut
            inside[2 * node], inside[2 * node + 1] = points[~above], points[above]
        return cls(axes, cuts, lower, upper)

    def __len__(self) -> int:
        return len(self.cuts)

    def box_of(self, points: Floats) -> Ints:
        """Return the box, (n,), of each point, (n, 3), from 0; points outside belong to the nearest along each cut."""
        boxes = np.empty(len(points), dtype=np.int64)
        on_ranges(_find_boxes, len(points), points, self.axes, self.cuts, boxes, minimum=1 << 12)
        return boxes

    def parts(self, counts: Ints, maximum: int) -> list[Part]:
        """Return the largest nodes that hold few enough points, by the counts of boxes; none without points."""
        below = np.concatenate([[0], np.cumsum(counts)])
        parts: list[Part] = []
        waiting = [(1, 0, len(self))]
        while waiting:
            node, first, last = waiting.pop()
            held = below[last] - below[first]
            if held > maximum and last - first > 1:
                middle = (first + last) // 2
                waiting += [(2 * node + 1, middle, last), (2 * node, first, middle)]
            elif held:
                parts.append(Part(first, last, self.lower[node], self.upper[node]))
        return parts

    def around(self, part: Part, width: float) -> Ints:
        """Return the boxes outside a part that are within some distance of it along each axis. Shapes: returns (n,)."""
        lower, upper = self.lower[len(self) :], self.upper[len(self) :]
        near = np.asarray(((lower <= part.upper + width) & (upper >= part.lower - width)).all(axis=1))
        near[part.first : part.last] = False
        return np.flatnonzero(near)


@kernel(allocates=False)
def _mark_inside(points, lower, upper, inside):
    """Fill `inside`, (n,), with whether points, (n, 3), lie in a box."""
    for i in range(len(points)):
        inside[i] = True
        for axis in range(3):
            inside[i] &= lower[axis] <= points[i, axis] <= upper[axis]


@kernel(allocates=False)
def _find_boxes(begin, end, points, axes, cuts, boxes):
    """Fill `boxes`, (n,), for a range of points, (n, 3), by the cuts of the nodes."""
    for i in range(begin, end):
        node = 1
        while node < len(cuts):
            node = 2 * node + (1 if points[i, axes[node]] >= cuts[node] else 0)
        boxes[i] = node - len(cuts)


def classes(parts: Sequence[Part], width: float) -> list[list[Part]]:
    """Divide parts into classes so that no two of a class are within some distance of each other."""
    lower, upper = np.array([part.lower for part in parts]), np.array([part.upper for part in parts])
    of_part = np.empty(len(parts), dtype=np.int64)
    for i in range(len(parts)):
        near = ((lower[:i] <= upper[i] + width) & (upper[:i] >= lower[i] - width)).all(axis=1)
        taken = set(of_part[:i][near].tolist())
        of_part[i] = next(number for number in range(len(parts)) if number not in taken)
    return [
        [part for part, number in zip(parts, of_part, strict=True) if number == k] for k in range(of_part.max() + 1)
    ]


def chosen_by_classes(
    boxes: Boxes,
    parts: Sequence[Part],
    halo: float,
    map_parts: MapParts,
    choose: Callable[[Flags, tuple[Part, NDArray[Any]]], NDArray[Any]],
    chosen: NDArray[Any],
) -> NDArray[Any]:
    """Return records of chosen points, (n,), and behind them of those that each part adds.

    Parts of a class choose at once, and classes after each other. `choose` gets the boxes that are settled, in which
    no more points may be chosen, a part, and the records of the points that are chosen in it and its halo.
    """
    settled = np.zeros(len(boxes), dtype=np.bool_)
    for members in classes(parts, halo):
        tasks = [(part, part.near(chosen, halo)) for part in members]
        chosen = np.concatenate([chosen, *map_parts(partial(choose, settled), tasks)])
        settled = settled.copy()
        for part in members:
            settled[part.first : part.last] = True
    return chosen
