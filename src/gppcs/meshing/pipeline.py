"""Make a light mesh straight from a dense cloud: the function `mesh` and its steps."""

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gppcs.clouds.cloud import CloudLike, PointCloud, with_normals
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.quantities import Scale, units_of
from gppcs.clouds.topology import topology_of
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import ParameterError, flag, one_of
from gppcs.io.reading import as_cloud
from gppcs.meshing.arguments import MIN_VERTICES, Size, checked_effort, indices_to_keep, require_surface
from gppcs.meshing.assembly import largest_pieces
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.bounding import bound, thinned_by_quadrics
from gppcs.meshing.collapse import collapse
from gppcs.meshing.draft import Draft
from gppcs.meshing.exchange import exchanged
from gppcs.meshing.filling import holes_filled
from gppcs.meshing.first_mesh import excluded, first_mesh
from gppcs.meshing.fit import fit, fit_observed
from gppcs.meshing.flips import flip
from gppcs.meshing.mending import mend_draft
from gppcs.meshing.refinement import refine
from gppcs.meshing.result import MeshDiagnostics, MeshResult
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame, normalised
from gppcs.spatial.spacing import surface_area
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.outliers import outliers_among


def mesh(
    cloud: CloudLike,
    *,
    n_points: int | str | None = None,
    ratio: float | str | None = None,
    n_faces: int | str | None = None,
    tolerance: float | str | None = None,
    unit: str | None = None,
    keep: ArrayLike | None = None,
    moved: bool | None = None,
    effort: int = 0,
    fill_holes: float | str | None = None,
    invalid: Literal["error", "drop"] = "error",
    timer: Timer | None = None,
) -> MeshResult:
    """Make a light mesh straight from a dense cloud.

    Some of the points are joined to a mesh: about eight times as many as the result has, or 24 times if two sheets
    are near each other, evenly spread. Its vertices are then removed, the cheapest first, by the distances to the
    tangent planes of all points (quadrics). At last, edges are flipped where that brings the mesh nearer to the
    points. The mesh is oriented and a manifold, and none of its triangles cuts another. It is open where the points
    leave holes.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        Points on a surface. Exact repeats count once.
    n_points : int, optional
        M, the number of vertices, at least 4. If fewer points are on the surface, all of these are. Give exactly one
        of `n_points`, `ratio`, `n_faces`, `tolerance` and `keep`.
    ratio : float or str, optional
        M / N, above 0 and at most 1, such as 0.03 or "3%".
    n_faces : int, optional
        The number of triangles at most, at least 4. Those that fill holes count: if there are too many, a lighter mesh
        is made. There are more only if each piece already has as few vertices as can be.
    tolerance : length, optional
        Largest distance from the points to the mesh: a number in the unit of the coordinates, or a text such as
        "0.5mm" or "0.2%" of the diagonal of the bounding box. The mesh has as few vertices as can be found within it.
        They leave the points whatever `moved` says. Outliers are excluded, and points off the surface: the mesh of all
        points is farther from them than the tolerance, or on a noisy cloud than 0.7 of it. A text such as "0.5mm:mean"
        is for the mean distance. The mesh then has about as few vertices as it allows, by several tries.
    unit : str, optional
        In which unit the coordinates are: "m", "mm", "ft" and so on, if the coordinate system of the cloud does not
        say so.
    keep : (M,) array-like of int, optional
        Indices of the points that become the vertices, such as the `indices` of `gppcs.simplify`.
    moved : bool, optional
        Whether vertices may leave the points, so that the mesh fits these better. By default, they do on a noisy cloud,
        so that the mesh is free of its noise.
    effort : 0, 1 or 2
        How much time to spend on a better mesh with moved vertices: with 1 or 2, vertices go from where they matter
        least to where they help most, in two rounds, or until that gains little. Then vertices leave the points
        whatever `moved` says, and `keep` cannot be given. With a `tolerance` of the largest distance, vertices are
        removed, and the others fitted, in more rounds.
    fill_holes : length, optional
        Also close holes up to this size, the diagonal of the box around their boundary loop.
    invalid : "error" or "drop"
        What to do with points whose coordinates are NaN or infinite: raise an error, or drop them.
    timer : Timer, optional
        Measures the time of each stage, and reports progress.

    Returns
    -------
    MeshResult
        The same input gives the same result, for any number of threads.

    Raises
    ------
    InputError
        If the cloud is empty, has a wrong shape or has coordinates that are not finite.
    NoSurfaceError
        If the points do not lie on a surface: there are fewer than four, they lie on a line, or they fill a volume.
    ParameterError
        If a parameter is outside its range, or the tolerance is below what the mesh of all points reaches: in the
        mean, or for half of the points.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=20_000)
    >>> result = gppcs.mesh(cloud, n_points=500)
    >>> result.mesh.vertices.shape, (cloud.points[result.indices] == result.mesh.vertices).all()
    ((500, 3), np.True_)
    """
    from gppcs.amounts.constraints import check_finite

    timer, effort = timer_of(timer), checked_effort(effort, keep)
    moved = None if moved is None else flag("moved", moved)
    size = Size.from_arguments(
        n_points=n_points, ratio=ratio, n_faces=n_faces, tolerance=tolerance, unit=unit, keep=keep,
        fill_holes=fill_holes,
    )  # fmt: skip
    with timer("preparation"):
        cloud = as_cloud(cloud)
        finite = np.flatnonzero(cloud.is_finite())
        bad = np.flatnonzero(~cloud.is_finite())
        one_of("invalid", invalid, ("error", "drop"))
        check_finite(len(cloud), len(bad), int(bad[0]) if len(bad) else 0, invalid)
        units = units_of(unit, cloud.header)
        points, frame = normalised(cloud.points[finite] if len(bad) else cloud.points, units)
        fixed = indices_to_keep(keep, finite, points, len(cloud))
        n_vertices = size.n_vertices(len(points)) or len(fixed)
        require_surface(points)
    scale = Scale(float(np.linalg.norm(np.ptp(points, axis=0))), units, frame.exponent)
    hole_size = scale.inside(size.fill_holes) if size.fill_holes else None
    if effort or size.bounds_largest:
        moved = True
    elif moved is None and (keep is not None or size.tolerance):
        moved = False
    request = _Request(points, 2.0**frame.exponent, fixed, moved, effort, hole_size, timer)
    if size.tolerance is None:
        draft, diagnostics = _of_size(request, size.n_faces or n_vertices, size.n_faces is not None)
        if n_vertices and keep is None and draft.n_vertices > n_vertices:
            raise ParameterError(
                f"expected at least {draft.n_vertices} vertices, as the surface has holes or handles, found "
                f"{n_vertices}"
            )
    elif size.bounds_largest:
        draft, diagnostics = _within_largest_distance(request, scale.inside(size.tolerance.length))
    else:
        draft, diagnostics = _within_mean_distance(request, scale.inside(size.tolerance.length))
    return _result(cloud, finite, draft, diagnostics, frame, timer)


