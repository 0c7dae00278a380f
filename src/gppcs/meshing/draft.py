"""The arrays of a mesh while it is made, which the stages change."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.meshing.assignment import Assignment, nearest_vertices
from gppcs.meshing.dense import DensePoints
from gppcs.meshing.halfedges import HalfEdges


@dataclass
class Draft:
    """A mesh between dense points, and what belongs to its V vertices and to the n dense points."""

    dense: DensePoints
    moved: bool  # whether vertices may leave the points
    mesh: HalfEdges
    dense_index: Ints  # (V,): the dense point of each vertex
    fixed: Flags  # (V,): vertices that are never removed
    vertices: Floats  # (V, 3)
    normals: Floats  # (V, 3)
    nearest: Ints  # (n,): a vertex near each dense point, -1 if there is none on its sheet
    thin_cost: float = 0.0  # energy of a triangle without area in flips; 0 before the first flips

    @classmethod
    def from_mesh(cls, mesh: HalfEdges, dense: DensePoints, dense_index: Ints, fixed: Flags, moved: bool) -> Self:
        """Begin with a mesh between some dense points."""
        positions, normals = dense.positions[dense_index], dense.normals[dense_index]
        nearest = nearest_vertices(
            dense.positions, dense.normals, positions, normals, np.flatnonzero(mesh.leaving >= 0)
        )
        vertices = positions if moved else dense.raw[dense_index]
        return cls(dense, moved, mesh, dense_index, fixed, vertices, normals, nearest)

    def copy(self) -> Self:
        """Return a draft that can be changed without changing this one."""
        mesh = HalfEdges(*(part.copy() for part in self.mesh))
        changed_in_place = ("dense_index", "fixed", "vertices", "nearest")
        return replace(self, mesh=mesh, **{name: getattr(self, name).copy() for name in changed_in_place})

    @property
    def n_vertices(self) -> int:
        """The number of vertices that triangles join."""
        return int(np.count_nonzero(self.mesh.leaving >= 0))

    @property
    def n_fixed(self) -> int:
        """The number of these that are never removed."""
        return int(np.count_nonzero(self.fixed & (self.mesh.leaving >= 0)))

    def assigned(self) -> Assignment:
        """Return the triangles of the dense points."""
        return Assignment.on_same_sheet(
            self.mesh, self.vertices, self.dense.positions, self.dense.normals, self.nearest
        )

    def reassigned(self, assigned: Assignment, corners: Ints) -> Assignment:
        """Find anew the triangles of dense points that had none, or one of `corners`, (F, 3), that has changed."""
        changed = (self.mesh.corners()[: len(corners)] != corners).any(axis=1)
        stale = np.flatnonzero((assigned.face < 0) | changed[assigned.face])
        anew = Assignment.on_same_sheet(
            self.mesh, self.vertices, self.dense.positions[stale], self.dense.normals[stale], self.nearest[stale]
        )
        for part, of_stale in zip(assigned, anew, strict=True):
            part[stale] = of_stale
        return assigned

    def merge(self, into: Ints) -> None:
        """Let the dense points follow removed vertices to those that these went into, (V,)."""
        self.nearest = np.where(self.nearest >= 0, into[self.nearest], -1)

    def compact(self) -> None:
        """Drop the vertices that no triangle joins."""
        used = np.flatnonzero(self.mesh.leaving >= 0)
        number = np.full(len(self.dense_index), -1)
        number[used] = np.arange(len(used))
        self.merge(number)
        self.dense_index, self.fixed = self.dense_index[used], self.fixed[used]
        self.vertices, self.normals = self.vertices[used], self.normals[used]
        self.mesh = HalfEdges.from_faces(number[self.mesh.faces()], len(used))
