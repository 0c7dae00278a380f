"""Boxes that divide space, and parts: runs of boxes that are worked on one after another.

The boxes are the leaves of a k-d tree over a sample. So each holds about as many points, wherever a cloud is dense. A
part is a node of that tree with no more points than fit into memory. What is done in a part may look at a *halo*: the
points of other boxes within some distance of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Part(NamedTuple):
    """Some boxes that follow each other."""

    # The boxes from `first` to `last`, the latter excluded.
    first: int
    last: int
    # (3,) each, corners of the box around them.
    low: NDArray[np.float64]
    high: NDArray[np.float64]


Each = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]  # Like `map`: results in the order of parts.


@dataclass(frozen=True, eq=False)
class Boxes:
    """A division of a cloud's box into 2^d boxes, the leaves of a perfect binary tree with root 1."""

    axes: NDArray[np.int64]  # (nodes,), the axis along which a node is cut
    cuts: NDArray[np.float64]  # (nodes,): Where it is cut. Points on the cut belong to the upper child.
    # (2 nodes, 3) each, corners of all nodes, with those that are not cut, the boxes; row 0 is unused.
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, sample: NDArray[np.float64], count: int) -> Boxes:
        """Divide space so that each box holds about as many points of a sample. Shapes: sample (n, 3)."""
        axes, cuts = np.zeros(count, dtype=np.int64), np.zeros(count)
        low, high = np.empty((2 * count, 3)), np.empty((2 * count, 3))
        low[1], high[1] = sample.min(axis=0), sample.max(axis=0)
        inside = {1: sample}
        for node in range(1, count):
            points = inside.pop(node)
            sides = np.ptp(points, axis=0) if len(points) else high[node] - low[node]
            axis = int(np.argmax(sides))
            cut = float(np.median(points[:, axis])) if len(points) else (low[node, axis] + high[node, axis]) / 2.0
            axes[node], cuts[node] = axis, cut
            low[2 * node : 2 * node + 2], high[2 * node : 2 * node + 2] = low[node], high[node]
            high[2 * node, axis] = low[2 * node + 1, axis] = cut
            above = points[:, axis] >= cut
            inside[2 * node], inside[2 * node + 1] = points[~above], points[above]
        return cls(axes, cuts, low, high)

    def __len__(self) -> int:
        return len(self.cuts)

    def box_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the box, (n,), of each point, (n, 3), from 0; points outside belong to the nearest along each cut."""
        node, flat, start = np.ones(len(points), dtype=np.int64), points.ravel(), 3 * np.arange(len(points))
        for _ in range(len(self).bit_length() - 1):
            node = 2 * node + (flat[start + self.axes[node]] >= self.cuts[node])
        return node - len(self)

    def parts(self, counts: NDArray[np.int64], most: int) -> list[Part]:
        """Return the largest nodes that hold few enough points, given the counts of boxes; none without points."""
        below = np.concatenate([[0], np.cumsum(counts)])
        found: list[Part] = []
        waiting = [(1, 0, len(self))]
        while waiting:
            node, first, last = waiting.pop()
            held = below[last] - below[first]
            if held > most and last - first > 1:
                middle = (first + last) // 2
                waiting += [(2 * node + 1, middle, last), (2 * node, first, middle)]
            elif held:
                found.append(Part(first, last, self.low[node], self.high[node]))
        return found

    def around(self, part: Part, width: float) -> NDArray[np.int64]:
        """Return the boxes outside a part that are within some distance of it along each axis. Shapes: returns (n,)."""
        low, high = self.low[len(self) :], self.high[len(self) :]
        near = np.asarray(((low <= part.high + width) & (high >= part.low - width)).all(axis=1))
        near[part.first : part.last] = False
        return np.flatnonzero(near)


def classes(parts: Sequence[Part], width: float) -> list[list[Part]]:
    """Divide parts into classes so that no two of a class are within some distance of each other."""
    low, high = np.array([part.low for part in parts]), np.array([part.high for part in parts])
    of_part = np.empty(len(parts), dtype=np.int64)
    for i in range(len(parts)):
        near = ((low[:i] <= high[i] + width) & (high[:i] >= low[i] - width)).all(axis=1)
        taken = set(of_part[:i][near].tolist())
        of_part[i] = next(number for number in range(len(parts)) if number not in taken)
    return [
        [part for part, own in zip(parts, of_part, strict=True) if own == number] for number in range(of_part.max() + 1)
    ]