@dataclass(frozen=True)
class _Request:
    """What a mesh is made from, and how."""

    points: Floats  # (N, 3), of about unit size
    unit: float  # of these, in that of the cloud
    fixed: Ints  # indices of the points to keep, perhaps none
    moved: bool | None
    effort: int
    hole_size: float | None
    timer: Timer


def _lightened(request: _Request, first: Draft, count: int, counts_faces: bool) -> tuple[Draft, MeshDiagnostics]:
    """Return a mesh of so many vertices or triangles, and those that fill holes: a first mesh, step by step."""
    timer = request.timer
    mesh = first.mesh if len(request.fixed) else largest_pieces(first.mesh, count, counts_faces)
    draft = first.copy()
    if mesh is not first.mesh:
        draft = Draft.from_mesh(mesh, first.dense, first.dense_index, first.fixed, first.moved)
    fraction = excluded(draft)
    target = draft.n_fixed if len(request.fixed) else count
    assigned = _thinned(request, draft, target, counts_faces)
    if draft.moved:
        with timer("fit"):
            for _ in range(3):
                assigned = flip(draft, fit(draft, assigned))
    draft, assigned = _exchanged(request, draft, assigned)
    with timer("mending"):
        open_holes = mend_draft(draft, assigned, counts_faces)
        draft.compact()
    with timer("distances"):
        assigned = draft.assigned()
        mean_distance = _mean_distance(first, draft, assigned)
    measured: dict[str, Any] = {"open_holes": open_holes}
    if draft.moved and draft.dense.noise:
        with timer("fit"):
            measured["unconverged"] = not fit_observed(draft, assigned)
    if len(request.fixed):
        measured |= {"missing": len(request.fixed) - draft.n_fixed, "added": draft.n_vertices - draft.n_fixed}
    return _finished(request, draft, fraction, mean_distance, **measured)


