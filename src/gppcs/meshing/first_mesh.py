"""The first mesh: some of the dense points, evenly spread, joined by the triangles of their fans."""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.errors import NoSurfaceError
from gppcs.meshing.assembly import assembled, without_scraps
from gppcs.meshing.cuts import TriangleTree
from gppcs.meshing.dense import DensePoints
from gppcs.meshing.draft import Draft
from gppcs.meshing.fans import fans_of, turned_patches
from gppcs.meshing.mending import cut_out, mend
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.surface.fans import ON_CIRCLE
from gppcs.surface.normals import EDGES

MIN_PIECE = 12  # triangles of a piece; smaller ones are scraps


def first_mesh(points: Floats, n_vertices: int, fixed: Ints, moved: bool | None, timer: Timer) -> Draft:
    """Return the first mesh of points, (N, 3); where triangles hardly agree, thick noise is tried as the reason.

    Unless it is said whether vertices may leave the points, they do if these are noisy.
    """
    best, best_agreed, mixed = None, 0.0, True
    errors: list[NoSurfaceError] = []
    for near_sheets, thick in ((True, False), (False, False), (False, True)):
        if not (mixed or thick):  # as in the first attempt
            continue
        try:
            with timer("normals"):
                dense = DensePoints.from_points(points, n_vertices, fixed, thick, near_sheets)
            if dense is None:  # there is no thick noise
                continue
            mixed = dense.near_sheets
            with timer("first mesh"):
                draft, agreed = _joined(dense, fixed, moved)
        except NoSurfaceError as error:
            errors.append(error)
            continue
        if best is None or excluded(draft) < excluded(best):
            best, best_agreed = draft, agreed
        if best_agreed >= 0.5:  # the fraction in thick noise may be below; in that of scans, it is at least 0.56
            break
    if best is None:
        raise errors[-1]
    return best


def excluded(first: Draft) -> float:
    """Return the fraction of the points of a first mesh that no triangle joins."""
    return 1.0 - first.n_vertices / len(first.dense_index)


def _joined(dense: DensePoints, fixed: Ints, moved: bool | None) -> tuple[Draft, float]:
    """Join dense points or raise an error; return also the fraction of the fans' triangles that another fan has."""
    joined = dense.joined
    n, positions, cover_radii = len(joined), dense.positions[joined], dense.cover.radii[joined]
    tree = KdTree.over(positions.T)
    near, _ = nearest_others(tree, min(24, n - 1))
    for on_circle in ON_CIRCLE:
        triangles, votes, radii = fans_of(positions, dense.normals[joined], near, on_circle)
        if (agreed := _agreed(votes)) >= 0.38:
            break
    else:
        raise NoSurfaceError(
            f"expected points on a surface, found {n} points of whose triangles only {agreed:.0%} fit together: they "
            "fill a volume, are too few, or have noise thicker than their spacing"
        )
    if dense.uneven:
        turned = turned_patches(triangles[votes == 3], positions, dense.normals[joined], near[:, :EDGES])
        dense = dense.turned(joined, turned, tree)
        triangles, votes, radii = fans_of(positions, dense.normals[joined], near, on_circle)
        agreed = _agreed(votes)
    moved = dense.noise > 0.0 and not dense.joined_sheets if moved is None else moved  # never between two sheets
    normals, is_fixed = dense.normals[joined], np.isin(dense.indices[joined], fixed)
    mesh = assembled(triangles, votes, radii, positions, normals, cover_radii, dense.cover, dense.uneven)
    has_strays = dense.uneven or (dense.near_sheets and dense.noise > 0.0)  # small ones beside the surface
    min_piece = 2 * MIN_PIECE if has_strays else MIN_PIECE
    mesh = without_scraps(mesh, min_piece)
    vertices = positions if moved else dense.raw[joined]
    mend(mesh, vertices, normals, is_fixed, TriangleTree.from_mesh(mesh, vertices), rounds=1)
    mesh, _ = cut_out(mesh, vertices, normals)
    mesh = without_scraps(mesh, min_piece)  # cuts leave some, too
    n_faces, n_joined = len(mesh.faces()), int(np.count_nonzero(mesh.leaving >= 0))
    if not n_faces or (n_faces < MIN_PIECE and 2 * n_joined < n):
        raise NoSurfaceError(
            f"expected points on a surface, found {n} points of which triangles join {n_joined or 'none'}"
        )
    return Draft.from_mesh(mesh, dense, joined, is_fixed, moved), agreed


def _agreed(votes: Ints) -> float:
    """Return the fraction of triangles of fans that another fan has too, from how many have each."""
    return np.count_nonzero(votes > 1) / max(1, len(votes))
