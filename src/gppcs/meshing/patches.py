"""Signs of normals, by patches: parts of a surface that many neighbours join, where one alone may err."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from gppcs.clouds.topology import connected
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.meshing.fans import STEEPEST


def turned_patches(triangles: Ints, points: Floats, normals: Floats, near: Ints) -> Flags:
    """Return which normals, (n, 3), to turn so that patches, by the majority of near points, (n, k), agree."""
    patches, patch = connected(triangles[:, :2].ravel(), triangles[:, 1:].ravel(), len(points))
    pairs, agreement = _agreements(patch, points, normals, near)
    sums = coo_array((agreement, np.sort(patch[pairs], axis=0)), shape=(patches, patches)).tocsr()
    sums.eliminate_zeros()
    a, b = minimum_spanning_tree(-abs(sums)).nonzero()
    differ = patches * (sums[a, b] < 0.0)
    _, side = connected(np.append(a, a + patches), np.append(b + differ, b + patches - differ), 2 * patches)
    _, tree = connected(a, b, patches)
    by_size = np.argsort(np.bincount(patch), kind="stable")
    largest = np.empty(patches, dtype=np.int64)
    largest[tree[by_size]] = by_size
    turned: Flags = side[:patches] != side[largest[tree]]  # each patch is there twice, as it is and turned
    return turned[patch]


def _agreements(patch: NDArray[np.int32], points: Floats, normals: Floats, near: Ints) -> tuple[Ints, Floats]:
    """Return pairs of near points of different patches, (2, p), on one sheet, and the cosines between their normals."""
    i, j = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    differ = patch[i] != patch[j]
    i, j = i[differ], j[differ]
    step = points[j] - points[i]
    flat = np.einsum("ij,ij->i", step, normals[i]) ** 2 <= STEEPEST**2 * (step**2).sum(axis=1)
    i, j = i[flat], j[flat]
    return np.array([i, j]), np.einsum("ij,ij->i", normals[i], normals[j])