def _thinned(request: _Request, draft: Draft, target: int, counts_faces: bool) -> Assignment:
    """Remove vertices down to the target, put others where they help most; return the triangles of the dense points."""
    n_vertices = -(-target // 2) if counts_faces else target
    excess = draft.n_vertices - n_vertices
    with request.timer("collapse", max(0, excess)) as on_progress:
        collapse(draft, target, counts_faces, on_progress)
        draft.compact()
    with request.timer("refinement"):
        assigned = flip(draft)
        if not len(request.fixed) and excess > 0:
            for _ in range(2):
                refine(draft, round(0.2 * n_vertices), assigned)
                corners = draft.mesh.corners().copy()
                collapse(draft, target, counts_faces)
                assigned = flip(draft, draft.reassigned(assigned, corners))
    return assigned


def _exchanged(request: _Request, draft: Draft, assigned: Assignment) -> tuple[Draft, Assignment]:
    """Let vertices of a draft go to where they help more, while that gains 1 %; return it and the points' triangles."""
    rounds = (0, 2, 8)[request.effort]
    if not rounds:
        return draft, assigned
    with request.timer("exchange", rounds) as on_progress:
        for _ in range(rounds):
            before = assigned.mean_square()
            changed, after = exchanged(draft, assigned)
            on_progress(1)
            if changed.n_vertices == draft.n_vertices and after.mean_square() < before:
                draft, assigned = changed, after
            if after.mean_square() > 0.99 * before:
                break
    return draft, assigned


def _mean_distance(first: Draft, draft: Draft, assigned: Assignment) -> float:
    """Return the mean distance from a mesh of the points that the first one covers, be it on another sheet."""
    dense, without = first.dense, np.flatnonzero(assigned.face < 0)
    points, vertices = dense.positions[without], dense.positions[first.dense_index]
    reached = Assignment.on_same_sheet(first.mesh, vertices, points, dense.normals[without], first.nearest[without])
    far = Assignment.on_any_sheet(draft.mesh, draft.vertices, points[reached.face >= 0]).squared
    return float(np.sqrt(np.append(assigned.squared[assigned.face >= 0], far)).mean())


def _finished(
    request: _Request, draft: Draft, fraction: float, mean_distance: float, **measured: Any
) -> tuple[Draft, MeshDiagnostics]:
    """Fill holes if that is asked for, and return the draft with its diagnostics."""
    if request.hole_size is not None:
        with request.timer("holes"):
            draft.mesh = holes_filled(draft.mesh, draft.vertices, draft.normals, request.hole_size)
    draft.compact()
    topology, area = topology_of(draft.mesh.faces()), surface_area(KdTree.over(draft.dense.cover.points))
    return draft, MeshDiagnostics(
        dense_points=len(draft.dense.indices),
        noise=request.unit * draft.dense.noise,
        joined_sheets=request.unit * draft.dense.joined_sheets,
        mean_distance=request.unit * mean_distance,
        area_ratio=float(Mesh(draft.vertices, draft.mesh.faces()).face_areas().sum()) / area,
        off_sheet=float(np.mean(draft.assigned().face < 0)),
        excluded=fraction,
        boundary_loops=topology.boundary_loops,
        pieces=topology.pieces,
        genus=topology.genus or 0,
        **measured,
    )


def _of_size(request: _Request, count: int, counts_faces: bool) -> tuple[Draft, MeshDiagnostics]:
    """Return a mesh of that many vertices, or of at most so many triangles."""
    n_vertices = -(-count // 2) if counts_faces else count
    first = first_mesh(request.points, max(n_vertices, 256), request.fixed, request.moved, request.timer)
    target, step, before = count, 0, np.inf
    while True:
        draft, diagnostics = _lightened(request, first, target, counts_faces)
        excess = len(draft.mesh.faces()) - count  # filled holes add some
        if not counts_faces or excess <= 0 or target == MIN_VERTICES:
            return draft, diagnostics
        step = excess if excess < before else 2 * step  # without gain, larger steps end sooner
        target, before = max(MIN_VERTICES, target - step), excess


def _within_mean_distance(request: _Request, tolerance: float) -> tuple[Draft, MeshDiagnostics]:
    """Return a mesh of about as few vertices as a mean distance of the points allows, by at most eight tries."""
    n, unit = len(request.points), request.unit
    count, best = min(2_000, n), None
    enough, too_few, nearest = np.inf, 0, np.inf
    for _ in range(8):
        draft, diagnostics = _of_size(request, count, counts_faces=False)
        distance = diagnostics.mean_distance / unit
        if distance <= tolerance:
            best, enough = (draft, diagnostics), draft.n_vertices
            if distance > 0.9 * tolerance:
                break
        else:
            too_few, nearest = count, min(nearest, distance)
            if draft.n_vertices < count or count == n:
                break
        estimate = count * distance / (0.95 * tolerance)  # the distance falls about as one over the vertices
        if not too_few < estimate < enough:
            estimate = np.sqrt(max(too_few, MIN_VERTICES) * enough)
        count = int(np.clip(estimate, MIN_VERTICES, min(n, 8 * count)))
        if count in (too_few, enough):
            break
    if best is None:
        raise ParameterError(
            f"expected a mean distance that a mesh of these points reaches, of about {unit * nearest:.3g} or more, "
            f"found {unit * tolerance:.3g}"
        )
    return best


def _within_largest_distance(request: _Request, tolerance: float) -> tuple[Draft, MeshDiagnostics]:
    """Return a mesh of as few vertices as a largest distance of the points allows."""
    timer, unit = request.timer, request.unit
    with timer("outliers"):
        outliers = outliers_among(request.points)
    first = first_mesh(request.points, len(request.points), request.fixed, request.moved, timer)
    dense = first.dense
    limit = (0.999 * tolerance) ** 2  # as coordinates are rounded when a mesh is written
    with timer("distances"):
        squared = Assignment.on_any_sheet(first.mesh, first.vertices, dense.raw).squared
        usual = ~outliers[dense.indices]
    if 2 * np.count_nonzero(usual & (squared <= limit)) < np.count_nonzero(usual):
        raise ParameterError(
            f"the tolerance of {unit * tolerance:.3g} is below the noise: half of the points are farther than "
            f"{unit * np.sqrt(np.median(squared)):.3g} from the mesh of all points; give a larger tolerance, or a "
            "number of vertices"
        )
    # Noise moved points that are nearly as far off as the tolerance, to both sides: they would hold the mesh.
    counted = usual & (squared <= (0.7**2 if dense.noise else 1.0) * limit)
    with timer("collapse"):
        draft = thinned_by_quadrics(first.copy(), counted, limit)
    with timer("bounded collapse"):
        bound(draft, counted, limit, (2, 6, 32)[request.effort])
    with timer("distances"):
        distances = np.sqrt(Assignment.on_any_sheet(draft.mesh, draft.vertices, dense.raw).squared)
        within = usual & (distances <= tolerance)
        used = draft.vertices[np.unique(draft.mesh.faces())]
        back_distance = LocalSurface.from_points(dense.raw).nearest_to(used)[0].max()
    return _finished(
        request,
        draft,
        excluded(first),
        float(distances[within].mean()),
        open_holes=0,
        tolerance=unit * tolerance,
        largest_distance=unit * float(distances[within].max()),
        back_distance=unit * float(back_distance),
        outliers=int(np.count_nonzero(~usual)),
        off_surface=int(np.count_nonzero(usual & ~within)),
    )


def _result(
    cloud: PointCloud, finite: Ints, draft: Draft, diagnostics: MeshDiagnostics, frame: Frame, timer: Timer
) -> MeshResult:
    """Return a mesh in the unit of the cloud, with the attributes of its points."""
    indices = finite[draft.dense.indices[draft.dense_index]]
    vertices = cloud.take(indices)
    if draft.moved:
        vertices = vertices.moved(frame.world(draft.vertices))
    if diagnostics.tolerance is not None:  # rounded to the type of the points, vertices may leave the tolerance
        vertices = dataclasses.replace(vertices, coordinate_dtype=np.dtype(np.float64))
    if vertices.normals() is None:
        vertices = with_normals(vertices, draft.normals)
    return MeshResult(Mesh(vertices.points, draft.mesh.faces()), indices, vertices, dict(timer.seconds), diagnostics)
