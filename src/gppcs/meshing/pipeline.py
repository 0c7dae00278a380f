"""Make a light mesh straight from a dense cloud: the function `mesh` and its result."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud, with_normals
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.quantities import Length, Scale, Tolerance, count_of, metres_of, ratio_of
from gppcs.clouds.topology import topology_of
from gppcs.engine.blas import one_blas_thread
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import Timer, in_words, timer_of
from gppcs.errors import NoSurfaceError, ParameterError, flag, one_of, shown, whole_number
from gppcs.io.reading import as_cloud
from gppcs.meshing.assembly import PIECE_TRIANGLES, assembled, largest_pieces, without_scraps
from gppcs.meshing.assignment import Assignment
from gppcs.meshing.bounding import bound, thinned_by_quadrics
from gppcs.meshing.dense import LEVEL_OF_NOISY, DensePoints
from gppcs.meshing.draft import Draft
from gppcs.meshing.fans import fans_of
from gppcs.meshing.filling import holes_filled
from gppcs.meshing.halfedges import Floats, HalfEdges, Ints
from gppcs.meshing.mending import without_cuts
from gppcs.meshing.patches import turned_patches
from gppcs.meshing.quadrics import nearest_vertices
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame, normalised
from gppcs.surface.fans import ON_CIRCLE
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.normals import EDGES
from gppcs.surface.outliers import outliers_among

FEWEST_VERTICES = 4  # of a mesh: those of a tetrahedron
LEVEL = 8  # points of the first mesh, in vertices of the result
STRAY_TRIANGLES = 24  # of a piece of the first mesh where noise is uneven; smaller ones are strays of its layers
NEIGHBOURS = 24  # of a point of the first mesh, among which those of its fan are
LEAST_VERTICES = 256  # the first mesh of a lighter result is made as for this many
LEAST_AGREED = 0.38  # of the fans' triangles, the share that another fan has too; below it, points lie on no surface
SURELY_AGREED = 0.5  # such a share: noise may be thick below it, as that of scans is at least 0.56
FIRST_STOP = 13, 10  # the collapse stops for flips at 13/10 of the vertices of the result
REFINEMENTS, REFINED = 2, 0.2  # rounds in which new vertices, this share of all, replace those that matter least
FIT_ROUNDS = 4  # of fitting and flipping
EXCHANGES = 0, 2, 8  # rounds of exchanges at most, at each effort
LESS = 0.99  # a round that leaves more of the mean square distance is the last one
LINE_WIDTH = 1e-6  # points whose second widest extent is below this share of the widest lie on a line
FIRST_TRY = 2_000  # vertices of the first mesh of a search for a tolerance
NEAR_ENOUGH = 0.9  # a mean distance above this share of the tolerance ends the search
MOST_TRIES = 8  # meshes of such a search
WITHIN = 0.999  # of a tolerance of the largest distance: coordinates are rounded when a mesh is written
HELD = 0.7  # of a tolerance: points that noise moved farther off the surface need not stay within it
LENGTHS = "noise", "mean_distance", "tolerance", "largest_distance", "back_distance"  # among the diagnostics
BOUNDED = 2, 6, 32  # rounds of fitting and further collapses at most for such a tolerance, at each effort


@dataclass(frozen=True, eq=False)
class MeshResult(ComparedByValue):
    """A light mesh of a cloud, with the times of the run.

    Attributes
    ----------
    mesh : Mesh
        Oriented triangles between M vertices.
    indices : (M,) array, int64
        The row in the input of each vertex: the point that it is, or with `moved` the point that it was.
    cloud : PointCloud
        The vertices as a cloud, with all attributes of these points. If the input has no normals, those estimated
        from all points are added as `nx`, `ny` and `nz`.
    seconds : mapping of str to float
        Wall time of each stage in seconds, in the order of the run. If kernels were compiled meanwhile, that time is
        in an entry of its own, `compilation`.
    diagnostics : mapping of str to float
        `dense_points`, from which the mesh was made; `noise`, their root mean square distance from the surface, 0 if it
        is too small to count; `mean_distance` from the mesh of the dense points that the first mesh reaches, of a noisy
        cloud that of their projections onto the surface before vertices take their last step; `left_out`, the share of
        the points of the first mesh that are on no piece of it that is large enough; `opened`, the number of small
        holes that stay open because all triangles that would close them cut others; `borders`, the number of holes and
        rims, 0 if the mesh is closed; `pieces`, that of connected pieces; `genus`, that of handles; with `keep` also
        `missing`, the number of these points that are no vertices, and `added`, that of vertices that are none of them.
        With a `tolerance` of the largest distance also `tolerance` itself; `largest_distance` of the points from the
        mesh, without those left out; `back_distance`, the largest distance of a vertex from the local surface of the
        points; `outliers`, the number of places, repeats counted once, of points left out as `gppcs.find_outliers`
        finds them; `off_surface`, that of places of other points farther than the tolerance from the mesh: the mesh of
        all points does not reach them either, or noise moved them nearly as far.

    Examples
    --------
    >>> result = gppcs.mesh(gppcs.sample("sphere", n_points=3000), n_points=100)
    >>> isinstance(result, gppcs.MeshResult)
    True
    >>> len(result.mesh.vertices), len(result.mesh.faces)
    (100, 196)
    """

    mesh: Mesh
    indices: NDArray[np.int64]
    cloud: PointCloud
    seconds: Mapping[str, float]
    diagnostics: Mapping[str, float]

    def __repr__(self) -> str:
        size = f"{len(self.mesh.vertices):,} vertices, {len(self.mesh.faces):,} triangles"
        return f"MeshResult({size} in {in_words(self.seconds)})"


def mesh(
    cloud: CloudLike,
    *,
    n_points: int | str | None = None,
    ratio: float | str | None = None,
    n_faces: int | str | None = None,
    tolerance: float | str | None = None,
    unit: str | None = None,
    keep: ArrayLike | None = None,
    moved: bool = False,
    effort: int = 0,
    fill_holes: float | str | None = None,
    invalid: Literal["error", "drop"] = "error",
    timer: Timer | None = None,
) -> MeshResult:
    """Make a light mesh straight from a dense cloud.

    Some of the points are joined to a mesh: about eight times as many as wanted, evenly spread. Its vertices are then
    removed, the cheapest first; what that costs is told by the tangent planes of all points (quadrics). At last,
    edges are flipped where that brings the mesh nearer to the points. The mesh is oriented and a manifold, and none of
    its triangles cuts another. It is open where the points leave holes.

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
        They leave the points whatever `moved` says. Outliers are left out, and points off the surface: the mesh of all
        points is farther from them than the tolerance, or on a noisy cloud than 0.7 of it. A text such as "0.5mm:mean"
        is for the mean distance. The mesh then has about as few vertices as it allows, by several tries.
    unit : str, optional
        In which unit the coordinates are: "m", "mm", "ft" and so on, if the coordinate system of the cloud does not
        tell.
    keep : (M,) array-like of int, optional
        Rows of the points that become the vertices, such as the `indices` of `gppcs.simplify`.
    moved : bool
        Whether vertices may leave the points, so that the mesh fits these better.
    effort : 0, 1 or 2
        How much time to spend on a better mesh with moved vertices: with 1 or 2, vertices go from where they matter
        least to where they help most, in two rounds, or until that gains little. Then vertices leave the points
        whatever `moved` says, and `keep` cannot be given. With a `tolerance` of the largest distance, vertices are
        removed, and the others fitted, in more rounds.
    fill_holes : length, optional
        Also close holes up to this size, the diagonal of the box around their border.
    invalid : "error" or "drop"
        What to do with points whose coordinates are NaN or infinite: raise an error, or leave them out.
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

    timer, effort = timer_of(timer), _effort_of(effort, keep)
    moved = flag("moved", moved) or effort > 0
    size = Size.of(
        n_points=n_points, ratio=ratio, n_faces=n_faces, tolerance=tolerance, unit=unit, keep=keep,
        fill_holes=fill_holes,
    )  # fmt: skip
    with timer("preparation"):
        cloud = as_cloud(cloud)
        rows = cloud.finite_rows()
        bad = cloud.non_finite()
        one_of("invalid", invalid, ("error", "drop"))
        check_finite(len(cloud), len(bad), int(bad[0]) if len(bad) else 0, invalid)
        points, frame = normalised(cloud.points[rows] if len(bad) else cloud.points)
        chosen = None if keep is None else _chosen_rows(keep, rows, points, len(cloud))
        count = size.vertices(len(points))
        _require_surface(points)
    metres = metres_of(unit, cloud.header)
    scale = Scale(float(np.linalg.norm(np.ptp(points, axis=0))), metres, frame.exponent)
    hole_size = scale.inside(size.fill_holes) if size.fill_holes else None
    moved = moved or size.bounds_largest
    maker = _Maker(points, chosen, moved, effort, hole_size, timer)
    if size.tolerance is not None:
        length = scale.inside(size.tolerance.length)
        made = (
            maker.search(length, 2.0**frame.exponent)
            if size.tolerance.measure
            else maker.within(length, 2.0**frame.exponent)
        )
    elif size.n_faces is not None:
        made = maker.make(size.n_faces, counts_faces=True)
    else:
        made = maker.make(count if chosen is None else len(chosen))
        if chosen is None and len(made.rows) > count:
            raise ParameterError(
                f"expected at least {len(made.rows)} vertices, as the surface has holes or handles, found {count}"
            )
    return _result(cloud, rows, made, moved, frame, timer)


