"""Remove vertices while every point stays within a distance of the mesh, and no triangle comes to cut another."""

import numpy as np

from gppcs.engine.arrays import Flags, Ints
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.collapse import collapse
from gppcs.meshing.cuts import TriangleTree, cutting
from gppcs.meshing.draft import Draft
from gppcs.meshing.energy import FittedMesh
from gppcs.meshing.exchange import changes, collapse_all
from gppcs.meshing.fit import fit_all
from gppcs.meshing.flips import flip_all


def thinned_by_quadrics(draft: Draft, counted: Flags, limit: float) -> Draft:
    """Halve the vertices while points that count, (n,), are near and nothing is cut; up to 2 % may be fixed."""
    nearest = Assignment.on_any_sheet(draft.mesh, draft.vertices, draft.dense.raw)
    while True:
        trial = draft.copy()
        collapse(trial, draft.n_vertices // 2)
        if trial.n_vertices == draft.n_vertices:
            return draft
        after = Assignment.on_any_sheet(trial.mesh, trial.vertices, draft.dense.raw)
        far, cut = counted & (after.squared > limit), cutting(trial.mesh, trial.vertices)
        if not far.any() and not len(cut):
            trial.compact()
            trial.fixed[:] = False
            draft, nearest = trial, Assignment.on_any_sheet(trial.mesh, trial.vertices, draft.dense.raw)
            continue
        before = np.count_nonzero(draft.fixed)
        draft.fixed |= np.isin(trial.nearest[draft.dense_index], trial.mesh.corners()[cut])
        draft.fixed[draft.mesh.corners()[nearest.face[far]]] = True
        if not before < np.count_nonzero(draft.fixed) <= 0.02 * draft.n_vertices:
            return draft


def bound(draft: Draft, counted: Flags, limit: float, rounds: int) -> None:
    """Remove vertices, with flips and fits between rounds, while points that count, (n,), stay within the limit."""
    dense, mesh, vertices = draft.dense, draft.mesh, draft.vertices
    nearest = Assignment.on_any_sheet(mesh, vertices, dense.raw)
    assigned = Assignment(np.where(counted, nearest.face, -1), nearest.squared, nearest.weights)
    fitted = FittedMesh.from_points(mesh, vertices, dense.raw, assigned, limit, dense.cover.radii**2)
    total_thin_cost = 0.5 * limit * np.count_nonzero(counted)  # of all triangles together, if they had no area
    _collapse_while_allowed(fitted, draft.dense_index, total_thin_cost)
    for _ in range(rounds):
        for _ in range(2):
            thin_cost, tree = total_thin_cost / len(mesh.faces()), TriangleTree.from_mesh(mesh, vertices)
            flip_all(fitted, tree, dense.normals[draft.dense_index], thin_cost, 1)
            fit_all(fitted, tree, thin_cost)
        if not _collapse_while_allowed(fitted, draft.dense_index, total_thin_cost):
            break
    draft.normals = dense.normals[draft.dense_index]


def _collapse_while_allowed(fitted: FittedMesh, dense_index: Ints, total_thin_cost: float) -> int:
    """Collapse edges, the cheapest first, until none can; return by how many vertices there are fewer."""
    mesh, removed = fitted.mesh, 0
    costs, changed = np.full(len(mesh.origin), np.inf), np.ones(len(mesh.leaving), dtype=np.bool_)
    while True:
        thin_cost = total_thin_cost / len(mesh.faces())
        edges, targets = mesh.edges(), mesh.targets()
        stale = edges[changed[mesh.origin[edges]] | changed[targets[edges]]]
        costs[stale], changed[:] = changes(fitted, stale, thin_cost, split=False), False
        order = edges[np.argsort(costs[edges], kind="stable")[: np.count_nonzero(costs[edges] < np.inf)]]
        tree = TriangleTree.from_mesh(mesh, fitted.vertices)
        count = collapse_all(fitted, tree, order, dense_index, thin_cost, costs, changed)
        if not count:
            return removed
        removed += count
