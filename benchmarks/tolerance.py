"""Put `gppcs mesh --tolerance` beside Poisson reconstruction and decimation: vertices for the same largest distance.

Needs the extra `evaluate`. The rival is that of `meshes.py`: screened Poisson reconstruction of depth 8 of the whole
cloud. Quadric decimation then leaves as few triangles as keep the distance, found by halving. All distances are from
the points to the mesh, exactly. Outliers and points off the surface do not count: those farthest from the mesh of
ours, for the rival as many of its own farthest. Names of clouds may be given; by default, all of `meshes.py` are
measured.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import gppcs
import report
from gppcs.errors import NoSurfaceError
from gppcs.evaluation.reconstruction import distances_to, reconstruct, without_membranes
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import normalised
from gppcs.surface.normals import estimate_normals
from meshes import CLOUDS, decimated

TOLERANCES = 0.1, 0.3  # percent of the diagonal
FEWER = 0.95  # so many vertices are to miss the tolerance
CLOSE = 1.02  # the fewest vertices of the rival are found up to this factor


def largest(mesh: gppcs.Mesh, points: NDArray[np.float64], left_out: int) -> float:
    """Return the largest distance of points, (N, 3), from a mesh, without that of the farthest ones."""
    return float(np.partition(distances_to(mesh, points), -1 - left_out)[-1 - left_out])


def fewest(error: Callable[[int], float], most: int, tolerance: float) -> int | None:
    """Return the fewest triangles that keep a tolerance; None if the most do not."""
    few, enough = 8, most
    if error(most) > tolerance:
        return None
    while enough > CLOSE * few:
        middle = round((few * enough) ** 0.5)
        if error(middle) <= tolerance:
            enough = middle
        else:
            few = middle
    return enough


def measured(name: str) -> list[tuple[str, ...]]:
    """Return the rows of one cloud."""
    cloud = gppcs.read(report.DATA / f"{name}.ply")
    points, _ = normalised(cloud.points[first_occurrences(cloud.points)])
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    start = time.process_time()
    try:
        rebuilt = without_membranes(reconstruct(points, estimate_normals(points)), points)
    except NoSurfaceError:
        rebuilt = None
    poisson = time.process_time() - start
    rows = []
    for percent in TOLERANCES:
        tolerance, start = percent / 100.0 * diagonal, time.process_time()
        head = name if not rows else "", f"{len(points):,}", f"{percent}"
        try:
            result = gppcs.mesh(points, tolerance=f"{percent}%")
        except gppcs.ParameterError as error:
            if "below the noise" not in str(error):
                raise
            rows.append((*head, "", "", "below the noise", *6 * [""]))
            continue
        seconds, diagnostics = time.process_time() - start, result.diagnostics
        outliers, beside = diagnostics.outliers, diagnostics.off_surface
        missing = gppcs.mesh(points, n_points=round(FEWER * len(result.indices)), effort=2).mesh
        distances = distances_to(result.mesh, points)
        counted = np.argsort(distances, kind="stable")[: len(points) - outliers - beside]
        lengths = distances[counted].max(), distances_to(missing, points[counted]).max(), diagnostics.back_distance
        percents = [f"{100.0 * length / tolerance:.1f}" for length in lengths]
        row = [*head, f"{outliers:,}", f"{beside:,}", f"{len(result.indices):,}", *percents, f"{seconds:.0f}"]
        vertices = "no surface"
        if rebuilt is not None:
            vertices = _of_rival(rebuilt, points, outliers + beside, tolerance)
        rows.append((*row, vertices, f"{poisson:.0f}"))
        print(*rows[-1], file=sys.stderr, flush=True)
    return rows


def _of_rival(rebuilt: gppcs.Mesh, points: NDArray[np.float64], left_out: int, tolerance: float) -> str:
    """Return in words how many vertices the rival needs."""

    def error(n_faces: int) -> float:
        mesh = rebuilt if n_faces == len(rebuilt.faces) else decimated(rebuilt, n_faces)
        return largest(mesh, points, left_out)

    n_faces = fewest(error, len(rebuilt.faces), tolerance)
    if n_faces is None:
        return f"missed: {100.0 * error(len(rebuilt.faces)) / tolerance:.0f} %"
    return f"{len(np.unique(decimated(rebuilt, n_faces).faces)):,}"


def main() -> None:
    """Print and write the table."""
    gppcs.set_threads(1)
    names = sys.argv[1:] or [*CLOUDS]
    rows = [row for name in names for row in measured(name)]
    report.write_sections(
        "tolerance",
        "Vertices of meshes within a largest distance of the points, beside Poisson reconstruction and decimation",
        [
            report.Section(
                "",
                ("cloud", "points", "tolerance, %", "outliers", "off surface", "vertices", "largest, %",
                 "5 % fewer, %", "back, %", "seconds", "Poisson's vertices", "Poisson's seconds"),
                rows,
            )
        ],
        sorted(Path(report.DATA / f"{name}.ply") for name in names),
        [f"not measured: {', '.join(sorted(set(CLOUDS) - set(names)))}"] if set(CLOUDS) - set(names) else [],
        "Tolerances in % of the diagonal. Largest is the largest distance of the points from the mesh of ours, in % of "
        "the tolerance, and 5 % fewer that of a mesh of ours with so many vertices less (`--points`, `--effort 2`). "
        "Back is the largest distance of a vertex from the local surface of the points. Outliers and points off the "
        "surface do not count: those farthest from the mesh of ours, for Poisson as many of its own farthest. "
        "Poisson's vertices are the fewest after decimation that keep the tolerance, up to 2 %; where even its whole "
        "mesh misses, the largest distance in % of the tolerance. CPU seconds on one thread; those of Poisson are "
        "without decimation.",
    )  # fmt: skip


if __name__ == "__main__":
    main()
