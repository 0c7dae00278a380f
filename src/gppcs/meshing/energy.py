"""The energy of a mesh: squared distances of the dense points to their triangles, and a cost of thin triangles.

It is that of Hoppe et al. 1993, *Mesh Optimization*, with the cost of thin triangles in the place of springs.
"""

from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.halfedges import HalfEdges, following
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.triangles import cross, dot, minus, quality, row, unit
from gppcs.surface.error_quadrics import NUMBERS, add_plane

THIN_IN_FLIPS = 0.22  # triangles below this quality cost extra
SHARP = 0.5  # a point at the limit of distances costs 1 + SHARP^3 times its squared distance


class FittedMesh(NamedTuple):
    """A mesh, and the dense points of each triangle. Kernels change it in place."""

    mesh: HalfEdges
    vertices: Floats  # (V, 3)
    boundaries: Floats  # (V, 10): quadrics of the planes through boundary edges, which keep these where they are
    points: Floats  # (n, 3)
    assigned: Assignment
    first: Ints  # (F,): a point of each triangle, -1 if it has none
    after: Ints  # (n,): the next point of the same triangle, -1 after the last one
    limit: float  # of the squared distances of points; infinity if there is none
    # With a limit, for the m points with a triangle, in the order of a tree: the squared radius within which a vertex
    # may be whose nearest point this is, (m,), the points, (3, m), and the boxes of the tree, (nodes, 3).
    squared_radii: Floats
    bounded: Floats
    lower: Floats
    upper: Floats

    @classmethod
    def from_points(
        cls,
        mesh: HalfEdges,
        vertices: Floats,
        points: Floats,
        assigned: Assignment,
        limit: float = np.inf,
        squared_radii: Floats | None = None,
    ) -> Self:
        """List the points of each triangle; with a limit of squared distances, the radii bound vertices, too."""
        bounded = assigned.face >= 0 if squared_radii is not None else np.zeros(len(points), dtype=np.bool_)
        radii = np.empty(0) if squared_radii is None else squared_radii[bounded]
        tree = KdTree.over(points[bounded].T)
        boundaries = np.zeros((len(vertices), NUMBERS))
        add_boundaries(mesh, vertices, len(points) / np.count_nonzero(mesh.leaving >= 0), boundaries)
        first, after = np.full(len(mesh.corners()), -1), np.full(len(points), -1)
        boxes = tree.points, tree.lower, tree.upper
        fitted = cls(mesh, vertices, boundaries, points, assigned, first, after, limit, radii, *boxes)
        _list_points(fitted)
        return fitted


@kernel(allocates=False)
def add_boundaries(mesh, vertices, weight, quadrics):
    """Add to the ends of each boundary edge the plane through it that is upright on its triangle."""
    for h in range(len(mesh.origin)):
        if mesh.origin[h] < 0 or mesh.opposite[h] >= 0:
            continue
        v, w = mesh.origin[h], mesh.origin[following(h)]
        edge = minus(row(vertices, w), row(vertices, v))
        third = minus(row(vertices, mesh.origin[following(following(h))]), row(vertices, v))
        normal = unit(cross(edge, cross(edge, third)))
        if dot(normal, normal) > 0.0:
            add_plane(quadrics[v], normal, 0.0, weight)
            add_plane(quadrics[w], normal, 0.0, weight)


@kernel(allocates=False)
def _list_points(fitted):
    """Fill the lists of the points of each triangle, which are empty."""
    for i in range(len(fitted.points)):
        f = fitted.assigned.face[i]
        if f >= 0:
            fitted.after[i] = fitted.first[f]
            fitted.first[f] = i


@kernel
def price(squared, limit):
    """Return what a squared distance costs: itself, and more the nearer it is to the limit."""
    return squared * (1.0 + (SHARP * squared / limit) ** 3)


@kernel
def thinness(a, b, c):
    """Return by what fraction the quality of a triangle is below `THIN_IN_FLIPS`."""
    return max(0.0, 1.0 - quality(a, b, c) / THIN_IN_FLIPS)
