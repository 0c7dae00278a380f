"""A mesh of dense points while it is made: each step changes the mesh, and what belongs to its vertices with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gppcs.clouds.mesh import Mesh
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.collapse import collapse
from gppcs.meshing.cuts import cutting
from gppcs.meshing.dense import DensePoints
from gppcs.meshing.exchange import exchange
from gppcs.meshing.fit import fitted, undo_turns
from gppcs.meshing.flips import flip, qualities
from gppcs.meshing.halfedges import Flags, Floats, HalfEdges, Ints
from gppcs.meshing.mending import cut_out, mend, relax
from gppcs.meshing.quadrics import add_borders, dense_quadrics, nearest_vertices
from gppcs.meshing.refinement import split, worst_places
from gppcs.meshing.stars import Surface
from gppcs.surface.inducing import joint_steps, noise_between

THIN_COST = 5.0  # what flips may cost at first to remove a thin triangle, in mean squared distances of its points
THIN, MOST_THIN = 0.2, 0.012  # triangles below this quality are thin; while more than this share is, they cost
DEARER = 2.0  # times as much
FITS = 2  # of all vertices together, after an exchange
CANDIDATES = 4  # places at which a vertex is tried, for each that is missing
RELAXATIONS = 12  # at most, of triangles that still cut others
MEND_TRIES = 4  # of mending; before all but the first, vertices are added


@dataclass
class Draft:
    """A mesh between dense points."""

    dense: DensePoints
    moved: bool  # whether vertices may leave the points
    level: Ints  # (V,): the dense point of each vertex
    kept: Flags  # (V,): vertices that are never removed
    mesh: HalfEdges
    vertices: Floats  # (V, 3)
    normals: Floats  # (V, 3)
    start: Ints  # (n,): a vertex near each dense point, -1 if there is none on its sheet
    extra: float = 0.0  # cost of a triangle without area in flips; 0 before the first flips

    @classmethod
    def of(cls, dense: DensePoints, moved: bool, level: Ints, kept: Flags, faces: Ints) -> Draft:
        """Begin with a mesh of some dense points."""
        places, normals = dense.places[level], dense.normals[level]
        mesh = HalfEdges.of(faces, len(level))
        start = nearest_vertices(dense.places, dense.normals, places, normals, np.flatnonzero(mesh.leaving >= 0))
        vertices = places if moved else dense.raw[level]
        return cls(dense, moved, level, kept, mesh, vertices, normals, start)

    def copy(self) -> Draft:
        """Return a draft that can be changed without changing this one."""
        mesh = HalfEdges(*(part.copy() for part in self.mesh))
        return replace(self, level=self.level.copy(), kept=self.kept.copy(), mesh=mesh, vertices=self.vertices.copy())

    def used(self) -> int:
        """Return the number of vertices that triangles join."""
        return int(np.count_nonzero(self.mesh.leaving >= 0))

    def used_and_kept(self) -> int:
        """Return the number of these that are never removed."""
        return int(np.count_nonzero(self.kept & (self.mesh.leaving >= 0)))

    def assigned(self) -> Assignment:
        """Return the triangles of the dense points."""
        return Assignment.of(self.mesh, self.vertices, self.dense.places, self.dense.normals, self.start)

    def assigned_on_any_sheet(self) -> Assignment:
        """Return the nearest triangles, on any sheet, of the dense points where the cloud has them."""
        return Assignment.on_any_sheet(self.mesh, self.vertices, self.dense.raw)

    def collapse(self, target: int, faces: bool, advanced: Callable[[int], None] | None = None) -> None:
        """Remove vertices by quadrics until few enough are left; see `collapse.collapse` for the arguments."""
        density = len(self.start) / self.used()
        quadrics = dense_quadrics(self.dense.places, self.dense.normals, self.vertices, self.start)
        add_borders(self.mesh, self.vertices, density, quadrics)
        into = collapse(
            self.mesh, self.vertices, self.normals, quadrics, target, self.kept, density, faces, advanced
        )  # fmt: skip
        self._go(into)

    def _go(self, into: Ints) -> None:
        """Let the starts follow the vertices that went into others."""
        self.start = np.where(self.start >= 0, into[self.start], -1)

    def flip(self, assigned: Assignment | None = None) -> Assignment:
        """Flip edges, and return the triangles of the dense points; while many are thin, these cost more next time."""
        assigned = assigned or self.assigned()
        if self.extra == 0.0:
            self.extra = THIN_COST * float(assigned.squared.sum()) / len(self.mesh.faces())
        flip(self.mesh, self.vertices, self.normals, self.dense.places, assigned, self.extra)
        if self.thin() > MOST_THIN:
            self.extra *= DEARER
        return assigned

    def thin(self) -> float:
        """Return the share of triangles that are thin."""
        return float((qualities(self.mesh, self.vertices) < THIN).mean())

    def fit(self, assigned: Assignment) -> Assignment:
        """Move the vertices so that the mesh fits the dense points better, and return the triangles of these."""
        before = self.vertices
        self.vertices = fitted(self.mesh, before, self.normals, self.dense.places, assigned)
        after = self.assigned()
        if after.mean_square() <= assigned.mean_square():
            return after
        self.vertices = before
        return assigned

    def explain_observed(self, assigned: Assignment) -> None:
        """Move the vertices to where they explain the dense points best as the cloud has them, without new cuts.

        Projections onto the surface are smoothed.
        """
        there, corners = self._corners_of(assigned)
        raw, faces = self.dense.raw[there], self.mesh.faces()
        noise = noise_between(raw, self.dense.places[there])
        spacing = float(np.sqrt(Mesh(self.vertices, faces).face_areas().sum() / self.used()))
        moved = self.vertices + joint_steps(self.vertices, corners, assigned.weights[there], raw, noise, spacing)
        while True:
            undo_turns(faces, self.vertices, self.normals, moved)
            if not len(cut := cutting(self.mesh, moved)):
                break
            corners = self.mesh.origin.reshape(-1, 3)[cut]
            moved[corners] = self.vertices[corners]
        self.vertices = moved

    def _corners_of(self, assigned: Assignment) -> tuple[Ints, Ints]:
        """Return the dense points that have a triangle, (m,), and its corners, (m, 3)."""
        there = np.flatnonzero(assigned.face >= 0)
        return there, self.mesh.origin.reshape(-1, 3)[assigned.face[there]]

    def exchanged(self, assigned: Assignment) -> tuple[Draft, Assignment]:
        """Return a draft in which vertices have gone to where they help more, and the triangles of the dense points.

        The triangles given are changed.
        """
        other = self.copy()
        mesh = other.mesh
        surface = Surface.of(mesh, other.vertices, self.dense.places, assigned)
        exchange(surface, other.level, self.extra)
        other.normals = self.dense.normals[other.level]
        other.start = np.where(assigned.face >= 0, mesh.origin[3 * assigned.face], -1)
        after = other.flip()
        for _ in range(FITS):
            after = other.flip(other.fit(after))
        return other, after

    def refine(self, count: int, assigned: Assignment) -> None:
        """Add vertices where the dense points are farthest off their triangles, in at most so many of these."""
        self._insert(assigned, *worst_places(self.mesh, assigned, self._unused(), count))
        assigned = self.flip()
        there, corners = self._corners_of(assigned)
        squared = ((self.vertices[corners] - self.dense.places[there, None]) ** 2).sum(axis=2)
        self.start[there] = np.take_along_axis(corners, squared.argmin(axis=1)[:, None], axis=1)[:, 0]

    def _unused(self) -> Flags:
        """Return which dense points are not vertices of the mesh."""
        unused = np.ones(len(self.start), dtype=np.bool_)
        unused[self.level[self.mesh.leaving >= 0]] = False
        return unused

    def _insert(self, assigned: Assignment, faces: Ints, points: Ints) -> None:
        """Split triangles, ascending, each by a dense point."""
        first = len(self.level)
        new = np.full(len(self.mesh.origin) // 3, -1)
        new[faces] = first + np.arange(len(faces))
        inside = (assigned.face >= 0) & (new[assigned.face] >= 0)
        self.start[inside] = new[assigned.face[inside]]
        self.mesh = split(self.mesh, faces, first)
        places = self.dense.places if self.moved else self.dense.raw
        self.level = np.concatenate([self.level, points])
        self.kept = np.concatenate([self.kept, np.zeros(len(points), dtype=np.bool_)])
        self.vertices = np.concatenate([self.vertices, places[points]])
        self.normals = np.concatenate([self.normals, self.dense.normals[points]])

    def compact(self) -> None:
        """Forget the vertices that no triangle joins."""
        used = np.flatnonzero(self.mesh.leaving >= 0)
        number = np.full(len(self.level), -1)
        number[used] = np.arange(len(used))
        self.start = np.where(self.start >= 0, number[self.start], -1)
        self.level, self.kept = self.level[used], self.kept[used]
        self.vertices, self.normals = self.vertices[used], self.normals[used]
        self.mesh = HalfEdges.of(number[self.mesh.faces()], len(used))

    def mend(self, counts_faces: bool) -> int:
        """Mend triangles that cut others, so that none does; other vertices take the place of those removed."""
        vertices, triangles, holes = self.used(), len(self.mesh.faces()), 0
        for tries in reversed(range(MEND_TRIES)):
            cut = self._mended()
            faces = self.mesh.faces()
            if len(cut):
                faces, opened = cut_out(self.mesh, self.vertices, self.normals)
                holes += opened
            self.mesh = HalfEdges.of(faces, len(self.level))
            missing = (triangles - len(faces)) // 2 if counts_faces else vertices - self.used()
            if missing <= 0 or not tries or self.kept.any():
                break
            self._add(missing)
        return holes

    def _mended(self) -> Ints:
        """Mend triangles that cut others, and relax what still does; return the triangles that no round has helped.

        Their corners go back.
        """
        before = self.vertices.copy()
        for more in reversed(range(RELAXATIONS + 1 if self.moved else 1)):
            into, cut = mend(self.mesh, self.vertices, self.normals, self.kept)
            self._go(into)
            if not len(cut) or not more:
                break
            relax(self.mesh, self.vertices, cut)
        corners = self.mesh.origin.reshape(-1, 3)[cut]
        self.vertices[corners] = before[corners]
        return cut

    def _add(self, count: int) -> None:
        """Add vertices where the dense points are farthest off, and where the new triangles cut none."""
        assigned = self.assigned()
        faces, points = worst_places(self.mesh, assigned, self._unused(), CANDIDATES * count)
        places = self.dense.places if self.moved else self.dense.raw
        trial = split(self.mesh, faces, len(self.level))
        cut = cutting(trial, np.concatenate([self.vertices, places[points]]))
        spoilt = np.isin(len(self.level) + np.arange(len(points)), trial.origin.reshape(-1, 3)[cut])
        there = assigned.face >= 0
        sums = np.bincount(assigned.face[there], assigned.squared[there], minlength=len(self.mesh.origin) // 3)
        worst_first = np.argsort(-sums[faces], kind="stable")
        best = np.sort(worst_first[~spoilt[worst_first]][:count])
        self._insert(assigned, faces[best], points[best])
