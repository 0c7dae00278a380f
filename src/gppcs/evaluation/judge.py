"""The judge: all figures of a simplification, from the two clouds and, where there is one, the original mesh."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.cloud import PointCloud
from gppcs.errors import InputError, NoSurfaceError
from gppcs.evaluation.report import Rebuilt, Report
from gppcs.mesh import Mesh
from gppcs.stages import Stages

ROUGH = 0.9  # quantile of the surface variation from which on a point counts as feature
FAR = 0.1  # diagonals between two clouds from which on they cannot be of one thing
STRAY = 0.05  # diagonals from the mesh, from which on a part of the rebuilt surface is astray
VARIATION = 25  # points of the neighbourhoods in which surface variation is measured, the paper's k

Points = NDArray[np.float64]


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
        If either cloud is empty, misshapen or not finite, or if simplified cloud or mesh are elsewhere than the
        original.
    NoSurfaceError
        If no surface can be rebuilt; it is an InputError, too.
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
    clouds = [PointCloud.of(cloud) for cloud in (original, simplified)]
    before, after = (
        cloud.usable(f"{name} cloud") for cloud, name in zip(clouds, ("original", "simplified"), strict=True)
    )
    corner = before.min(axis=0)
    diagonal = float(np.linalg.norm(before.max(axis=0) - corner))
    with stages("distances"):
        report = _without_mesh(before - corner, after - corner, diagonal)
    if mesh is None:
        return report, None
    ways: dict[str, Points | None] = {"rebuilt": None}
    if (carried := clouds[1].normals()) is not None:
        ways["rebuilt_carried"] = carried
    found: dict[str, Any] = {}
    failure = None
    for name, normals in ways.items():
        try:
            with stages("rebuilding" if normals is None else "rebuilding with carried normals"):
                found[name] = _rebuilt(after, normals, mesh, corner, diagonal)
        except NoSurfaceError as error:
            failure = error
    return dataclasses.replace(report, **found), failure


def _without_mesh(before: Points, after: Points, diagonal: float) -> Report:
    """Return the figures that two clouds give by themselves."""
    from gppcs.evaluation.local_surface import PLANE, LocalSurface
    from gppcs.features import features_of_nearest
    from gppcs.kdtree import KdTree
    from gppcs.neighbourhood import first_occurrences, surface_area

    counts = len(before), len(after)
    before, after = (points[first_occurrences(points)] for points in (before, after))
    tree, surface = KdTree.build(before), LocalSurface.of(after)
    _, to_original = tree.nearest_of(after, 1)
    _require_near(np.sqrt(to_original), "simplified cloud", after, diagonal)
    nearest, to_kept = surface.tree.nearest_of(before, 1)
    to_surface, surface_normals = surface.nearest_to(before)
    variation = features_of_nearest(tree, VARIATION).surface_variation
    normals = features_of_nearest(tree, PLANE).normals
    kept_normals = np.empty_like(after)
    kept_normals[surface.tree.order] = surface.normals
    spacing = np.sqrt(surface_area(tree) / len(after))
    rough = variation >= np.quantile(variation, ROUGH)
    return Report(
        points_in=counts[0],
        points_out=counts[1],
        diagonal=diagonal,
        covering_radius=float(np.sqrt(to_kept.max())),
        mean_distance=float(np.sqrt(to_kept).mean()),
        chamfer=float(to_kept.mean() + to_original.mean()),
        surface_mean=float(to_surface.mean()),
        surface_rms=float(np.sqrt((to_surface**2).mean())),
        surface_p95=float(np.quantile(to_surface, 0.95)),
        surface_max=float(to_surface.max()),
        feature_error=float((to_surface * np.radians(_angles(normals, surface_normals))).mean()),
        feature_recall=float((np.sqrt(to_kept[rough]) <= spacing).mean()),
        normal_deviation=float(_angles(normals, kept_normals[nearest[:, 0]]).mean()),
        mean_surface_variation=_mean_surface_variation(after, spacing),
    )


def _angles(first: Points, second: Points) -> Points:
    """Return the angles between directions without sign, in degrees; exactly zero for equal ones."""
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    angles: Points = np.degrees(np.arctan2(sine, np.abs(np.einsum("ij,ij->i", first, second))))
    return angles


def _mean_surface_variation(points: Points, spacing: float) -> float:
    """Return the mean with the paper's radius, even where points crowd together, since its tables use that.

    The paper's rule sees only the bounding box. Where that is flat, or stretched by far points, the radius can be off
    without bound; then it is that of a disc for the same number of points at the target spacing.
    """
    from gppcs.features import features_in_radius
    from gppcs.neighbourhood import ColumnGrid, paper_radius

    radius, robust = paper_radius(points, VARIATION), spacing * np.sqrt(VARIATION / np.pi)
    if not robust / 3 <= radius <= 3 * robust:
        radius = robust
    return float(features_in_radius(ColumnGrid.build(points, radius)).surface_variation.mean())


def _rebuilt(points: Points, normals: Points | None, mesh: Mesh, corner: Points, diagonal: float) -> Rebuilt:
    """Return the surface rebuilt from points with the normals given, or with estimated ones, and its figures."""
    from gppcs.evaluation.reconstruction import distances_to, estimated_normals, reconstruct

    points, mesh = points - corner, mesh.shifted(-corner)
    _require_near(distances_to(mesh, points), "mesh", mesh.vertices, diagonal)
    if normals is None:
        normals = estimated_normals(points, mesh.vertices, mesh.vertex_normals())
    rebuilt = reconstruct(points, normals)
    forth, back = distances_to(rebuilt, mesh.vertices), distances_to(mesh, rebuilt.vertices)
    areas = rebuilt.face_areas()
    astray = (back[rebuilt.faces] > STRAY * diagonal).any(axis=1)
    return Rebuilt(
        mesh=rebuilt.shifted(corner),
        hausdorff_mean=float(forth.mean()),
        hausdorff_max=float(forth.max()),
        back_mean=float(back.mean()),
        back_max=float(back.max()),
        pieces=rebuilt.count_pieces(),
        stray_share=float(areas[astray].sum() / areas.sum()),
    )


def _require_near(distances: Points, name: str, points: Points, diagonal: float) -> None:
    """Refuse what lies mostly far from the original, whose corner is at the origin, and tell by how much."""
    middle = float(np.median(distances))
    if middle <= FAR * diagonal or diagonal == 0.0:
        return
    size = float(np.linalg.norm(np.ptp(points, axis=0))) / diagonal
    offset = ", ".join(f"{value:.6g}" for value in points.min(axis=0))
    raise InputError(
        f"the {name} does not lie on the original: expected distances between them of a few spacings, found half of "
        f"them above {middle / diagonal:.3g} diagonals of it; the {name}'s box is {size:.3g} times as large, its low "
        f"corner off by ({offset}): bring both to the same unit and origin"
    )
