"""Computes the figures of a simplification from two clouds and, if there is one, the original mesh."""

import dataclasses
import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from gppcs.amounts.accuracy import errors_of
from gppcs.clouds.cloud import CloudLike, PointCloud, usable
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.ranges import names_of_detail
from gppcs.clouds.topology import topology_of
from gppcs.engine.arrays import Flags, Floats
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError, NoSurfaceError, shown
from gppcs.evaluation import reconstruction
from gppcs.evaluation.detail import attribute_errors
from gppcs.evaluation.report import DetailErrors, MeshReport, Rebuilt, Report
from gppcs.io.reading import as_cloud
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame, bounds, normalised
from gppcs.spatial.spacing import areas_of_points, paper_radius, surface_area
from gppcs.spatial.triangles import qualities
from gppcs.surface.local_surface import PLANE_NEIGHBOURS, LocalSurface
from gppcs.surface.surface_variation import features_in_radius, features_of_nearest

VARIATION_NEIGHBOURS = 25  # points in the neighbourhoods of surface variation: k in the paper


def evaluate(
    original: CloudLike,
    simplified: CloudLike,
    mesh: Mesh | None = None,
    timer: Timer | None = None,
    detail: str | Sequence[str] = (),
) -> Report:
    """Compare a simplified cloud with the original.

    Points that repeat another point exactly count once.

    Parameters
    ----------
    original, simplified : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        Finite coordinates, in the same unit and frame. A warning tells if the second has more points.
    mesh : Mesh, optional
        The surface that the original was sampled from. With it, surfaces are rebuilt from the simplified cloud and
        compared with `mesh`, which needs PyMeshLab: with the normals of `mesh` at the nearest original points, with
        normals estimated on the simplified cloud as in the paper, and with those that this cloud carries, if any.
    timer : Timer, optional
        Records the time of each stage, and reports progress.
    detail : str or sequence of str
        Attributes of both clouds whose errors are measured, too; "rgb" stands for red, green and blue.

    Returns
    -------
    Report
        Lengths in the unit of the clouds. `gppcs.Report.definitions()` defines each figure.

    Raises
    ------
    InputError
        If a cloud is empty, malformed or not finite, or lacks an attribute of `detail`, if some, but not all, normals
        of the simplified cloud are zero or not finite, or if the clouds and the mesh do not lie on each other.
    NoSurfaceError
        If no surface can be rebuilt with the normals of the mesh.
    MissingExtraError
        If `mesh` is given and PyMeshLab is not installed.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> kept = gppcs.simplify(cloud, ratio=0.1, method="fps").cloud
    >>> report = gppcs.evaluate(cloud, kept)
    >>> report.points_in, report.points_out
    (2000, 200)
    """
    report, failure, _ = judged(original, simplified, mesh, timer_of(timer), names_of_detail(detail))
    if failure:
        raise failure
    return report


def evaluate_mesh(
    original: CloudLike, simplified: Mesh, mesh: Mesh | None = None, timer: Timer | None = None
) -> MeshReport:
    """Compare a simplified mesh with the original.

    Parameters
    ----------
    original : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        Finite coordinates.
    simplified : Mesh
        In the unit and frame of the original.
    mesh : Mesh, optional
        The surface that the original was sampled from. With it, distances are measured from its vertices, and to it.
    timer : Timer, optional
        Records the time of each stage, and reports progress.

    Returns
    -------
    MeshReport
        Lengths in the unit of the cloud. `MeshReport.definitions()` defines each figure.

    Raises
    ------
    InputError
        If the cloud is empty, malformed or not finite, or a mesh does not lie on it, or has no area.
    MissingExtraError
        If PyMeshLab is not installed.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=3000)
    >>> coarse, fine = (gppcs.mesh(cloud, n_points=n).mesh for n in (50, 500))
    >>> gppcs.evaluate_mesh(cloud, fine).mesh_mean < gppcs.evaluate_mesh(cloud, coarse).mesh_mean
    True
    """
    require_mesh(simplified)
    before, frame = _prepared(as_cloud(original))
    simplified, mesh = _local_mesh(simplified, frame), None if mesh is None else _local_mesh(mesh, frame)
    with timer_of(timer)("distances"):
        forth = _distances_to_original(simplified, before, before, frame)
        if mesh is not None:
            _distances_to_original(mesh, before, before, frame)
        used = simplified.vertices[np.unique(simplified.faces)]
        if mesh is None:
            back = LocalSurface.from_points(before).nearest_to(used)[0]
        else:
            forth, back = (
                reconstruction.distances_to(simplified, mesh.vertices),
                reconstruction.distances_to(mesh, used),
            )
        intersections = reconstruction.count_self_intersections(simplified)
    topology = topology_of(simplified.faces)
    report = MeshReport(
        vertices=len(used),
        triangles=len(simplified.faces),
        diagonal=_diagonal(before),
        **_mean_and_max("mesh", forth),
        **_mean_and_max("mesh_back", back),
        mesh_pieces=topology.pieces,
        boundary_loops=topology.boundary_loops,
        genus=math.nan if topology.genus is None else float(topology.genus),
        non_manifold_edges=topology.non_manifold_edges,
        non_manifold_vertices=topology.non_manifold_vertices,
        self_intersections=intersections,
        slivers=float((qualities(simplified.vertices, simplified.faces) < 0.2).mean()),
    )
    return report.in_unit(_unit_in(frame))