@dataclass(frozen=True)
class Size:
    """How large a mesh shall be: the arguments of `mesh` with these names, checked without the cloud."""

    n_points: int | None
    ratio: float | None
    n_faces: int | None
    tolerance: Tolerance | None  # of the mean or the largest distance
    fill_holes: Length | None

    @classmethod
    def of(
        cls,
        *,
        n_points: int | str | None,
        ratio: float | str | None,
        n_faces: int | str | None,
        tolerance: float | str | None,
        unit: str | None,
        keep: Any | None,
        fill_holes: float | str | None,
    ) -> Size:
        """Check the arguments; `keep` is only looked at for being there."""
        given = {"n_points": n_points, "ratio": ratio, "n_faces": n_faces, "tolerance": tolerance, "keep": keep}
        names = [name for name, value in given.items() if value is not None]
        if len(names) != 1:
            raise ParameterError(f"expected exactly one of {', '.join(given)}, found {' and '.join(names) or 'none'}")
        metres_of(unit, None)
        return cls(
            None if n_points is None else count_of("n_points", n_points, FEWEST_VERTICES),
            None if ratio is None else ratio_of("ratio", ratio),
            None if n_faces is None else count_of("n_faces", n_faces, FEWEST_VERTICES),
            None if tolerance is None else _tolerance_of(tolerance),
            None if fill_holes is None else Length.from_value("fill_holes", fill_holes),
        )

    @property
    def bounds_largest(self) -> bool:
        """Whether the largest distance of the points is to be within a tolerance."""
        return self.tolerance is not None and self.tolerance.measure is None

    def vertices(self, n: int) -> int:
        """Return M, the number of vertices of a mesh of n points; 0 if that is not asked for."""
        if self.ratio is None:
            return self.n_points or 0
        if round(self.ratio * n) < FEWEST_VERTICES:
            raise ParameterError(
                f"expected a ratio that keeps at least {FEWEST_VERTICES} of the {n} points, found {self.ratio:g}"
            )
        return round(self.ratio * n)


