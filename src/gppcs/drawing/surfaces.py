"""The surface through the points of a sparse cloud, which shows its shape where discs would hide it."""

from typing import NamedTuple

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.estimates import are_on_lines
from gppcs.errors import GppcsError
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised

MAX_DENSE = 1_000_000  # points that a surface is made from; of more, it would take minutes
PER_VERTEX, ENOUGH = 4, 40_000  # points for each vertex that a surface is made from, and of all, if there are so many
MAX_SPARSE = 10_000  # points of a cloud whose discs would hide its shape in a picture of usual size
MIN_COVERED = 0.9  # fraction of the points that have to lie on it: of trees and wires, points show more
NOISY = 0.15  # noise, in median edges of a surface, above which its triangles turn every way


class Surface(NamedTuple):
    """A surface through points, and their noise in median lengths of its edges; 0 if it is too small to count."""

    mesh: Mesh
    noise: float

    @property
    def is_noisy(self) -> bool:
        """Whether points show more, as noise turns the triangles every way."""
        return self.noise > NOISY


def surface_through(cloud: PointCloud, original: PointCloud | None = None) -> Surface | None:
    """Return a mesh whose vertices are M points, joined as the original is if that is there.

    None if there are none, if most lie on no surface, or if the original is too large.
    """
    from gppcs.meshing.pipeline import mesh  # only here, as it is slow to load

    dense = cloud if original is None else original
    is_finite = dense.is_finite()
    cloud = cloud[cloud.is_finite()]
    if not len(cloud) or not 0 < np.count_nonzero(is_finite) <= MAX_DENSE:
        return None
    dense = dense[is_finite]
    local, frame = normalised(dense.points, dense.units)
    distinct = np.flatnonzero(first_occurrences(local))
    tree = KdTree.build(local[distinct])
    nearest = distinct[tree.nearest_of(frame.near(cloud.points), 1)[0][:, 0]]
    step = max(1, len(distinct) // max(PER_VERTEX * len(cloud), ENOUGH))
    indices = np.union1d(distinct[tree.order[tree.one_of_each(step)]], nearest)
    try:
        result = mesh(dense.take(indices), keep=np.searchsorted(indices, np.unique(nearest)))
    except GppcsError:  # there are too few points, or they lie on no surface
        return None
    at = indices[result.indices]
    order = np.argsort(at)
    position = order[np.searchsorted(at[order], nearest).clip(max=len(order) - 1)]
    is_vertex = at[position] == nearest
    if is_vertex.mean() < MIN_COVERED:
        return None
    vertices = result.mesh.vertices.copy()
    vertices[position[is_vertex]] = cloud.points[is_vertex]  # methods may have moved them
    wires = are_on_lines(tree, frame.near(dense.points[at]))
    faces = result.mesh.faces[~wires[result.mesh.faces].all(axis=1)]
    corners = result.mesh.vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    noise = result.diagnostics.noise
    return Surface(Mesh(vertices, faces), noise / float(np.median(edges)) if noise and len(faces) else 0.0)


def surface_of_few(cloud: PointCloud) -> Surface | None:
    """Return the surface through the points of a sparse cloud; None if it is dense, or there is none."""
    return surface_through(cloud) if np.count_nonzero(cloud.is_finite()) <= MAX_SPARSE else None