def _prepared(original: PointCloud) -> tuple[Floats, Frame]:
    """Return the distinct points of a cloud, (N, 3), in a frame, and this; or raise an error about them."""
    points = usable(original, "original cloud")
    _require_measurable(points, "original cloud")
    local, frame = normalised(points, original.units)
    return local[first_occurrences(local)], frame


def judged(
    original: CloudLike, simplified: CloudLike, mesh: Mesh | None, timer: Timer, detail: Sequence[str] = ()
) -> tuple[Report, NoSurfaceError | None, Floats]:
    """Return the report of `evaluate`, and why no surface could be rebuilt, if none could.

    Return also the distances (N,) of the original's distinct points from the surface of the simplified cloud.
    """
    original, simplified = as_cloud(original), as_cloud(simplified)
    (before, frame), after = _prepared(original), usable(simplified, "simplified cloud")
    _require_measurable(after, "simplified cloud")
    carried = None
    if mesh is not None:
        mesh, carried = _local_mesh(mesh, frame), _carried_normals(simplified)
    after = frame.near(after)
    first = first_occurrences(after)
    counts, after = (len(original), len(simplified)), after[first]
    with timer("distances"):
        report, distances = _without_mesh(before, after, frame, counts)
        report, distances = report.in_unit(_unit_in(frame)), frame.lengths(distances)
    if report.points_out > report.points_in:
        warnings.warn("the second cloud has more points than the first; give the original first", stacklevel=3)
    if detail:
        with timer("detail"):
            distinct = original.take(np.flatnonzero(first_occurrences(original.points)))
            figures = {
                name: DetailErrors(*(float(f) for errors in pair for f in (errors.mean(), np.quantile(errors, 0.95))))
                for name, pair in attribute_errors(distinct, simplified, list(detail)).items()
            }
            report = dataclasses.replace(report, detail=figures)
    if mesh is None:
        return report, None, distances
    made, failures = dict[str, Any](), dict[str, NoSurfaceError]()
    with timer("normals"):
        _distances_to_original(mesh, before, after, frame)
        nearest = KdTree.build(before).nearest_of(after, 1)[0][:, 0]  # of a point that has not moved, itself
        kinds: dict[str, Floats] = {
            "rebuilt": reconstruction.exact_normals(mesh, before[nearest]),
            "rebuilt_estimated": reconstruction.estimated_normals(after, mesh.vertices, mesh.vertex_normals()),
            **({} if carried is None else {"rebuilt_carried": carried[first]}),
        }
    for name, normals in kinds.items():
        with timer("rebuilding"):
            try:
                made[name] = _rebuilt(reconstruction.reconstruct(after, normals), mesh, frame, _diagonal(before))
            except NoSurfaceError as error:
                failures[name] = error
    return dataclasses.replace(report, **made), failures.get("rebuilt"), distances


def require_mesh(mesh: Any) -> Mesh:
    """Return a mesh, or raise an error if an object is none."""
    if not isinstance(mesh, Mesh):
        raise InputError(f"expected a gppcs.Mesh, found {shown(mesh)}; make one, or read one with gppcs.read_mesh")
    return mesh


def _local_mesh(mesh: Mesh, frame: Frame) -> Mesh:
    """Return a mesh in a frame, or raise an error about it."""
    _require_measurable(require_mesh(mesh).vertices, "mesh")
    return Mesh(frame.near(mesh.vertices), mesh.faces)