def _tolerance_of(given: Any) -> Tolerance:
    """Check a tolerance of a mesh: a length, or a text with a length and ":mean"."""
    tolerance = Tolerance.from_value(given)
    if tolerance.measure not in (None, "mean"):
        raise ParameterError(
            f"expected tolerance to be a largest distance, such as '1mm', or to end in :mean, found {shown(given)}"
        )
    return tolerance


def _effort_of(effort: Any, keep: Any | None) -> int:
    """Check the effort of a mesh, whose vertices become rows `keep` if that is not None."""
    found = whole_number("effort", effort, 0)
    if found >= len(EXCHANGES):
        raise ParameterError(f"expected effort to be 0, 1 or 2, found {found}")
    if found and keep is not None:
        raise ParameterError(
            f"expected an effort of 0 where points are to become vertices, found {found}: more effort moves vertices "
            "away; leave out keep or effort"
        )
    return found


def _chosen_rows(keep: ArrayLike, rows: Ints, points: Floats, n: int) -> Ints:
    """Return the positions of chosen rows among the usable rows, ascending; of repeats, that of the first."""
    try:
        chosen = np.asarray(keep)
    except ValueError:  # rows of different lengths
        chosen = np.empty(0)
    if chosen.ndim != 1 or not np.issubdtype(chosen.dtype, np.integer) or len(chosen) < FEWEST_VERTICES:
        raise ParameterError(f"expected keep to be at least {FEWEST_VERTICES} indices of rows, found {shown(keep)}")
    unusable = np.setdiff1d(chosen, rows)
    if len(unusable):
        raise ParameterError(
            f"expected keep to be rows of the cloud from 0 to {n - 1} with finite coordinates, found {unusable[0]}"
        )
    distinct = np.flatnonzero(first_occurrences(points))
    nearest, _ = KdTree.build(points[distinct]).nearest_of(points[np.searchsorted(rows, chosen)], 1)
    return np.unique(distinct[nearest[:, 0]])


