"""Find out which figure ranks simplifications as the eye does, by rank correlation with the look of rebuilt meshes.

No people took part. Two differences between pictures of the original mesh and of the rebuilt mesh stand for the eye.
The first is one minus the structural similarity of the shaded surfaces (Wang et al. 2004). The second is the mean angle
between the surface normals at a pixel; it is 90 degrees if only one of the meshes covers the pixel. Both are means over
eight directions of view. Needs the extras `evaluate` and `view`.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.stats import spearmanr

import gppcs
import report

CASES = (  # cloud, mesh, ratio
    ("bunny", "bunny", 0.05),
    ("armadillo_50k", "armadillo_50k", 0.05),
    ("nefertiti", "nefertiti", 0.05),
    ("sfm_angel", "sfm_angel", 0.1),
    ("fandisk_60k_sampled", "fandisk", 0.02),
    ("turbine", "turbine", 0.1),
    ("anchor_dense", "anchor_dense", 0.2),
    ("armadillo_100k_noise_2.5e-3", "armadillo_50k", 0.05),
    ("armadillo_100k_noise_5e-3", "armadillo_50k", 0.05),
    ("dragon", "dragon", 0.03),
)
WITH_MESH = ("estimated_hausdorff_mean", "estimated_hausdorff_max")
WITHOUT = (
    "feature_error", "surface_mean", "surface_rms", "surface_p95", "surface_max", "normal_deviation", "mean_distance",
    "covering_radius", "chamfer", "feature_recall", "mean_surface_variation",
)  # fmt: skip
VIEWS, SIZE = 8, 384  # directions, pixels
LIGHT = np.array([-0.4, 0.5, 0.77]) / np.linalg.norm([-0.4, 0.5, 0.77])
CREASE = 30.0  # if faces meet at more degrees, the edge is drawn sharp

Array = NDArray[np.float64]


def directions() -> Array:
    """Return directions spread over the sphere, (VIEWS, 3)."""
    number = np.arange(VIEWS) + 0.5
    z, angle = 1 - 2 * number / VIEWS, np.pi * (1 + np.sqrt(5)) * number
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def normal_maps(mesh: gppcs.Mesh, frame: gppcs.Mesh) -> list[Array]:
    """Return the normals that each view shows, in camera axes, (SIZE, SIZE, 3); zero where there is no surface.

    The views show the box of the mesh `frame`.
    """
    surface = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces).compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=CREASE, consistent_normals=False
    )
    surface["colour"] = np.round(255 * (surface["Normals"] + 1) / 2).astype(np.uint8)
    middle = (frame.vertices.min(axis=0) + frame.vertices.max(axis=0)) / 2
    radius = np.linalg.norm(frame.vertices - middle, axis=1).max()
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=(SIZE, SIZE))
    plotter.set_background("black")
    plotter.disable_anti_aliasing()  # it would mix normals with the black background
    plotter.add_mesh(surface, scalars="colour", rgb=True, lighting=False)
    plotter.enable_parallel_projection()
    maps = []
    for direction in directions():
        up = np.array([0.0, 0.0, 1.0]) if abs(direction[1]) > 0.9 else np.array([0.0, 1.0, 0.0])
        plotter.camera.position, plotter.camera.focal_point = middle + 3 * radius * direction, middle
        plotter.camera.up, plotter.camera.parallel_scale = up, 1.02 * radius
        plotter.camera.clipping_range = radius, 5 * radius
        plotter.render()  # without it, the screenshot shows the first view again
        right = np.cross(up, direction) / np.linalg.norm(np.cross(up, direction))
        maps.append(in_camera(plotter.screenshot(return_img=True), [right, np.cross(direction, right), direction]))
    plotter.close()
    return maps


def in_camera(image: NDArray[np.uint8], axes: list[Array]) -> Array:
    """Turn the colours of a picture into normals in camera axes; zero where the picture is black."""
    covered = image.any(axis=2)
    normals = (image / 127.5 - 1) @ np.stack(axes, axis=1)
    lengths = np.maximum(np.linalg.norm(normals, axis=2), 1e-9)
    return np.where(covered, 1 / lengths, 0.0)[..., None] * normals


def looks(rebuilt: list[Array], original: list[Array]) -> tuple[float, float]:
    """Return the two differences: one minus structural similarity, and the mean angle in degrees."""
    dissimilar, angles = [], []
    for first, second in zip(rebuilt, original, strict=True):
        there = [normals.any(axis=2) for normals in (first, second)]
        seen = (there[0] | there[1]) & (second[..., 2] >= 0)  # without the inner sides of an open original
        cosine = np.einsum("ijk,ijk->ij", first, second)
        dissimilar.append(1 - similarity(shaded(first), shaded(second))[seen])
        angles.append(np.where(there[0] & there[1], np.degrees(np.arccos(np.clip(cosine, -1, 1))), 90.0)[seen])
    return float(np.concatenate(dissimilar).mean()), float(np.concatenate(angles).mean())


def shaded(normals: Array) -> Array:
    """Return the brightness of a matt surface; zero where there is no surface."""
    return np.where(normals.any(axis=2), 0.1 + 0.9 * np.maximum(normals @ LIGHT, 0), 0.0)


def similarity(first: Array, second: Array, sigma: float = 1.5) -> Array:
    """Return the structural similarity of two pictures from 0 to 1, at each pixel (Wang et al. 2004, Eq. 13)."""

    def mean(values: Array) -> Array:
        return gaussian_filter(values, sigma)

    m1, m2 = mean(first), mean(second)
    v1, v2, v12 = (mean(a * b) - c * d for a, b, c, d in
                   ((first, first, m1, m1), (second, second, m2, m2), (first, second, m1, m2)))  # fmt: skip
    small, smaller = 0.03**2, 0.01**2
    return (2 * m1 * m2 + smaller) * (2 * v12 + small) / ((m1**2 + m2**2 + smaller) * (v1 + v2 + small))


def correlations(cloud: gppcs.PointCloud, mesh: gppcs.Mesh, ratio: float) -> dict[str, tuple[float, float]]:
    """Return Spearman's rank correlation of each figure, over the methods, with the two differences."""
    entries = [entry for entry in gppcs.compare(cloud, ratio=ratio, mesh=mesh) if entry.report.rebuilt_estimated]
    original = normal_maps(mesh, mesh)
    seen = np.array([looks(normal_maps(entry.report.rebuilt_estimated.mesh, mesh), original) for entry in entries])
    found = {}
    for name in (*WITH_MESH, *WITHOUT):
        sign = -1 if name in ("feature_recall", "mean_surface_variation") else 1
        values = [sign * entry.report.figures()[name] for entry in entries]
        found[name] = tuple(spearmanr(values, column).statistic for column in seen.T)
    return found


