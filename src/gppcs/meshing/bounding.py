"""Remove vertices while every point stays within a distance of the mesh, and no triangle comes to cut another."""

from __future__ import annotations

import numpy as np

from gppcs.engine.kernels import kernel
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.cuts import TriangleTree, are_cut, cutting, first_cut, follow
from gppcs.meshing.draft import Draft
from gppcs.meshing.exchange import collapse_edge, collapsed, tried, try_collapses
from gppcs.meshing.flips import flip_edge, is_better, is_flippable, share_out
from gppcs.meshing.halfedges import MOST_AROUND, Flags, Floats, Ints, following, preceding
from gppcs.meshing.stars import Surface, add_around, empty, fit_star, room_for_star, store
from gppcs.spatial.triangles import row

MOST_KEPT = 0.02  # of the vertices, the share that may have to stay when half of all are removed by quadrics
FITS = 2  # of all vertices, before edges are collapsed again
THIN_COST = 0.5  # of a triangle without area, in squared limits of its points


def thinned_by_quadrics(draft: Draft, counted: Flags, limit: float) -> Draft:
    """Return a draft with half of the vertices, again and again, while all points that count, (n,), are near enough.

    Where half of the vertices are too few, or triangles cut others, the vertices stay.
    """
    nearest = draft.assigned_on_any_sheet()
    while True:
        trial = draft.copy()
        trial.collapse(draft.used() // 2, False)
        if trial.used() == draft.used():
            return draft
        found = trial.assigned_on_any_sheet()
        far, cut = counted & (found.squared > limit), cutting(trial.mesh, trial.vertices)
        if not far.any() and not len(cut):
            trial.compact()
            trial.kept[:] = False
            draft, nearest = trial, trial.assigned_on_any_sheet()
            continue
        before = np.count_nonzero(draft.kept)
        draft.kept |= np.isin(trial.start[draft.level], trial.mesh.origin.reshape(-1, 3)[cut])
        draft.kept[draft.mesh.origin.reshape(-1, 3)[nearest.face[far]]] = True
        if not before < np.count_nonzero(draft.kept) <= MOST_KEPT * draft.used():
            return draft


def bound(draft: Draft, counted: Flags, limit: float, rounds: int) -> None:
    """Remove as many vertices as can be while no point that counts, (n,), comes to lie beyond a squared distance.

    Between rounds, edges are flipped and vertices fitted; then more can go.
    """
    found = draft.assigned_on_any_sheet()
    assigned = Assignment(np.where(counted, found.face, -1), found.squared, found.weights)
    surface = Surface.within(draft.mesh, draft.vertices, draft.dense.raw, assigned, limit, draft.dense.cover.reaches**2)
    thin_cost = THIN_COST * limit * np.count_nonzero(counted)
    _collapse_what_can(surface, draft.level, thin_cost)
    for _ in range(rounds):
        for _ in range(FITS):
            _flip_and_fit(surface, draft.dense.normals[draft.level], thin_cost / len(draft.mesh.faces()))
        if not _collapse_what_can(surface, draft.level, thin_cost):
            break
    draft.normals = draft.dense.normals[draft.level]


def _collapse_what_can(surface: Surface, level: Ints, thin_cost: float) -> int:
    """Collapse edges, the cheapest first, until none can; return by how many vertices there are fewer.

    `thin_cost` is what all triangles would cost together if they had no area.
    """
    mesh, removed = surface.mesh, 0
    costs, changed = np.full(len(mesh.origin), np.inf), np.ones(len(mesh.leaving), dtype=np.bool_)
    while True:
        extra = thin_cost / len(mesh.faces())
        edges, ends = surface.mesh.edges(), np.roll(mesh.origin.reshape(-1, 3), -1, axis=1).ravel()
        stale = edges[changed[mesh.origin[edges]] | changed[ends[edges]]]
        costs[stale], changed[:] = tried(try_collapses, surface, stale, extra), False
        order = np.argsort(costs[edges], kind="stable")[: np.count_nonzero(costs[edges] < np.inf)]
        tree = TriangleTree.of(mesh, surface.vertices)
        count = _collapse_all(surface, tree, edges[order], level, extra, costs, changed)
        if not count:
            return removed
        removed += count


def _flip_and_fit(surface: Surface, normals: Floats, extra: float) -> None:
    """Flip edges and move vertices, one after another, each if the energy falls and nothing comes to cut."""
    tree = TriangleTree.of(surface.mesh, surface.vertices)
    _flip_all(surface, tree, normals, surface.mesh.edges(), extra)
    _fit_all(surface, tree, extra)


@kernel
def _collapse_all(surface, tree, edges, level, extra, costs, changed):
    """Collapse edges, (m,), but none whose surroundings an earlier one has changed; return their number."""
    mesh, count = surface.mesh, 0
    star = room_for_star(len(surface.points))
    inside = np.zeros(len(surface.first), dtype=np.bool_)
    for h in edges:
        v, u = mesh.origin[h], mesh.origin[following(h)]
        if v < 0 or changed[v] or changed[u]:
            continue
        cost, place = collapsed(surface, star, h, extra)
        faces = h // 3, (mesh.opposite[h] // 3 if mesh.opposite[h] >= 0 else h // 3)
        if cost == np.inf or not _is_free(surface, tree, star, u, place, faces, inside):
            costs[h] = np.inf
            continue
        collapse_edge(surface, star, v, u, place, level, extra, changed)
        _follow(surface, tree, star)
        count += 1
    return count


@kernel(allocates=False)
def _follow(surface, tree, star):
    """Widen the boxes of a tree after a star has changed."""
    for k in range(star.sizes[0]):
        follow(surface.mesh, surface.vertices, tree, star.edges[k] // 3)


@kernel
def _is_free(surface, tree, star, u, place, faces, inside):
    """Return whether no triangle of a star cuts another with the vertex u at a place; `faces` will be removed."""
    mesh, vertices, count = surface.mesh, surface.vertices, star.sizes[0]
    before = row(vertices, u)
    vertices[u, 0], vertices[u, 1], vertices[u, 2] = place
    for k in range(count):
        inside[star.edges[k] // 3] = True
    inside[faces[0]] = inside[faces[1]] = True
    free = True
    for k in range(count):
        a, b = mesh.origin[star.edges[k]], mesh.origin[following(star.edges[k])]
        if first_cut(mesh, vertices, tree, inside, u, a, b) >= 0:
            free = False
            break
        for j in range(k):
            c, d = mesh.origin[star.edges[j]], mesh.origin[following(star.edges[j])]
            if are_cut(vertices, (u, a, b), (u, c, d)):
                free = False
        if not free:
            break
    for k in range(count):
        inside[star.edges[k] // 3] = False
    inside[faces[0]] = inside[faces[1]] = False
    vertices[u, 0], vertices[u, 1], vertices[u, 2] = before
    return free


@kernel
def _fit_all(surface, tree, extra):
    """Fit all vertices to the points around them, one after another."""
    star = room_for_star(len(surface.points))
    inside = np.zeros(len(surface.first), dtype=np.bool_)
    for v in range(len(surface.vertices)):
        if surface.mesh.leaving[v] < 0:
            continue
        here = row(surface.vertices, v)
        empty(star, here)
        energy = add_around(surface, star, v, -1, extra)
        least, place = fit_star(surface, star, here, extra)
        some = star.edges[0] // 3
        if least < energy and _is_free(surface, tree, star, v, place, (some, some), inside):
            store(surface, star, v, place, extra)
            _follow(surface, tree, star)


@kernel
def _flip_all(surface, tree, normals, edges, extra):
    """Try to flip each edge once."""
    mesh = surface.mesh
    halves = np.empty(MOST_AROUND, dtype=np.int64)
    inside = np.zeros(len(surface.first), dtype=np.bool_)
    for h in edges:
        o = mesh.opposite[h]
        if not is_flippable(mesh, surface.vertices, normals, h, halves) or not is_better(
            mesh,
            surface.vertices,
            surface.points,
            surface.assigned,
            extra,
            surface.first,
            surface.after,
            surface.limit,
            h,
        ):
            continue
        a, b = mesh.origin[h], mesh.origin[o]
        c, d = mesh.origin[preceding(h)], mesh.origin[preceding(o)]
        inside[h // 3] = inside[o // 3] = True
        cut = (
            first_cut(mesh, surface.vertices, tree, inside, a, d, c) >= 0
            or first_cut(mesh, surface.vertices, tree, inside, d, b, c) >= 0
            or are_cut(surface.vertices, (a, d, c), (d, b, c))
        )
        inside[h // 3] = inside[o // 3] = False
        if cut:
            continue
        flip_edge(mesh, h)
        share_out(
            mesh, surface.vertices, surface.points, surface.assigned, surface.first, surface.after, h // 3, o // 3
        )
        follow(mesh, surface.vertices, tree, h // 3)
        follow(mesh, surface.vertices, tree, o // 3)