def _unit_in(frame: Frame) -> float:
    """Return the unit of the clouds in that of their frame."""
    return math.ldexp(1.0, -frame.exponent)


def _require_measurable(points: Floats, name: str) -> None:
    """Raise an error if the points (N, 3) are so large or so small that squared distances overflow or vanish."""
    smallest, largest = 1e-70, 1e70
    lower, upper = bounds(points)
    farthest = float(np.maximum(-lower, upper).max())
    size = float((upper - lower).max()) if farthest <= largest else np.inf
    if size > largest or 0 < size < smallest:
        actual = f"coordinates up to {farthest:.3g}" if farthest > largest else f"a size of {size:.3g}"
        raise InputError(
            f"expected the {name} to have a size of {smallest:g} to {largest:g}, found {actual}: change the "
            "unit of all inputs"
        )


def _mean_and_max(name: str, distances: Floats) -> dict[str, Any]:
    """Return the mean and the largest of distances, (K,), as figures."""
    return {f"{name}_mean": float(distances.mean()), f"{name}_max": float(distances.max())}


def _carried_normals(cloud: PointCloud) -> Floats | None:
    """Return the normals of the cloud, (M, 3), or None if it has none or all are zero or not finite."""
    normals = cloud.normals()
    if normals is None:
        return None
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(normals, axis=1)
    bad = np.flatnonzero(~(np.isfinite(lengths) & (lengths > 0)))
    if len(bad) == len(cloud):
        return None
    if len(bad):
        raise InputError(
            f"expected finite normals of the simplified cloud that are not zero (nx, ny, nz), found {len(bad)} of the "
            f"{len(cloud)} normals zero or not finite, the first at index {bad[0]}: drop these points or attributes"
        )
    return normals


def _without_mesh(before: Floats, after: Floats, frame: Frame, counts: tuple[int, int]) -> tuple[Report, Floats]:
    """Return the figures that need no mesh, and distances (N,), in the frame's unit, for clouds without repeats."""
    built = KdTree.build(before)
    tree = built.in_own_order()
    before = np.ascontiguousarray(tree.points.T)  # points after each other find the same kept ones
    _, to_original = tree.nearest_of(after, 1)
    _require_near(np.sqrt(to_original), "simplified cloud", after, before, frame)
    surface = LocalSurface.from_points(after)
    feet = surface.find(before)
    to_surface, to_kept = feet.distances, feet.squared
    variation = features_of_nearest(tree, VARIATION_NEIGHBOURS).surface_variation
    normals = features_of_nearest(tree, PLANE_NEIGHBOURS).normals
    spacing = np.sqrt(surface_area(tree) / len(after))
    distances, areas = np.sqrt(to_kept), areas_of_points(tree)
    measures: dict[str, Any] = {f"surface_{measure}": error for measure, error in errors_of(to_surface).items()}
    errors = to_surface * np.radians(_angles(normals, surface.normals_at(feet)))
    report = Report(
        points_in=counts[0],
        points_out=counts[1],
        diagonal=_diagonal(before),
        covering_radius=float(distances.max()),
        covering_p999=float(np.quantile(distances, 0.999)),
        mean_distance=float(distances.mean()),
        mean_distance_by_area=float(np.average(distances, weights=areas)),
        chamfer=float(to_kept.mean() + to_original.mean()),
        surface_mean_by_area=float(np.average(to_surface, weights=areas)),
        surface_p95_by_area=_weighted_quantile(to_surface, areas, 0.95),
        **measures,
        feature_error=float(errors.mean()),
        feature_error_by_area=float(np.average(errors, weights=areas)),
        feature_recall=float((distances[_rough(variation)] <= spacing).mean()),
        normal_deviation=float(_angles(normals, surface.normals[feet.nearest]).mean()),
        mean_surface_variation=_mean_surface_variation(surface.tree, spacing),
    )
    return report, to_surface[built.positions()]


def _diagonal(points: Floats) -> float:
    """Return the diagonal of the bounding box of points, (K, 3)."""
    return float(np.linalg.norm(np.subtract(*bounds(points))))


