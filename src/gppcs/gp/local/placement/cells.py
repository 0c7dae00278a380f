"""The points of the cells, the surface that they observe, and the chosen points with the fans around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.gp.local.candidates import Measured, radius_of_plane
from gppcs.gp.local.settings import MAX_STEP
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.spatial.triangles import dot, minus, row
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.noise import projected
from gppcs.surface.surface_variation import features_in_radius

NEAR = 8  # Others near a chosen point: as its fan has on average, and two more.


class Observed(NamedTuple):
    """The points of the cells, and the surface that they observe."""

    points: Floats  # (3, n)
    feet: Floats  # (3, n), on their planes
    normals: Floats  # (n, 3), of these

    @classmethod
    def around(cls, tree: KdTree, measured: Measured) -> Observed:
        """Return the surface around the points of a tree."""
        points, noise = tree.points, measured.noise
        if noise.is_negligible:
            normals = measured.normals
            if normals is None:
                radius = radius_of_plane(measured.area / len(tree.order))
                normals = features_in_radius(tree.in_own_order(), radius).normals
            return cls(points, points, normals)
        quadrics = noise.fitted(tree) if measured.quadrics is None else measured.quadrics
        return cls(points, projected(points, quadrics), quadrics.normals.T.astype(np.float64, order="C"))


class Attributes(NamedTuple):
    """What counts beside the shape."""

    of_points: NDArray[np.float32]  # (n, k)
    of_vertices: NDArray[np.float32]  # (m, k)


class Vertices(NamedTuple):
    """The chosen points with the fans of triangles around them, in tree order."""

    positions: Floats  # (m, 3)
    corners: NDArray[np.int32]  # (m, triangles, 2), of the fans; -1 after the last
    normals: Floats  # (m, 3), of the fans
    near: Ints  # (m, NEAR), the nearest others
    gaps: Floats  # (m,), mean distance from the three nearest
    steps: Floats  # (m,), how far each may go
    stays: Flags  # (m,)

    @classmethod
    def from_surface(cls, surface: LocalSurface, stays: Flags) -> Vertices:
        """Return the points of a surface."""
        positions = np.ascontiguousarray(surface.tree.points.T)
        near, squared = nearest_others(surface.tree, min(NEAR, len(positions) - 1))
        nearest = np.sqrt(squared[:, :3])
        gaps = nearest.sum(axis=1) / max(1, nearest.shape[1])
        return cls(positions, surface.corners, surface.normals, near, gaps, MAX_STEP * gaps, stays)


class Cells(NamedTuple):
    """The points of each of m owners."""

    members: NDArray[np.int32]  # (n,), owner by owner
    starts: Ints  # (m + 1,), where those of each start


def cells_of(owners: NDArray[np.int32], m: int) -> Cells:
    """Return the cells of m owners, by the owner of each point, (n,)."""
    members, starts = np.empty_like(owners), np.zeros(m + 1, dtype=np.int64)
    _gather(owners, members, starts)
    return Cells(members, starts)


@kernel(allocates=False)
def _gather(owners, members, starts):
    """Fill `members`, (n,), owner by owner, and `starts`, (m + 1,), which are 0."""
    for owner in owners:
        starts[owner] += 1
    total = len(owners)
    for owner in range(len(starts) - 1, -1, -1):  # from counts to ends, which become starts as members are filled in
        total -= starts[owner]
        starts[owner] += total
    for q in range(len(owners) - 1, -1, -1):
        starts[owners[q]] -= 1
        members[starts[owners[q]]] = q


@kernel(allocates=False)
def hand_over(begin, end, observed, chosen, owners):
    """Give a range of points to the nearest of their owner, (n,), and of the corners of its fan."""
    for q in range(begin, end):
        here, owner = row(observed.points.T, q), owners[q]
        step = minus(row(chosen.positions, owner), here)
        smallest = dot(step, step)
        for j, _ in chosen.corners[owners[q]]:
            if j < 0:
                break
            step = minus(row(chosen.positions, j), here)
            if dot(step, step) < smallest:
                smallest, owner = dot(step, step), j
        owners[q] = owner
