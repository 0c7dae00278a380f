"""Signs of normals, told by patches: parts of a surface that many neighbours join, where one alone may err."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from gppcs.meshing.fans import STEEPEST
from gppcs.meshing.halfedges import Flags, Floats, Ints


def turned_patches(triangles: Ints, points: Floats, normals: Floats, near: Ints) -> Flags:
    """Tell which normals of points, (n, 3), must be turned so that patches agree where they meet.

    Triangles, on which all fans agree, join points to patches, whose normals agree; any other point is a patch by
    itself. Whether two patches agree is told by all points of one whose nearest ones, (n, k), are of the other. Signs
    are passed on along a spanning tree, first where most points tell the same. The largest patch of a tree keeps its
    sign.
    """
    ends = np.concatenate([triangles[:, :2], triangles[:, 1:]]).T
    patches, patch = _components(ends, len(points))
    pairs, agreement = _agreements(patch, points, normals, near)
    sums = coo_array((agreement, np.sort(patch[pairs], axis=0)), shape=(patches, patches)).tocsr()
    sums.eliminate_zeros()
    a, b = minimum_spanning_tree(-abs(sums)).nonzero()
    differ = patches * (sums[a, b] < 0.0)
    twice = np.concatenate([[a, b + differ], [a + patches, b + patches - differ]], axis=1)
    _, side = _components(twice, 2 * patches)
    _, tree = _components(np.array([a, b]), patches)
    by_size = np.argsort(np.bincount(patch), kind="stable")
    largest = np.empty(patches, dtype=np.int64)
    largest[tree[by_size]] = by_size
    turned: Flags = side[:patches] != side[largest[tree]]  # each patch is there twice, as it is and turned
    return turned[patch]


def _components(ends: Ints, n: int) -> tuple[int, Ints]:
    """Return the number of connected parts of a graph with edges between `ends`, (2, e), and the part of each node."""
    graph = coo_array((np.ones(ends.shape[1]), ends), shape=(n, n))
    count, part = connected_components(graph, directed=False)
    return count, part


def _agreements(patch: Ints, points: Floats, normals: Floats, near: Ints) -> tuple[Ints, Floats]:
    """Return pairs of near points of different patches, (2, p), on one sheet, and the cosines between their normals."""
    i, j = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    met = patch[i] != patch[j]
    i, j = i[met], j[met]
    step = points[j] - points[i]
    flat = np.einsum("ij,ij->i", step, normals[i]) ** 2 <= STEEPEST**2 * (step**2).sum(axis=1)
    i, j = i[flat], j[flat]
    return np.array([i, j]), np.einsum("ij,ij->i", normals[i], normals[j])
