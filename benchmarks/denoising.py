"""Denoise six noisy clouds whose surface is known, beside WLOP and smoothing followed by a choice.

Moving least squares (APSS and RIMLS) are PyMeshLab's, at the default filter scale of 2 and at 4 and 8. Jet and
bilateral smoothing are CGAL's; they are left out without the extra `cgal`. If clouds are named on the command line,
only these are run, and nothing is written.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import pymeshlab
from numpy.typing import NDArray

import gppcs
import report
from gppcs.evaluation.reconstruction import distances_to
from gppcs.spatial.kdtree import KdTree

Array = NDArray[np.float64]

LEVELS = ("2.5e-3", "5e-3", "1e-2", "2e-2")  # of the noisy Armadillos, in diagonals
OTHER_NOISE = 5e-3
SCALES = (2, 4, 8)  # of moving least squares
JET, BILATERAL, ANGLE = 60, 60, 25.0  # neighbours of CGAL's smoothing, and its sharpness angle
SHARP = 40.0  # degrees of an edge
SAMPLES = 400_000  # on the mesh, that tell the normal of the surface


class Case(NamedTuple):
    """A noisy cloud, how many of its points are kept, and its true surface; the diagonal of the mesh is 1."""

    points: Array
    n_points: int
    mesh: gppcs.Mesh
    has_edges: bool


class Outcome(NamedTuple):
    """The figures of one way, lengths in 1e-4 diagonals."""

    distance: float
    estimated: float  # H mean with estimated normals
    carried: float  # H mean with carried normals
    normals: float  # error of normals within two spacings of edges, in degrees; NaN without edges
    seconds: float  # CPU time, NaN if others smooth


def cases() -> dict[str, Case]:
    """Return the six clouds by name."""
    clean = gppcs.read_mesh(report.DATA / "armadillo_50k.ply")
    found = {}
    for level in LEVELS:
        cloud = gppcs.read(report.DATA / f"armadillo_100k_noise_{level}.ply").points
        found[f"Armadillo, {level}"] = scaled(cloud, 5_000, clean, 0.0)
    fandisk = gppcs.read_mesh(report.DATA / "fandisk.ply")
    found["fandisk, 5e-3"] = scaled(gppcs.read(report.DATA / "fandisk_60k_sampled.ply").points, 1_200, fandisk)
    found["cube, 5e-3"] = scaled(gppcs.read(report.DATA / "cube_30k_sampled.ply").points, 600, unit_cube())
    return found


def scaled(points: Array, n_points: int, mesh: gppcs.Mesh, noise: float = OTHER_NOISE) -> Case:
    """Return a case with noise on each coordinate."""
    diagonal = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    points = points / diagonal
    points = points + noise * np.random.default_rng(0).standard_normal(points.shape)
    return Case(points, n_points, gppcs.Mesh(mesh.vertices / diagonal, mesh.faces), noise > 0.0)


def unit_cube(steps: int = 40) -> gppcs.Mesh:
    """Return the unit cube around the origin as a fine mesh, so that H counts all of its faces."""
    line = np.linspace(-0.5, 0.5, steps + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    cell = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()
    across = cell + steps + 2
    square = np.concatenate(
        [np.column_stack([cell, cell + steps + 1, across]), np.column_stack([cell, across, cell + 1])]
    )
    vertices, faces = [], []
    for axis in range(3):
        for side in (-0.5, 0.5):
            place = np.empty((len(u), 3))
            place[:, axis], place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = side, u, v
            faces.append((square if side > 0 else square[:, ::-1]) + len(vertices) * len(u))
            vertices.append(place)
    places, again = np.unique(np.concatenate(vertices), axis=0, return_inverse=True)
    return gppcs.Mesh(places, again.reshape(-1)[np.concatenate(faces)])


def smoothed(points: Array) -> Iterator[tuple[str, Array]]:
    """Yield the points as others smooth them."""
    normals = gppcs.estimate_normals(points)
    for name in ("apss", "rimls"):
        for scale in SCALES:
            meshes = pymeshlab.MeshSet(verbose=False)
            for _ in range(2):
                meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points, v_normals_matrix=normals))
            meshes.set_current_mesh(0)  # PyMeshLab crashes unless the control mesh is the current one
            getattr(meshes, f"compute_mls_projection_{name}")(controlmesh=0, proxymesh=1, filterscale=scale)
            places = meshes.mesh(1).vertex_matrix()
            yield f"{name.upper()}, scale {scale}", places[np.isfinite(places).all(axis=1)]
    if importlib.util.find_spec("CGAL"):
        yield from by_cgal(points)


def by_cgal(points: Array) -> Iterator[tuple[str, Array]]:
    """Yield the points as CGAL smooths them."""
    from CGAL import CGAL_Point_set_processing_3 as processing
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Point_set_3 import Point_set_3

    def made() -> Any:
        given = Point_set_3()
        for x, y, z in points.tolist():
            given.insert(Point_3(x, y, z))
        return given

    def places(given: Any) -> Array:
        return np.array([[point.x(), point.y(), point.z()] for point in given.points()])

    jets = made()
    processing.jet_smooth_point_set(jets, JET)
    yield f"jets of {JET} points", places(jets)
    bilateral = made()
    processing.jet_estimate_normals(bilateral, BILATERAL)
    processing.bilateral_smooth_point_set(bilateral, BILATERAL, 0.0, ANGLE)
    yield f"bilateral, {BILATERAL} points", places(bilateral)


class Judge:
    """Measures kept points of one case."""

    def __init__(self, case: Case) -> None:
        self.case = case
        corners = case.mesh.vertices[case.mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        normals /= np.where(areas > 0, areas, 1.0)[:, None]
        rng = np.random.default_rng(0)
        faces = rng.choice(len(areas), SAMPLES, p=areas / areas.sum())
        u, v = np.sqrt(rng.random((SAMPLES, 1))), rng.random((SAMPLES, 1))
        a, b, c = corners[faces].transpose(1, 0, 2)
        self.surface, self.normals = KdTree.build((1 - u) * a + u * (1 - v) * b + u * v * c), normals[faces]
        self.spacing = np.sqrt(areas.sum() / 2 / case.n_points)
        self.edges = KdTree.build(on_edges(case.mesh, normals, self.spacing / 20)) if case.has_edges else None

    def outcome(self, cloud: gppcs.PointCloud, seconds: float) -> Outcome:
        """Return the figures of kept points with normals."""
        found = gppcs.evaluate(self.case.points, cloud, self.case.mesh)
        assert found.rebuilt_estimated is not None
        assert found.rebuilt_carried is not None
        distance = float(distances_to(self.case.mesh, cloud.points).mean())
        estimated, carried = found.rebuilt_estimated.hausdorff_mean, found.rebuilt_carried.hausdorff_mean
        return Outcome(1e4 * distance, 1e4 * estimated, 1e4 * carried, self.error_of_normals(cloud), seconds)

    def error_of_normals(self, cloud: gppcs.PointCloud) -> float:
        """Return the mean angle of carried normals to those of the nearest face, within two spacings of edges."""
        normals = cloud.normals()
        if self.edges is None or normals is None:
            return float("nan")
        near = self.edges.nearest_of(cloud.points, 1)[1][:, 0] < (2 * self.spacing) ** 2
        true = self.normals[self.surface.nearest_of(cloud.points[near], 1)[0][:, 0]]
        cosines = np.abs(np.einsum("ij,ij->i", normals[near], true)).clip(max=1.0)
        return float(np.degrees(np.arccos(cosines)).mean())


def on_edges(mesh: gppcs.Mesh, normals: Array, step: float) -> Array:
    """Return points on the edges whose faces meet at more than `SHARP` degrees."""
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    owners = np.tile(np.arange(len(mesh.faces)), 3)
    order = np.lexsort(np.sort(sides, axis=1).T)
    sides, owners = np.sort(sides, axis=1)[order], owners[order]
    pairs = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
    cosines = np.einsum("ij,ij->i", normals[owners[pairs]], normals[owners[pairs + 1]])
    a, b = mesh.vertices[sides[pairs[cosines < np.cos(np.radians(SHARP))]].T]
    counts = 1 + (np.linalg.norm(b - a, axis=1) / step).astype(int)
    return np.concatenate(
        [p + np.linspace(0, 1, n + 1)[:, None] * (q - p) for p, q, n in zip(a, b, counts, strict=True)]
    )


def outcomes(name: str, case: Case) -> Iterator[tuple[str, Outcome]]:
    """Yield the figures of all ways on one cloud."""
    judge = Judge(case)
    for way, method in (
        ("gp", gppcs.LocalGP()),
        ("gp, denoise", gppcs.LocalGP(denoise=True)),
        ("wlop, moved", gppcs.WLOP(snap=False)),
    ):
        seconds = []
        for _ in range(3):
            start = process_time()
            gppcs.simplify(case.points, n_points=case.n_points, method=method)
            seconds.append(process_time() - start)
        kept = gppcs.simplify(case.points, n_points=case.n_points, method=method, normals=True)
        yield way, judge.outcome(kept.cloud, min(seconds))
    for smoothing, points in smoothed(case.points):
        for method in ("fps", "gp"):
            try:
                kept = gppcs.simplify(points, n_points=case.n_points, method=method, normals=True)
                yield f"{smoothing}, then {method}", judge.outcome(kept.cloud, float("nan"))
            except gppcs.GppcsError as error:
                print(f"{name}, {smoothing}, {method}: {error}", file=sys.stderr)


def main() -> None:
    """Print and write the tables."""
    asked = sys.argv[1:]
    found: dict[str, dict[str, Outcome]] = {}
    for name, case in cases().items():
        if asked and name not in asked:
            continue
        found[name] = {}
        for way, outcome in outcomes(name, case):
            print(name, way, *(f"{value:.2f}" for value in outcome), sep=" | ", flush=True)
            found[name][way] = outcome
    if asked:
        return
    ways = list(dict.fromkeys(way for of_cloud in found.values() for way in of_cloud))
    headings = {
        "distance": "Mean distance of the kept points from the true surface, 1e-4 diagonals",
        "estimated": "H mean with estimated normals, 1e-4 diagonals",
        "carried": "H mean with carried normals, 1e-4 diagonals",
        "normals": "Mean error of carried normals within two spacings of edges, degrees",
        "seconds": "CPU seconds, least of three runs",
    }
    sections = []
    for figure, heading in headings.items():
        rows = []
        for way in ways:
            values = [getattr(found[name][way], figure) if way in found[name] else np.nan for name in found]
            if np.isfinite(values).any():
                rows.append([way, *(f"{value:.2f}" if np.isfinite(value) else "" for value in values)])
        sections.append(report.Section(heading, ["way", *found], rows))
    files = [*(f"armadillo_100k_noise_{level}" for level in LEVELS), "armadillo_50k"]
    files += ["fandisk", "fandisk_60k_sampled", "cube_30k_sampled"]
    report.write_sections(
        "denoising",
        "Denoising of kept points",
        sections,
        [report.DATA / f"{file}.ply" for file in files],
        (
            "Noise is the standard deviation of each coordinate, in diagonals of the clean mesh. 5,000 points of the "
            "Armadillos are kept, 1,200 of fandisk, 600 of the cube. H is measured as gppcs evaluate does, from the "
            "vertices of the clean mesh; the cube's mesh has 9,602 vertices.",
            "Others smooth all points, and fps or gp then chooses among them. An empty cell: no surface, or the "
            "smoothed points do not lie on the cloud. The scale that is best is known only where the surface is.",
            "Carried normals are those of denoise for gp with denoise, otherwise those of gppcs.estimate_normals on "
            "the cloud, or on the smoothed cloud.",
        ),
    )


if __name__ == "__main__":
    main()
