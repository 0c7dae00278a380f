"""Put `gppcs mesh` beside screened Poisson reconstruction and decimation, in one run on one core.

Needs the extra `evaluate`. The rival is what people do today: PyMeshLab rebuilds a surface from the whole cloud by
screened Poisson reconstruction of depth 8, membranes far from all points are cut off, and quadric decimation leaves
twice as many triangles as the mesh of ours has vertices. Its time includes the normals that it needs.
Distances are in 1e-4 diagonals, by `gppcs.evaluate_mesh`: from the vertices of the original mesh, or where there is
none from the points. Names of clouds may be given; by default, all are measured.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import pymeshlab

import gppcs
import report
from gppcs.errors import NoSurfaceError
from gppcs.evaluation.reconstruction import reconstruct, without_membranes
from gppcs.spatial.scaling import normalised

CLOUDS = {  # file: the number or share of vertices, and the file of the original mesh, if there is one
    "dragon": (0.03, "dragon"),
    "armadillo_50k": (0.05, "armadillo_50k"),
    "nefertiti": (0.05, "nefertiti"),
    "bunny": (0.05, "bunny"),
    "face_rangemap": (0.03, "face_rangemap"),
    "sfm_angel": (0.1, "sfm_angel"),
    "fandisk_60k_sampled": (1200, None),
    "cube_30k_sampled": (600, None),
    "lion_takanawa": (0.03, None),
    "armadillo_173k_resampled": (0.02, "armadillo_50k"),
    "armadillo_100k_noise_2.5e-3": (0.05, "armadillo_50k"),
    "blade": (0.1, "blade"),
    "turbine": (0.2, "turbine"),
    "anchor_dense": (0.2, "anchor_dense"),
    "3dmatch_room_fragment": (0.03, None),
    "nyu_basement": (0.03, None),
    "pcl_table_mug_stereo": (0.03, None),
    "tum_desk": (5000, None),
    "redwood_livingroom_frame": (5000, None),
    "sfm_bird_bath": (0.1, "sfm_bird_bath"),
    "armadillo_crop_original": (0.05, None),
    "redwood_fragment": (0.03, None),
}
UNSEEN = 19  # no constant was chosen by those from here on


def ours(cloud: gppcs.PointCloud, n_vertices: int, moved: bool = True, effort: int = 0) -> gppcs.Mesh:
    """Return our mesh."""
    return gppcs.mesh(cloud, n_points=n_vertices, moved=moved, effort=effort).mesh


def poisson(cloud: gppcs.PointCloud, n_vertices: int) -> gppcs.Mesh:
    """Return the rival's mesh."""
    points, frame = normalised(cloud.points, cloud.units)
    rebuilt = without_membranes(reconstruct(points, gppcs.estimate_normals(points)), points)
    made = decimated(rebuilt, 2 * n_vertices)
    return gppcs.Mesh(frame.world(made.vertices), made.faces)


def decimated(mesh: gppcs.Mesh, n_faces: int) -> gppcs.Mesh:
    """Return a mesh with fewer triangles, by quadric edge collapse (Garland and Heckbert 1997)."""
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    meshes.meshing_remove_unreferenced_vertices()
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=n_faces, preservenormal=True)
    made = meshes.current_mesh()
    return gppcs.Mesh(made.vertex_matrix(), made.face_matrix())


WAYS: Mapping[str, Callable[[gppcs.PointCloud, int], gppcs.Mesh]] = {
    "points": partial(ours, moved=False),
    "moved": ours,
    "effort 2": partial(ours, effort=2),
    "Poisson": poisson,
}


def measured(name: str) -> list[tuple[str, ...]]:
    """Return the rows of one cloud."""
    amount, original = CLOUDS[name]
    cloud = gppcs.read(report.DATA / f"{name}.ply")
    n_vertices = round(amount * len(cloud)) if amount < 1 else int(amount)
    surface = gppcs.read_mesh(report.DATA / f"{original}.ply") if original else None
    rows = []
    for called, way in WAYS.items():
        first, start = name if not rows else "", time.process_time()
        try:
            mesh = way(cloud, n_vertices)
        except NoSurfaceError:
            rows.append((first, f"{len(cloud):,}", f"{n_vertices:,}", called, "no surface found", *[""] * 11))
            continue
        seconds = time.process_time() - start
        figures = gppcs.evaluate_mesh(cloud, mesh, surface).figures(relative=True)
        lengths = (f"{1e4 * figures[f'mesh_{key}']:.2f}" for key in ("mean", "max", "back_mean", "back_max"))
        counts = (
            f"{figures[key]:.0f}"
            for key in ("mesh_pieces", "boundary_loops", "genus", "non_manifold_edges", "non_manifold_vertices",
                        "self_intersections")
        )  # fmt: skip
        rows.append(
            (first, f"{len(cloud):,}", f"{figures['vertices']:,.0f}", called, *lengths,
             *counts, f"{100 * figures['slivers']:.2f}", f"{seconds:.1f}")
        )  # fmt: skip
        print(*rows[-1], file=sys.stderr, flush=True)
    return rows


def main() -> None:
    """Print and write the table."""
    gppcs.set_threads(1)
    for noise in (0.0, 0.01):  # loads the kernels
        for way in WAYS.values():
            way(gppcs.sample("sphere", n_points=5000, noise=noise), 100)
    names = sys.argv[1:] or [*CLOUDS]
    rows = [row for name in names for row in measured(name)]
    files = {file for name in names for file in (name, CLOUDS[name][1]) if file}
    report.write_sections(
        "meshes",
        "Light meshes straight from a cloud, beside screened Poisson reconstruction and decimation",
        [
            report.Section(
                "",
                ("cloud", "points", "vertices", "mesh", "mean", "max", "back mean", "back max", "pieces",
                 "boundary loops", "genus", "bad edges", "bad vertices", "cutting", "slivers, %", "seconds"),
                rows,
            )
        ],
        sorted(Path(report.DATA / f"{file}.ply") for file in files),
        [f"no constant was chosen by the last {len(CLOUDS) - UNSEEN} clouds"],
        "Distances in 1e-4 diagonals: mean and max from the original mesh's vertices (from the points where there is "
        "no mesh) to the mesh; back from the mesh's vertices. Cutting counts triangles that cut another. All on one "
        "core; the time of Poisson includes normals.",
    )  # fmt: skip


if __name__ == "__main__":
    main()
