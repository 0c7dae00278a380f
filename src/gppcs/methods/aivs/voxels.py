"""Farthest points voxel by voxel, away from the choice in the voxels around: isotropic AIVS (Lv et al. 2021)."""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.farthest_points import approach, farthest_points

LARGE = 1 << 20  # if a voxel needs more distances than this, a tree is faster


class Voxels(NamedTuple):
    """The points sorted by the occupied voxels of a cubic grid, of which `along` lie along the longest axis.

    `points`, (3, N), and their indices `order` are sorted by voxel; those of a voxel lie between its `begins`. `cells`,
    (voxels, 3), are the numbers of a voxel along the axes; `keys`, (voxels,), make one ascending number of them.
    """

    order: Ints
    points: Floats
    cells: Ints
    keys: Ints
    begins: Ints
    edge: float
    along: int

    @classmethod
    def build(cls, points: Floats) -> Self:
        """Sort points, (N, 3), into voxels."""
        n = len(points)
        # Upper limits of the number of points, and how many voxels the longest axis then has (Lv et al. 2021).
        steps = ((10_000, 10), (50_000, 20), (100_000, 30), (500_000, 40), (1_000_000, 50))
        along = next((voxels for below, voxels in steps if n < below), round(np.cbrt(n / 8)))
        local = points - points.min(axis=0)
        size = float(local.max())
        # Multiplying first makes the bounds of the voxels the same in any unit.
        cells = np.minimum((local * along / size).astype(np.int64), along - 1)
        keys = (cells + 1) @ np.array([(along + 2) ** 2, along + 2, 1])
        order = np.argsort(keys, kind="stable")
        begins = np.flatnonzero(np.diff(keys[order], prepend=-1, append=-1))
        first = order[begins[:-1]]
        return cls(order, local[order].T.copy(), cells[first], keys[first], begins, size / along, along)


def points_of_voxels(points: Floats, n_points: int, on_progress: Callable[[int], None] | None = None) -> Ints:
    """Choose farthest points of (N, 3) in each voxel, as many as its quota, and trim them to M (Lv et al. 2021).

    Points count as chosen before that lie in the voxels around, near enough to the centre. Voxels are processed in
    eight classes, by the parity of their numbers along the axes: those of a class do not touch.
    """
    voxels = Voxels.build(points)
    quotients, remainders = np.divmod(np.diff(voxels.begins) * n_points, len(points))
    quotas = quotients + (5 * remainders > len(points))  # rounded up if the fraction is above one fifth
    parity = voxels.cells % 2 @ np.array([4, 2, 1])
    chosen = _filled(voxels, quotas, parity, on_progress)
    voxel = np.repeat(np.arange(len(quotas)), quotas)
    rank = np.arange(len(voxel)) - np.repeat(np.cumsum(quotas) - quotas, quotas)
    kept = np.flatnonzero(rank < trimmed(quotas, n_points)[voxel])
    kept = kept[np.argsort(parity[voxel[kept]], kind="stable")]
    indices = voxels.order[chosen[kept]]
    if len(indices) < n_points:
        unchosen = np.delete(np.arange(len(points)), indices)
        more, _ = farthest_points(points[unchosen], n_points - len(indices), before=points[indices])
        indices = np.concatenate([indices, unchosen[more]])
    return indices