@one_blas_thread()
def _require_surface(points: Floats) -> None:
    """Raise an error if the points, (N, 3), are too few or lie on a line."""
    distinct = len(np.unique(points[: 10 * FEWEST_VERTICES], axis=0))
    if len(points) <= 10 * FEWEST_VERTICES and distinct < FEWEST_VERTICES:
        raise NoSurfaceError(f"expected at least {FEWEST_VERTICES} points on a surface, found {distinct}")
    extents = np.sqrt(np.abs(np.linalg.eigvalsh(np.cov(points.T))))
    if extents[1] <= LINE_WIDTH * extents[2]:
        raise NoSurfaceError(f"expected points on a surface, found {len(points)} points on a line")


@dataclass(frozen=True)
class _Made:
    """A mesh in the frame of the points: its triangles, and for each vertex its place, normal and row."""

    faces: Ints
    vertices: Floats
    normals: Floats
    rows: Ints
    diagnostics: dict[str, float]


@dataclass(frozen=True)
class _FirstMesh:
    """The mesh of some dense points, whose vertices are then removed."""

    dense: DensePoints
    level: Ints  # (V,): the dense points that are joined, ascending
    faces: Ints  # (F, 3): an oriented manifold
    agreed: float  # of the fans' triangles, the share that another fan has too

    @classmethod
    def of(cls, dense: DensePoints, level: Ints, chosen: Ints, moved: bool) -> _FirstMesh:
        """Join some dense points; raise an error if they lie on no surface."""
        places, reaches = dense.places[level], dense.cover.reaches[level]
        tree = KdTree.over(np.ascontiguousarray(places.T))
        near, _ = tree.neighbours(min(NEIGHBOURS, len(level) - 1))
        for on_circle in ON_CIRCLE:
            triangles, votes, radii = fans_of(places, dense.normals[level], near, on_circle)
            agreed = _agreed(votes)
            if agreed >= LEAST_AGREED:
                break
        else:
            raise NoSurfaceError(
                f"expected points on a surface, found {len(level)} points of whose triangles only {agreed:.0%} fit "
                "together: they fill a volume, are too few, or have noise thicker than their spacing"
            )
        if dense.uneven:
            turned = turned_patches(triangles[votes == 3], places, dense.normals[level], near[:, :EDGES])
            dense = dense.turned(level, turned, tree)
            triangles, votes, radii = fans_of(places, dense.normals[level], near, on_circle)
            agreed = _agreed(votes)
        normals = dense.normals[level]
        faces = assembled(triangles, votes, radii, places, normals, reaches, dense.cover, dense.uneven)
        fewest = STRAY_TRIANGLES if dense.uneven else PIECE_TRIANGLES
        faces = without_scraps(faces, len(level), fewest)
        vertices = places if moved else dense.raw[level]
        faces = without_cuts(faces, vertices, normals, np.isin(dense.rows[level], chosen))
        faces = without_scraps(faces, len(level), fewest)  # cuts leave some, too
        first = cls(dense, level, faces, agreed)
        if not len(faces) or (len(faces) < PIECE_TRIANGLES and 2 * first.joined < len(level)):
            raise NoSurfaceError(
                f"expected points on a surface, found {len(level)} points of which triangles join "
                f"{first.joined or 'none'}"
            )
        return first

    def mean_distance(self, draft: Draft, found: Assignment) -> float:
        """Return the mean distance from a later mesh of the points that this one reaches, given their triangles there.

        Of those that have none, the nearest on any sheet counts.
        """
        lost = self._reached(np.flatnonzero(found.face < 0))
        far = Assignment.on_any_sheet(draft.mesh, draft.vertices, self.dense.places[lost]).squared
        return float(np.sqrt(np.append(found.squared[found.face >= 0], far)).mean())

    def _reached(self, some: Ints) -> Ints:
        """Return those of some dense points that a triangle of the mesh is near to, on their sheet."""
        mesh, places = HalfEdges.of(self.faces, len(self.level)), self.dense.places
        start = nearest_vertices(
            places[some], self.dense.normals[some], places[self.level], self.dense.normals[self.level],
            np.flatnonzero(mesh.leaving >= 0),
        )  # fmt: skip
        found = Assignment.of(mesh, places[self.level], places[some], self.dense.normals[some], start)
        return some[found.face >= 0]

    @property
    def joined(self) -> int:
        """The number of points on the mesh."""
        return int(np.count_nonzero(np.bincount(self.faces.ravel())))

    @property
    def left_out(self) -> float:
        """The share of the points that are not on the mesh."""
        return 1.0 - self.joined / len(self.level)