def _weighted_quantile(values: Floats, weights: Floats, fraction: float) -> float:
    """Return the value, (N,), below which a fraction of the weight, (N,), lies, between the middles of weights."""
    order = np.argsort(values)
    ends = np.cumsum(weights[order])
    return float(np.interp(fraction * ends[-1], ends - weights[order] / 2.0, values[order]))


def _rough(variation: Floats) -> Flags:
    """Return which points (N,) are features: the tenth of largest surface variation, with ties, or all if flat."""
    rounding = 1e-12  # smaller surface variation is rounding error
    if variation.max() <= rounding:
        return np.ones(len(variation), dtype=np.bool_)
    return variation >= max(float(np.quantile(variation, 0.9)) * (1.0 - 1e-9), rounding)


def _angles(first: Floats, second: Floats) -> Floats:
    """Return the angles (N,) between directions (N, 3) without sign, in degrees; exactly 0 for equal directions."""
    across = np.linalg.norm(np.cross(first, second), axis=1)
    return np.degrees(np.arctan2(across, np.abs(np.einsum("ij,ij->i", first, second))))


def _mean_surface_variation(tree: KdTree, spacing: float) -> float:
    """Return the mean surface variation with the paper's radius, or a robust one where the box makes that wrong."""
    radius, robust = paper_radius(tree.points.T, VARIATION_NEIGHBOURS), spacing * np.sqrt(VARIATION_NEIGHBOURS / np.pi)
    if not robust / 3 <= radius <= 3 * robust:
        radius = robust
    return float(features_in_radius(tree, radius).surface_variation.mean())


def _rebuilt(rebuilt: Mesh, mesh: Mesh, frame: Frame, diagonal: float) -> Rebuilt:
    """Return a rebuilt mesh with its figures."""
    forth, back = (
        reconstruction.distances_to(rebuilt, mesh.vertices),
        reconstruction.distances_to(mesh, rebuilt.vertices),
    )
    areas = rebuilt.face_areas()
    astray = (back[rebuilt.faces] > 0.05 * diagonal).any(axis=1)
    figures = Rebuilt(
        mesh=Mesh(frame.world(rebuilt.vertices), rebuilt.faces),
        **_mean_and_max("hausdorff", forth),
        **_mean_and_max("back", back),
        pieces=rebuilt.count_pieces(),
        stray_share=float(areas[astray].sum() / areas.sum()),
    )
    return figures.in_unit(_unit_in(frame))


def _distances_to_original(mesh: Mesh, before: Floats, after: Floats, frame: Frame) -> Floats:
    """Return the distances of points (K, 3) to a mesh that has an area and lies on the original, or raise an error."""
    reconstruction.require_area(mesh, "mesh")
    distances = reconstruction.distances_to(mesh, after)
    _require_near(distances, "mesh", mesh.vertices[np.unique(mesh.faces)], before, frame)
    return distances


def _require_near(distances: Floats, name: str, points: Floats, original: Floats, frame: Frame) -> None:
    """Raise an error if the median of the distances (K,) of points (K, 3) to the original is too large."""
    middle, diagonal = float(np.median(distances)), _diagonal(original)
    limit = 0.1 * diagonal  # clouds farther from each other show different objects
    if diagonal == 0.0:  # rounding to float32 may move a point
        limit = math.ldexp(np.finfo(np.float32).eps * np.abs(frame.corner * frame.factors).max(), -frame.exponent)
    elif len(points) >= 10 and middle > 0.05 * _spread(points) and _spread(points) < 0.5 * _spread(original):
        limit = min(limit, 0.05 * _spread(points))  # probably in another unit
    if middle <= limit:
        return
    distance, size, expected = (math.ldexp(value, frame.exponent) for value in (middle, _diagonal(points), diagonal))
    corner = ", ".join(f"{value:.6g}" for value in np.ldexp(points.min(axis=0) - original.min(axis=0), frame.exponent))
    raise InputError(
        f"the {name} does not lie on the original: expected distances of a few spacings between them, found a median "
        f"of {distance:.3g}; the bounding box of the {name} has a diagonal of {size:.3g}, that of the original "
        f"{expected:.3g}, and the minimum corners differ by ({corner}): use the same unit and origin for both"
    )


def _spread(points: Floats) -> float:
    """Return the diagonal of the box from the 5th to the 95th percentile of the points (N, 3) along each axis."""
    return float(np.linalg.norm(np.diff(np.quantile(points, (0.05, 0.95), axis=0), axis=0)))
