"""Move vertices so that the mesh fits the dense points (Hoppe et al. 1993, by steps of Gauss and Newton)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment, corners_from
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints, following
from gppcs.spatial.triangles import area_vector, dot, row, unit

SLIDE = 0.02  # weight of a point's step along the mesh, which costs no distance, beside that off the mesh
PULL = 0.001  # weight with which a vertex is held where it is, in mean weights of a vertex
PULL_ALONE = 0.5  # the same on borders, beyond which no points hold a vertex, and without points near a vertex
NEAR = 0.4  # least weight of the vertex in a point that is near it
LEAST_COSINE = 0.2  # between a triangle's normal and the mean of its corners' after a move
THIN = 0.2  # steps that make triangles of a lower quality are shortened
ON_EDGE, ON_FOOT = 1e-9, 1e-24  # a foot with a weight below the first is on an edge; squared distances that are none
MOST_ITERATIONS = 100  # of conjugate gradients
HALVINGS, UNDO_ROUNDS = 4, 4  # of steps that turn triangles over, and then of undoing them


class Equations(NamedTuple):
    """The normal equations of a step, (V, 3): a symmetric matrix in blocks of 3 x 3, and the right side."""

    own: Floats  # (V, 3, 3): the block of each vertex
    beside: Floats  # (3 F, 3, 3): that of the ends of each half-edge, from the points of its triangle
    right: Floats  # (V, 3)
    totals: Floats  # (V,): the sum of squared weights of each vertex
    largest: Floats  # (V,): its largest weight in a point


@one_blas_thread()
def fitted(mesh: HalfEdges, vertices: Floats, normals: Floats, points: Floats, assigned: Assignment) -> Floats:
    """Return vertices after one step towards the least sum of squared distances between dense points and triangles.

    A step off the triangle at a point's foot changes its distance; one along it hardly does, as the foot slides.
    """
    size, halves = len(vertices), len(mesh.origin)
    sums = Equations(
        np.zeros((size, 3, 3)), np.zeros((halves, 3, 3)), np.zeros((size, 3)), np.zeros(size), np.zeros(size)
    )
    _add_points(mesh, vertices, points, assigned, sums)
    pull = np.full(size, PULL)
    pull[mesh.origin[(mesh.opposite < 0) & (mesh.origin >= 0)]] = PULL_ALONE
    pull[sums.largest < NEAR] = PULL_ALONE
    pull *= sums.totals.sum() / np.count_nonzero(mesh.leaving >= 0)
    own = sums.own + pull[:, None, None] * np.eye(3)
    inverse = np.linalg.inv(own)

    def multiplied(steps: Floats) -> Floats:
        found = np.einsum("ijk,ik->ij", own, steps.reshape(-1, 3))
        _add_beside(mesh, sums.beside, steps.reshape(-1, 3), found)
        return found.ravel()

    def conditioned(steps: Floats) -> Floats:
        return np.einsum("ijk,ik->ij", inverse, steps.reshape(-1, 3)).ravel()

    matrix, nearly_inverse = (
        LinearOperator((3 * size, 3 * size), each, dtype=np.float64) for each in (multiplied, conditioned)
    )
    steps, _ = cg(matrix, sums.right.ravel(), rtol=1e-6, maxiter=MOST_ITERATIONS, M=nearly_inverse)
    moved = vertices + steps.reshape(-1, 3)
    undo_turns(mesh.faces(), vertices, normals, moved)
    return moved


@kernel(allocates=False)
def _add_points(mesh, vertices, points, assigned, sums):
    """Add all dense points to sums that are zero: the distance of each in the direction in which it grows.

    That is the triangle's normal where the foot is inside, else the direction to the point.
    """
    for i in range(len(points)):
        f = assigned.face[i]
        if f < 0:
            continue
        a, b, c = corners_from(mesh, vertices, f, row(points, i))
        s, t = assigned.weights[i, 0], assigned.weights[i, 1]
        shares = 1.0 - s - t, s, t
        off = (
            -(shares[0] * a[0] + s * b[0] + t * c[0]),
            -(shares[0] * a[1] + s * b[1] + t * c[1]),
            -(shares[0] * a[2] + s * b[2] + t * c[2]),
        )
        outside = min(shares[0], s, t) < ON_EDGE and dot(off, off) > ON_FOOT
        across = unit(off if outside else area_vector(a, b, c))
        along = (1.0 - SLIDE) * dot(off, across)
        for k in range(3):
            h = 3 * f + k
            v, share = mesh.origin[h], shares[k]
            _add_block(sums.own[v], share * share, across)
            _add_block(sums.beside[h], share * shares[(k + 1) % 3], across)
            for axis in range(3):
                sums.right[v, axis] += share * (along * across[axis] + SLIDE * off[axis])
            sums.totals[v] += share * share
            sums.largest[v] = max(sums.largest[v], share)


@kernel(allocates=False)
def _add_block(block, weight, across):
    """Add what a point asks of two vertices to their block, (3, 3)."""
    for i in range(3):
        for j in range(3):
            block[i, j] += (1.0 - SLIDE) * weight * across[i] * across[j]
        block[i, i] += SLIDE * weight


@kernel(allocates=False)
def _add_beside(mesh, beside, steps, found):
    """Add the products of the blocks of half-edges, (3 F, 3, 3), with steps of vertices, (V, 3), to `found`, (V, 3)."""
    for h in range(len(beside)):
        v = mesh.origin[h]
        if v < 0:
            continue
        w = mesh.origin[following(h)]
        for i in range(3):
            for j in range(3):
                found[v, i] += beside[h, i, j] * steps[w, j]
                found[w, i] += beside[h, i, j] * steps[v, j]


def undo_turns(faces: Ints, vertices: Floats, normals: Floats, moved: Floats) -> None:
    """Halve steps in `moved`, (V, 3), that make triangles thin; also undo those that turn them against the normals."""
    cosines, qualities = _shapes(faces, vertices, normals)
    least, thinnest = np.minimum(LEAST_COSINE, cosines), np.minimum(THIN, qualities)
    for share in (*[0.5] * HALVINGS, *[0.0] * UNDO_ROUNDS):
        cosines, qualities = _shapes(faces, moved, normals)
        worse = np.unique(faces[(cosines < least) | ((qualities < thinnest) & (share > 0.0))])
        if not len(worse):  # nor are any in a later round
            return
        moved[worse] = vertices[worse] + share * (moved[worse] - vertices[worse])


def _shapes(faces: Ints, vertices: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Return the cosine between the normal of each triangle and the mean of its corners' normals, and its quality."""
    a, b, c = (vertices[corner] for corner in faces.T)
    upright, mean = np.cross(b - a, c - a), normals[faces].sum(axis=1)
    area = np.linalg.norm(upright, axis=1)
    length = area * np.linalg.norm(mean, axis=1)
    squared = ((b - a) ** 2 + (c - b) ** 2 + (a - c) ** 2).sum(axis=1)
    cosines = np.einsum("ij,ij->i", upright, mean) / np.where(length > 0.0, length, 1.0)
    return cosines, 2.0 * np.sqrt(3.0) * area / np.where(squared > 0.0, squared, 1.0)