def trimmed(counts: Ints, n_points: int) -> Ints:
    """Reduce the counts of all voxels, (voxels,), until their sum is at most M (Lv et al. 2021), many rounds at once.

    In a round, all even and then all odd voxels above a threshold lose one point. The threshold starts at a third of
    the range of the counts, and decreases by one after a round in which no voxel loses a point.
    """
    counts, excess, threshold = counts.copy(), int(counts.sum()) - n_points, int(counts.max() - counts.min()) // 3
    turns = np.argsort(np.arange(len(counts)) % 2, kind="stable")
    while excess > 0:
        threshold = min(threshold, int(counts.max()) - 1)
        above = turns[counts[turns] > threshold]
        rounds = max(1, min(excess // len(above), int(counts[above].min()) - threshold))  # in which all of these lose
        counts[above[:excess]] -= rounds
        excess -= rounds * len(above)
    return counts


def _filled(voxels: Voxels, quotas: Ints, parity: Ints, on_progress: Callable[[int], None] | None) -> Ints:
    """Return the positions of the points chosen in each voxel, voxel after voxel, (sum of quotas,)."""
    starts = np.append(0, np.cumsum(quotas))
    chosen = np.full(starts[-1], -1, dtype=np.int64)
    large = np.diff(voxels.begins) * quotas > LARGE
    for number in range(8):
        of_class = (parity == number) & (quotas > 0)
        small = np.flatnonzero(of_class & ~large)
        on_ranges(_fill, len(small), voxels, small, starts, chosen)
        for voxel in np.flatnonzero(of_class & large):
            _fill_large(voxels, int(voxel), starts, chosen)
        if on_progress:
            on_progress(1)
    return chosen


def _fill_large(voxels: Voxels, voxel: int, starts: Ints, chosen: Ints) -> None:
    """Choose the points of one large voxel as `_fill` does, but with a tree."""
    begin, end = voxels.begins[voxel : voxel + 2]
    near = _chosen_near(voxels, voxel, starts, chosen)
    quota = int(starts[voxel + 1] - starts[voxel])
    members, before = voxels.points[:, begin:end].T, voxels.points[:, near].T
    first = _nearest_to_centre(voxels, voxel)
    chosen[starts[voxel] : starts[voxel + 1]] = begin + farthest_points(members, quota, first=first, before=before)[0]


@kernel
def _fill(first, last, voxels, subset, starts, chosen):
    """Fill `chosen`, (sum of quotas,), for a range of the voxels `subset`, (m,), which do not touch."""
    points = voxels.points
    for voxel in subset[first:last]:
        begin, end = voxels.begins[voxel], voxels.begins[voxel + 1]
        xs, ys, zs = points[0, begin:end], points[1, begin:end], points[2, begin:end]
        squared = np.full(end - begin, np.inf)
        for other in _chosen_near(voxels, voxel, starts, chosen):
            approach(xs, ys, zs, squared, points[0, other], points[1, other], points[2, other])
        pick = _nearest_to_centre(voxels, voxel)
        for slot in range(starts[voxel], starts[voxel + 1]):
            chosen[slot] = begin + pick
            approach(xs, ys, zs, squared, xs[pick], ys[pick], zs[pick])
            squared[pick] = -1.0
            pick = np.argmax(squared)


@kernel
def _nearest_to_centre(voxels, voxel):
    """Return which point of a voxel is nearest its centre; ties go to the first."""
    begin = voxels.begins[voxel]
    best, nearest = 0, np.inf
    for i in range(begin, voxels.begins[voxel + 1]):
        squared = 0.0
        for axis in range(3):
            squared += (voxels.points[axis, i] - (voxels.cells[voxel, axis] + 0.5) * voxels.edge) ** 2
        if squared < nearest:
            best, nearest = i - begin, squared
    return best


@kernel
def _chosen_near(voxels, voxel, starts, chosen):
    """Return the positions of the points chosen in the 26 voxels around that are near enough to the centre, (n,)."""
    near = []
    row = voxels.along + 2
    for step in range(27):
        key = voxels.keys[voxel] + ((step // 9 - 1) * row + step // 3 % 3 - 1) * row + step % 3 - 1
        other = np.searchsorted(voxels.keys, key)
        if other == voxel or other == len(voxels.keys) or voxels.keys[other] != key:
            continue
        for i in chosen[starts[other] : starts[other + 1]]:
            offset = 0.0
            for axis in range(3):
                offset = max(offset, abs(voxels.points[axis, i] - (voxels.cells[voxel, axis] + 0.5) * voxels.edge))
            if i >= 0 and offset <= 0.75 * voxels.edge:  # the box that counts is half as large again as a voxel
                near.append(i)
    return np.array(near, dtype=np.int64)