def _agreed(votes: Ints) -> float:
    """Return the share of triangles of fans that another fan has too, given how many have each."""
    return np.count_nonzero(votes > 1) / max(1, len(votes))


@dataclass(frozen=True)
class _Maker:
    """Makes meshes of points, (N, 3), of about unit size."""

    points: Floats
    chosen: Ints | None
    moved: bool
    effort: int
    hole_size: float | None
    timer: Timer

    def search(self, tolerance: float, unit: float) -> _Made:
        """Return a mesh of about as few vertices as a mean distance of the points allows."""
        count, best, tries = min(FIRST_TRY, len(self.points)), None, 0
        enough, too_few, nearest = np.inf, 0, np.inf
        while tries < MOST_TRIES:
            tries += 1
            made = self.make(count)
            distance = made.diagnostics["mean_distance"]
            if distance <= tolerance:
                best, enough = made, len(made.vertices)
                if distance > NEAR_ENOUGH * tolerance:
                    break
            else:
                too_few = count
                nearest = min(nearest, distance)
                if len(made.vertices) < count or count == len(self.points):
                    break
            wanted = count * distance / (0.95 * tolerance)  # the distance falls about as one over the vertices
            if not too_few < wanted < enough:
                wanted = np.sqrt(max(too_few, FEWEST_VERTICES) * enough)
            count = int(np.clip(wanted, FEWEST_VERTICES, min(len(self.points), 8 * count)))
            if count in (too_few, enough):
                break
        if best is None:
            raise ParameterError(
                f"expected a mean distance that a mesh of these points reaches, of about {unit * nearest:.3g} or more, "
                f"found {unit * tolerance:.3g}"
            )
        return best

    def within(self, tolerance: float, unit: float) -> _Made:
        """Return a mesh of as few vertices as a largest distance of the points allows."""
        with self.timer("outliers"):
            outliers = outliers_among(self.points)
        first = self._begin(len(self.points), np.empty(0, dtype=np.int64))
        dense, limit = first.dense, (WITHIN * tolerance) ** 2
        with self.timer("quadrics"):
            draft = Draft.of(dense, self.moved, first.level, np.zeros(len(first.level), dtype=np.bool_), first.faces)
        with self.timer("distances"):
            squared, usual = draft.assigned_on_any_sheet().squared, ~outliers[dense.rows]
        if 2 * np.count_nonzero(usual & (squared <= limit)) < np.count_nonzero(usual):
            raise ParameterError(
                f"the tolerance of {unit * tolerance:.3g} is below the noise: half of the points are farther than "
                f"{unit * np.sqrt(np.median(squared)):.3g} from the mesh of all points; give a larger tolerance, or a "
                "number of vertices"
            )
        counted = usual & (squared <= (HELD**2 if dense.noise else 1.0) * limit)
        with self.timer("collapse"):
            draft = thinned_by_quadrics(draft, counted, limit)
        with self.timer("bounded collapse"):
            bound(draft, counted, limit, BOUNDED[self.effort])
        with self.timer("distances"):
            distances = np.sqrt(draft.assigned_on_any_sheet().squared)
            within = usual & (distances <= tolerance)
            used = draft.vertices[np.unique(draft.mesh.faces())]
            diagnostics = {
                "tolerance": tolerance,
                "largest_distance": float(distances[within].max()),
                "back_distance": float(LocalSurface.from_points(dense.raw).nearest_to(used)[0].max()),
                "outliers": float(np.count_nonzero(~usual)),
                "off_surface": float(np.count_nonzero(usual & ~within)),
            }
        return self._finished(draft, float(distances[within].mean()), first.left_out, 0, diagnostics)

    def make(self, count: int, counts_faces: bool = False) -> _Made:
        """Return a mesh of that many vertices, or of at most so many triangles."""
        n_vertices = -(-count // 2) if counts_faces else count
        chosen = np.empty(0, dtype=np.int64) if self.chosen is None else self.chosen
        first = self._begin(max(n_vertices, LEAST_VERTICES), chosen)
        wanted, step, before = count, 0, np.inf
        while True:
            made = self._thinned(first, chosen, wanted, counts_faces)
            too_many = len(made.faces) - count  # filled holes add some
            if not counts_faces or too_many <= 0 or wanted == FEWEST_VERTICES:
                return made
            step = too_many if too_many < before else 2 * step  # without gain, larger steps end sooner
            wanted, before = max(FEWEST_VERTICES, wanted - step), too_many

    def _thinned(self, first: _FirstMesh, chosen: Ints, count: int, counts_faces: bool) -> _Made:
        """Return a mesh of that many vertices or triangles, and those that fill holes."""
        timer, dense = self.timer, first.dense
        kept, whole = np.isin(dense.rows[first.level], chosen), first
        if self.chosen is None:
            first = dataclasses.replace(first, faces=largest_pieces(first.faces, len(first.level), count, counts_faces))
        with timer("quadrics"):
            draft = Draft.of(dense, self.moved, first.level, kept, first.faces)
        target = count if self.chosen is None else draft.used_and_kept()
        assigned = self._thin_out(draft, target, counts_faces)
        if self.moved:
            with timer("fit"):
                for _ in range(FIT_ROUNDS):
                    assigned = draft.flip(draft.fit(assigned))
        if self.effort:
            draft = self._exchanged(draft, assigned)
        with timer("mending"):
            opened = draft.mend(counts_faces)
        with timer("distances"):
            distances = draft.assigned()
            mean = whole.mean_distance(draft, distances)
        if self.moved and dense.noise:
            with timer("fit"):
                draft.explain_observed(distances)
        of_chosen = {}
        if self.chosen is not None:
            vertices = draft.used_and_kept()
            of_chosen = {"missing": float(len(chosen) - vertices), "added": float(draft.used() - vertices)}
        return self._finished(draft, mean, first.left_out, opened, of_chosen)

    def _finished(
        self, draft: Draft, mean_distance: float, left_out: float, opened: int, more: dict[str, float]
    ) -> _Made:
        """Return a mesh whose holes are filled if that is wanted, with its diagnostics, `more` last."""
        dense, faces = draft.dense, draft.mesh.faces()
        if self.hole_size is not None:
            with self.timer("holes"):
                faces = holes_filled(faces, draft.vertices, draft.normals, self.hole_size)
        used, faces = np.unique(faces, return_inverse=True)
        diagnostics = {
            "dense_points": float(len(dense.rows)),
            "noise": dense.noise,
            "mean_distance": mean_distance,
            "left_out": left_out,
            "opened": float(opened),
            **more,
        }
        return _Made(
            faces.reshape(-1, 3), draft.vertices[used], draft.normals[used], dense.rows[draft.level[used]], diagnostics
        )  # fmt: skip

    def _exchanged(self, draft: Draft, assigned: Assignment) -> Draft:
        """Return a draft with as many vertices, of which some have gone to where they help more."""
        rounds = EXCHANGES[self.effort]
        with self.timer("exchange", rounds) as advanced:
            for _ in range(rounds):
                before = assigned.mean_square()
                other, after = draft.exchanged(assigned)
                advanced(1)
                if other.used() == draft.used() and after.mean_square() < before:
                    draft, assigned = other, after
                if after.mean_square() > LESS * before:
                    break
        return draft

    def _begin(self, n_vertices: int, chosen: Ints) -> _FirstMesh:
        """Return the first mesh. Where its triangles hardly agree, try whether thick noise is the reason."""
        best: _FirstMesh | None = None
        errors: list[NoSurfaceError] = []
        for thick in (False, True):
            try:
                with self.timer("normals"):
                    dense = DensePoints.from_points(self.points, n_vertices, chosen, thick)
                if dense is None:  # there is no thick noise
                    continue
                with self.timer("first mesh"):
                    first = _FirstMesh.of(dense, self._level(dense, n_vertices, chosen), chosen, self.moved)
            except NoSurfaceError as error:
                errors.append(error)
                continue
            if best is None or first.left_out < best.left_out:
                best = first
            if best.agreed >= SURELY_AGREED:
                break
        if best is None:
            raise errors[-1]
        return best

    def _thin_out(self, draft: Draft, target: int, counts_faces: bool) -> Assignment:
        """Remove vertices until the target is reached; then let others take the place of the least useful ones.

        Return the triangles of the dense points.
        """
        vertices = -(-target // 2) if counts_faces else target
        too_many = draft.used() - vertices
        with self.timer("collapse", max(0, too_many)) as advanced:
            draft.collapse(target * FIRST_STOP[0] // FIRST_STOP[1], counts_faces, advanced)
        with self.timer("flips"):
            draft.compact()
            draft.flip()
        with self.timer("refinement"):
            draft.collapse(target, counts_faces)
            assigned = draft.flip()
            if self.chosen is None and too_many > 0:
                for _ in range(REFINEMENTS):
                    draft.refine(round(REFINED * vertices), assigned)
                    draft.collapse(target, counts_faces)
                    draft.compact()
                    assigned = draft.flip()
        return assigned

    def _level(self, dense: DensePoints, n_vertices: int, chosen: Ints) -> Ints:
        """Return the positions of the points of the first mesh, ascending."""
        n = len(dense.rows)
        wanted = (LEVEL_OF_NOISY if dense.noise else LEVEL) * n_vertices
        if wanted >= n:
            return np.arange(n)
        forced = np.flatnonzero(np.isin(dense.rows, chosen))
        tree = KdTree.over(np.ascontiguousarray(dense.places.T))
        others = dense.places[forced] if len(forced) else None
        even, _ = farthest_points(dense.places, max(1, wanted - len(forced)), tree, before=others)
        return np.union1d(even, forced)


def _result(cloud: PointCloud, rows: Ints, made: _Made, moved: bool, frame: Frame, timer: Timer) -> MeshResult:
    """Return a mesh in the unit of the cloud, with the attributes of its points."""
    indices = rows[made.rows]
    kept = cloud.take(indices)
    if moved:
        kept = kept.moved(frame.world(made.vertices))
    if "tolerance" in made.diagnostics:  # rounded to the type of the points, vertices may leave the tolerance
        kept = dataclasses.replace(kept, coordinate_dtype=np.dtype(np.float64))
    if kept.normals() is None:
        kept = with_normals(kept, made.normals)
    scaled = {name: made.diagnostics[name] * 2.0**frame.exponent for name in LENGTHS if name in made.diagnostics}
    topology = topology_of(made.faces)
    counts = {name: float(getattr(topology, name)) for name in ("borders", "pieces", "genus")}
    diagnostics = {**made.diagnostics, **scaled, **counts}
    return MeshResult(Mesh(kept.points, made.faces), indices, kept, timer.seconds, diagnostics)
