"""Compiles all kernels at once, by running every method on a small scan."""

from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gppcs
from gppcs import METHODS, PointCloud, Timer, mesh, sample, simplify
from gppcs.amounts.options import Options
from gppcs.drawing.camera import Viewpoint
from gppcs.drawing.single import draw_single
from gppcs.engine.helpers import Part
from gppcs.errors import MissingExtraError
from gppcs.evaluation.comparison import PREPARATION_POINTS
from gppcs.gp.local.first_run import compile_choice, compile_placement
from gppcs.gp.local.greedy import PART_POINTS
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods.hc.clustering import hierarchical_clusters
from gppcs.simplification import simplify_files
from gppcs.spatial.kdtree import KdTree
from gppcs.streaming.plan import make_plan
from gppcs.surface.surface_variation import features_in_radius


def parts() -> list[Part]:
    """Return parts of the work that together compile every kernel, for all types of arrays that it is called with."""
    # What takes longest comes first, and neighbours call different kernels, as processes work on them at once.
    methods: list[Part] = [(_simplify, str(method)) for method in METHODS if method != "gp"]
    return [
        (_simplify, "gp"),
        (compile_choice, 2 * PART_POINTS),
        (compile_placement,),
        (_mesh, "village", 40_000, {"n_points": 4_000, "moved": True}),  # which takes most steps of a mesh
        *methods,
        (_evaluate,),
        (_options,),
        (_read_only,),
        (_tiles,),
        (_pictures,),
        (_mesh, "fan", 30_000, {"n_faces": 2_000, "fill_holes": "5%"}),  # triangles cut others; a hole is filled
        (_mesh, "fan", 10_000, {"n_points": 1_000, "moved": True}),  # some triangles of which relax
        (_mesh, "medallion", 6_000, {"tolerance": "5%"}),
        (_mesh, "bracket", PREPARATION_POINTS, {"n_points": 500}),  # whose drilled holes are tried as small handles
    ]


def _scan(name: str = "medallion", n_points: int = PREPARATION_POINTS, outliers: float = 0.0) -> PointCloud:
    noise = {"fan": 0.001, "medallion": 0.002}.get(name, 0.0)  # which needs additional kernels
    return sample(name, n_points, noise=noise, outliers=outliers)


def _simplify(method: str) -> None:
    simplify(_scan(), ratio=0.1, method=method)


def _mesh(scan: str, n_points: int, options: dict[str, Any]) -> None:
    mesh(_scan(scan, n_points, 0.01 if "fill_holes" in options else 0.0), **options)


def _evaluate() -> None:
    scan = _scan()
    kept = simplify(scan, ratio=0.1, method="random").cloud
    gppcs.evaluate(scan, kept)
    gppcs.estimate_normals(scan, kept)
    with suppress(MissingExtraError):  # raised after all kernels
        gppcs.evaluate_mesh(scan, mesh(scan, n_points=100, effort=1).mesh)


def _options() -> None:
    scan, stray = _scan(), _scan("fan", 30_000, 0.01)
    simplify(stray, ratio=0.02, drop_outliers=True, max_gap="2%", normals=True)
    features_in_radius(KdTree.build(stray.points), 100.0)  # balls that hold whole nodes of the tree
    simplify(scan, tolerance="2%", keep="curvature > 0", weight=abs(scan.attributes["curvature"]))
    noisy = sample("sphere", 30_000, noise=0.003)  # whose noise is found
    simplify(noisy, ratio=0.02, method=gppcs.LocalGP(denoise=True))
    simplify(scan, ratio=0.1, detail="rgb")
    hierarchical_clusters(scan.points, size=10, variation=0.1)


def _read_only() -> None:
    points = _scan().points
    points.flags.writeable = False  # like memory-mapped arrays; another type for Numba
    gppcs.info(PointCloud(points))
    simplify(points, ratio=0.5, method="random")


def _pictures() -> None:
    scan = _scan()
    for surface in (None, mesh(scan, n_points=100).mesh):
        with suppress(MissingExtraError):
            draw_single(BytesIO(), scan, surface, None, Viewpoint(), (320, 240))


def _tiles() -> None:
    """Compile what only clouds beyond memory need."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "scan.ply")
        gppcs.write(path, _scan("fan", 30_000, 0.01))
        for method in ("gp", "fps", "voxel"):
            options = Options(ratio=0.02, method=method, drop_outliers=True)
            with CloudFiles([path]) as files:
                simplify_files(files, options, replace(make_plan(files, options), in_memory=False), Timer())
