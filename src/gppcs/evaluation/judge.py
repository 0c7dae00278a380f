"""The judge: all figures of a simplification, from the two clouds and, where there is one, the original mesh."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.stages import Stages
from gppcs.errors import InputError, NoSurfaceError
from gppcs.evaluation.report import Rebuilt, Report, figures_of

if TYPE_CHECKING:
    from gppcs.spatial.kdtree import KdTree

ROUGH = 0.9  # quantile of the surface variation from which on a point counts as feature
FLAT = 1e-12  # surface variation that is no more than rounding
FAR = 0.1  # diagonals between two clouds from which on they cannot be of one thing
SMALL = 0.5  # of the original's size; what is smaller must lie closer to it,
CLOSE = 0.05  # to that part of its own size, lest a cloud in another unit pass that lies inside the original
MEASURABLE = 1e-70, 1e70  # sizes whose ratios can be squared within the range of numbers
STRAY = 0.05  # diagonals from the mesh, from which on a part of the rebuilt surface is astray
VARIATION = 25  # points of the neighbourhoods in which surface variation is measured, the paper's k

Points = NDArray[np.float64]
ReportPart = TypeVar("ReportPart", Report, Rebuilt)


def evaluate(
    original: PointCloud | ArrayLike,
    simplified: PointCloud | ArrayLike,
    mesh: Mesh | None = None,
    stages: Stages | None = None,
) -> Report:
    """Compare a simplified cloud with the original; points that repeat another exactly count once.

    Parameters
    ----------
    original, simplified : PointCloud or (N, 3) and (M, 3) array-likes
        With finite coordinates, in the same unit and place.
    mesh : Mesh, optional
        The surface that the original was taken from, to which the rebuilt one is compared; needs PyMeshLab, which
        comes with the extra `evaluate`.
    stages : Stages, optional
        Times the stages; one with a listener tells it of their progress.

    Raises
    ------
    InputError
        If either cloud is empty, misshapen or not finite, if a size is beyond 1e-70 to 1e70, if simplified cloud or
        mesh are elsewhere than the original, if the mesh has no area, or if some, but not all, of the normals that the
        simplified cloud carries are zero or not finite.
    NoSurfaceError
        If no surface can be rebuilt with estimated normals.
    MissingExtraError
        If a mesh is given and PyMeshLab is not installed.
    """
    report, failure = judged(original, simplified, mesh, stages or Stages())
    if failure:
        raise failure
    return report


def judged(
    original: PointCloud | ArrayLike, simplified: PointCloud | ArrayLike, mesh: Mesh | None, stages: Stages
) -> tuple[Report, NoSurfaceError | None]:
    """Return what `evaluate` does; where no surface can be rebuilt, the other figures and why."""
    from gppcs.spatial.cells import first_occurrences

    clouds = [PointCloud.of(cloud) for cloud in (original, simplified)]
    before, after = (
        cloud.usable(f"{name} cloud") for cloud, name in zip(clouds, ("original", "simplified"), strict=True)
    )
    for points, name in ((before, "original cloud"), (after, "simplified cloud")):
        _require_measurable(points, name)
    normals = None
    if mesh is not None:
        _require_measurable(mesh.vertices, "mesh")
        normals = _carried_normals(clouds[1])
    frame = _Frame.of(before)
    counts, first = (len(before), len(after)), first_occurrences(after)
    before, after = (frame.inside(points) for points in (before[first_occurrences(before)], after[first]))
    with stages("distances"):
        report = frame.outside(_without_mesh(before, after, frame, counts))
    if mesh is None:
        return report, None
    mesh, failure = Mesh(frame.inside(mesh.vertices), mesh.faces), None
    with stages("rebuilding"):
        _require_mesh_near(mesh, before, after, frame)
        try:
            report = dataclasses.replace(report, rebuilt=_rebuilt(after, None, mesh, frame))
        except NoSurfaceError as error:
            failure = error
    if normals is None:
        return report, failure
    with stages("rebuilding with carried normals"), contextlib.suppress(NoSurfaceError):
        report = dataclasses.replace(report, rebuilt_carried=_rebuilt(after, normals[first], mesh, frame))
    return report, failure


@dataclass(frozen=True)
class _Frame:
    """Where the figures are measured: the original's corner at the origin, its size about one.

    The unit is a power of two, so that nothing is rounded.
    """

    corner: Points
    unit: float
    diagonal: float  # of the original's box, in that unit

    @classmethod
    def of(cls, points: Points) -> _Frame:
        extent = np.ptp(points, axis=0)
        unit = 2.0 ** math.frexp(extent.max())[1]
        return cls(points.min(axis=0), unit, float(np.linalg.norm(extent / unit)))

    def inside(self, points: Points) -> Points:
        """Return points, (N, 3), in the frame."""
        return (points - self.corner) / self.unit

    def outside(self, part: ReportPart) -> ReportPart:
        """Return figures that were measured in the frame in the unit of the clouds."""
        values: dict[str, Any] = {
            name: known.relative(getattr(part, name), 1.0 / self.unit) for name, known in figures_of(type(part)).items()
        }
        return dataclasses.replace(part, **{name: value for name, value in values.items() if value is not None})


def _require_measurable(points: Points, name: str) -> None:
    """Refuse what is so large or so small that squared distances would overflow or vanish."""
    least, most = MEASURABLE
    largest = float(np.abs(points).max())
    size = float(np.ptp(points, axis=0).max()) if largest <= most else np.inf
    if size > most or 0 < size < least:
        found = f"coordinates up to {largest:.3g}" if largest > most else f"a size of {size:.3g}"
        raise InputError(
            f"expected the {name} to have a size of {least:g} to {most:g}, found {found}: bring all to another unit"
        )


def _carried_normals(cloud: PointCloud) -> Points | None:
    """Return the normals that the cloud carries, or None if it carries none or none has a direction."""
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
            f"{len(bad)} of the {len(cloud)} normals that the simplified cloud carries (nx, ny, nz) are zero or not "
            f"finite, the first at index {bad[0]}: drop these points, or the three attributes"
        )
    return normals


def _without_mesh(before: Points, after: Points, frame: _Frame, counts: tuple[int, int]) -> Report:
    """Return the figures that two clouds without repeats give by themselves."""
    from gppcs.evaluation.local_surface import PLANE, LocalSurface
    from gppcs.spatial.kdtree import KdTree
    from gppcs.spatial.spacing import surface_area
    from gppcs.surface.surface_variation import features_of_nearest

    tree = KdTree.build(before)
    _, to_original = tree.nearest_of(after, 1)
    _require_near(np.sqrt(to_original), "simplified cloud", after, before, frame)
    surface = LocalSurface.of(after)
    nearest, to_kept = surface.tree.nearest_of(before, 1)
    to_surface, surface_normals = surface.nearest_to(before)
    variation = features_of_nearest(tree, VARIATION).surface_variation
    normals = features_of_nearest(tree, PLANE).normals
    kept_normals = np.empty_like(after)
    kept_normals[surface.tree.order] = surface.normals
    spacing = np.sqrt(surface_area(tree) / len(after))
    return Report(
        points_in=counts[0],
        points_out=counts[1],
        diagonal=frame.diagonal,
        covering_radius=float(np.sqrt(to_kept.max())),
        mean_distance=float(np.sqrt(to_kept).mean()),
        chamfer=float(to_kept.mean() + to_original.mean()),
        surface_mean=float(to_surface.mean()),
        surface_rms=float(np.sqrt((to_surface**2).mean())),
        surface_p95=float(np.quantile(to_surface, 0.95)),
        surface_max=float(to_surface.max()),
        feature_error=float((to_surface * np.radians(_angles(normals, surface_normals))).mean()),
        feature_recall=float((np.sqrt(to_kept[_rough(variation)]) <= spacing).mean()),
        normal_deviation=float(_angles(normals, kept_normals[nearest[:, 0]]).mean()),
        mean_surface_variation=_mean_surface_variation(surface.tree, spacing),
    )


def _rough(variation: Points) -> NDArray[np.bool_]:
    """Tell which points count as feature: all, where there is no variation but rounding, or the roughest tenth.

    On lattices many points have the same variation but for rounding; whether these count must not depend on that.
    """
    if variation.max() <= FLAT:
        return np.ones(len(variation), dtype=np.bool_)
    return variation >= max(np.quantile(variation, ROUGH) * (1.0 - 1e-9), FLAT)


def _angles(first: Points, second: Points) -> Points:
    """Return the angles between directions without sign, in degrees; exactly zero for equal ones."""
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    angles: Points = np.degrees(np.arctan2(sine, np.abs(np.einsum("ij,ij->i", first, second))))
    return angles


def _mean_surface_variation(tree: KdTree, spacing: float) -> float:
    """Return the mean with the paper's radius, even where points crowd together, since its tables use that.

    The paper's rule sees only the bounding box. Where that is flat, or stretched by far points, the radius can be off
    without bound; then it is that of a disc for the same number of points at the target spacing.
    """
    from gppcs.spatial.spacing import paper_radius
    from gppcs.surface.surface_variation import features_in_radius

    radius, robust = paper_radius(tree.points.T, VARIATION), spacing * np.sqrt(VARIATION / np.pi)
    if not robust / 3 <= radius <= 3 * robust:
        radius = robust
    return float(features_in_radius(tree, radius).surface_variation.mean())


def _rebuilt(points: Points, normals: Points | None, mesh: Mesh, frame: _Frame) -> Rebuilt:
    """Return the surface rebuilt from points with the normals given, or with estimated ones, and its figures."""
    from gppcs.evaluation.reconstruction import distances_to, estimated_normals, reconstruct

    if normals is None:
        normals = estimated_normals(points, mesh.vertices, mesh.vertex_normals())
    rebuilt = reconstruct(points, normals)
    forth, back = distances_to(rebuilt, mesh.vertices), distances_to(mesh, rebuilt.vertices)
    areas = rebuilt.face_areas()
    astray = (back[rebuilt.faces] > STRAY * frame.diagonal).any(axis=1)
    figures = Rebuilt(
        mesh=Mesh(frame.corner + frame.unit * rebuilt.vertices, rebuilt.faces),
        hausdorff_mean=float(forth.mean()),
        hausdorff_max=float(forth.max()),
        back_mean=float(back.mean()),
        back_max=float(back.max()),
        pieces=rebuilt.count_pieces(),
        stray_share=float(areas[astray].sum() / areas.sum()),
    )
    return frame.outside(figures)


def _require_mesh_near(mesh: Mesh, before: Points, after: Points, frame: _Frame) -> None:
    """Refuse a mesh without area or elsewhere; by the boxes first, for PyMeshLab takes for ever over long distances."""
    from gppcs.evaluation.reconstruction import distances_to

    mesh.require_area("mesh")
    used = mesh.vertices[np.unique(mesh.faces)]
    gaps = np.maximum(np.maximum(used.min(axis=0) - after, after - used.max(axis=0)), 0.0)
    _require_near(np.linalg.norm(gaps, axis=1), "mesh", used, before, frame)
    _require_near(distances_to(mesh, after), "mesh", used, before, frame)


def _require_near(distances: Points, name: str, points: Points, original: Points, frame: _Frame) -> None:
    """Refuse what lies mostly far from the original, and tell by how much."""
    middle, limit = float(np.median(distances)), FAR * frame.diagonal
    if frame.diagonal == 0.0:
        limit = float(np.finfo(np.float32).eps * np.abs(frame.corner).max())  # rounding may move a point
    elif len(points) >= 10 and _spread(points) < SMALL * _spread(original):
        limit = min(limit, CLOSE * _spread(points))
    if middle <= limit:
        return
    size = np.linalg.norm(np.ptp(points, axis=0))
    found, of, whole = (f"{frame.unit * value:.3g}" for value in (middle, size, frame.diagonal))
    low = ", ".join(f"{frame.unit * value:.6g}" for value in points.min(axis=0))
    raise InputError(
        f"the {name} does not lie on the original: expected distances between them of a few spacings, found half of "
        f"them above {found}; the {name}'s box has a diagonal of {of}, the original's one of {whole}, and the low "
        f"corners are ({low}) apart: bring both to the same unit and origin"
    )


def _spread(points: Points) -> float:
    """Return the diagonal of the box without a twentieth of the points at each side."""
    return float(np.linalg.norm(np.diff(np.quantile(points, (0.05, 0.95), axis=0), axis=0)))