def main() -> None:
    """Print and write the table."""
    of_case = {}
    for name, mesh, ratio in CASES:
        print(f"{name} at {ratio}", file=sys.stderr)
        cloud, surface = gppcs.read(report.DATA / f"{name}.ply"), gppcs.read_mesh(report.DATA / f"{mesh}.ply")
        of_case[f"{name}, {ratio}"] = correlations(cloud, surface, ratio)
    rows = []
    for name in (*WITH_MESH, *WITHOUT):
        both = np.array([found[name] for found in of_case.values()])
        summary = [f"{value:.2f}" for column in both.T for value in (np.nanmean(column), np.nanmin(column))]
        rows.append((name.replace("_", " "), *summary, *(f"{value:.2f}" for value in both[:, 0])))
    rows.sort(key=lambda row: -float(row[1]))
    report.write(
        "perception",
        "Rank correlation of figures with the look of the rebuilt mesh, "
        f"over {len(gppcs.METHODS)} methods, gp among them",
        (
            "figure",
            "structure: mean",
            "least",
            "angle of normals: mean",
            "least",
            *(f"structure: {case}" for case in of_case),
        ),
        rows,
        [report.DATA / f"{name}.ply" for name in dict.fromkeys(part for case in CASES for part in case[:2])],
    )


if __name__ == "__main__":
    main()
