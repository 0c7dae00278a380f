"""The command `gppcs mesh`: a cloud to a light mesh."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gppcs.app import options
from gppcs.app.panels import SIZE
from gppcs.app.printing import (
    length_in_words,
    names_of,
    note_left_out,
    number_in_words,
    of_unknown_unit,
    print_error,
    record_of_run,
    show,
    started,
    time_in_words,
)
from gppcs.errors import InputError

WORDS = {
    "dense_points": "dense points",
    "noise": "noise of the points",
    "mean_distance": "mean distance of the points, noise aside, from the mesh",
    "tolerance": "tolerance",
    "largest_distance": "largest distance of the points that count",
    "back_distance": "largest distance of a vertex from the points' surface",
    "left_out": "share of the points on no piece of the surface",
    "opened": "small holes where triangles would cut others",
    "missing": "points to keep that are no vertices",
    "added": "vertices that are no points to keep",
}  # for the diagnostics

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud
    from gppcs.meshing.pipeline import MeshResult

EPILOG = (
    "gppcs mesh scan.ply -o small.ply --points 5k\n\n"
    "gppcs mesh scan.ply -o small.glb --faces 20k --moved\n\n"
    "gppcs mesh scan.ply -o best.ply --points 2k --effort 2\n\n"
    "gppcs mesh scan.ply -o small.stl --tolerance 0.5 --fill-holes 20 --lossy\n\n"
    "gppcs simplify scan.ply -o kept.ply --ratio 5% && gppcs mesh scan.ply -o small.ply --keep-points kept.ply\n\n"
    "gppcs evaluate scan.ply --simplified-mesh small.ply measures how good a mesh is."
)


def mesh(
    cloud: Path = options.CLOUD,
    output: Path = options.output("OUT", "The mesh file to write: .ply, .obj, .stl, .off or .glb (glTF)."),
    points: str | None = options.option("M", "Number of vertices, such as 5000, 5,000, 5k or 1.5M.", SIZE),
    ratio: str | None = options.RATIO,
    faces: str | None = options.option("F", "Number of triangles at most, with those that fill holes.", SIZE),
    tolerance: str | None = options.option(
        "LENGTH",
        "Largest distance from the points to the mesh, without outliers: 0.5 (in the unit of the coordinates), 0.5mm, "
        "or 0.2% of the diagonal. Vertices leave the points as with --moved. 0.5mm:mean is for the mean distance.",
        SIZE,
    ),
    keep_points: Path | None = options.option(
        "FILE", "A file of points of IN: they become the vertices. They may come from gppcs simplify.", SIZE
    ),
    moved: bool = options.flag("--moved", "Let the vertices leave the points, so that the mesh fits these better."),
    effort: int = options.option(
        "E",
        "0, 1 or 2: take more time for a mesh that fits the points better. With 1 or 2, vertices leave the points as "
        "with --moved.",
        default=0,
    ),
    unit: str | None = options.UNIT,
    fill_holes: str | None = options.option(
        "LENGTH", "Also close holes up to this size: the diagonal of the box around the border."
    ),
    input_format: str | None = options.FROM,
    columns: str | None = options.COLUMNS,
    drop: options.Invalid | None = options.DROP_INVALID,
    threads: int | None = options.THREADS,
    force: bool = options.FORCE,
    lossy: bool = options.LOSSY,
    quiet: bool = options.QUIET,
    as_json: bool = options.JSON,
) -> None:
    """Make a light mesh straight from a dense cloud.

    Give one of --points, --ratio, --faces, --tolerance and --keep-points. The vertices are points of the cloud, with
    all their attributes; with --tolerance, --moved and --effort they leave the points. Where the points leave holes,
    the mesh is open.
    """
    from gppcs import io
    from gppcs.clouds.quantities import unit_of
    from gppcs.io.files import naming
    from gppcs.io.mesh_files import check_mesh_storable, mesh_format_of, write_mesh
    from gppcs.meshing.pipeline import Size
    from gppcs.meshing.pipeline import mesh as meshed

    timer = started(quiet, threads)
    size: dict[str, Any] = {"n_points": points, "ratio": ratio, "n_faces": faces, "tolerance": tolerance}
    size |= {"unit": unit, "fill_holes": fill_holes}
    asked = Size.of(**size, keep=keep_points)
    mesh_format_of(output)
    files = [cloud, *filter(None, [keep_points])]
    io.check_distinct([output], files)
    io.check_writable(output, force)
    with timer("reading"):
        original, *others = (read for read, _ in io.read_each(files, input_format, names_of(columns)))
        kept = _rows_of(original, others[0], keep_points) if keep_points else None
    check_mesh_storable(output, original, lossy)
    with naming(cloud):
        result = meshed(
            original, **size, keep=kept, moved=moved, effort=effort, invalid="drop" if drop else "error", timer=timer
        )  # fmt: skip
    with timer("writing"):
        lost = write_mesh(output, result.mesh, result.cloud, force, lossy=True)
    note_left_out(output, lost)
    _note_fewer(cloud, result, asked.n_points)
    _note_bound(cloud, result.diagnostics)
    _note_noise(cloud, result.diagnostics, bool(moved or effort))
    vertices, triangles = len(result.mesh.vertices), len(result.mesh.faces)
    record = {
        "input": str(cloud),
        "output": str(output),
        "points_in": len(original),
        "vertices": vertices,
        "triangles": triangles,
        **record_of_run(result.diagnostics, result.seconds),
    }
    rows = {
        "points": f"{len(original):,}",
        "mesh": f"{vertices:,} vertices, {triangles:,} triangles",
        "shape": _shape(result.diagnostics),
        **_measured(result.diagnostics, unit_of(original.header, unit), _diagonal(original)),
        "time": time_in_words(result.seconds),
    }
    show(record, f"{cloud} → {output}", rows, as_json, quiet)


def _diagonal(cloud: PointCloud) -> float:
    """Return the diagonal of the bounding box of the finite points."""
    import numpy as np

    return math.hypot(*np.ptp(cloud.points[cloud.finite_rows()], axis=0))  # no square overflows


def _measured(diagnostics: Mapping[str, float], unit: str | None, diagonal: float) -> dict[str, str]:
    """Return the diagnostics that are not 0 as rows of a table, with units."""
    from gppcs.meshing.pipeline import LENGTHS

    rows = {}
    for name, word in WORDS.items():
        if value := diagnostics.get(name):
            if name in LENGTHS:
                rows[word] = length_in_words(value, unit, diagonal)
            else:
                rows[word] = f"{value:.3%}" if name == "left_out" else number_in_words(value)
    return rows | of_unknown_unit(unit)


def _rows_of(original: PointCloud, kept: PointCloud, path: Path) -> NDArray[Any]:
    """Return the rows of the points of a file in the original."""
    import numpy as np

    from gppcs.clouds.cloud import usable
    from gppcs.spatial.kdtree import KdTree

    rows, places = original.finite_rows(), usable(kept, "cloud of points to keep")
    if not len(rows):
        return rows  # `mesh` tells what is wrong with the cloud
    nearest, squared = KdTree.build(original.points[rows]).nearest_of(places, 1)
    if len(strange := np.flatnonzero(squared[:, 0] > 0)):
        raise InputError(
            f"{path}: expected points of the cloud, found {len(strange)} that are none, the first at index "
            f"{strange[0]}: methods that move points, such as wlop, give no such points"
        )
    return rows[nearest[:, 0]]


def _note_fewer(source: Path, result: MeshResult, asked: int | None) -> None:
    """Print notes on what the mesh lacks: vertices that were asked for, parts of the surface."""
    made = len(result.indices)
    if asked is not None and made < asked:
        print_error(f"note: {source}: the mesh has {made:,} vertices, fewer than the {asked:,} asked for")
    if missing := int(result.diagnostics.get("missing", 0)):
        print_error(
            f"note: {source}: {missing:,} of the points to keep are on no piece of the surface, so they are left out"
        )
    if added := int(result.diagnostics.get("added", 0)):
        print_error(
            f"note: {source}: vertices that are no points to keep: {added:,}, as holes, handles and small pieces need "
            "them"
        )
    if (share := result.diagnostics["left_out"]) > 0.001 and "off_surface" not in result.diagnostics:
        print_error(f"note: {source}: {share:.1%} of the points are on no piece of the surface that is large enough")
    if opened := int(result.diagnostics["opened"]):
        print_error(f"note: {source}: the mesh has small holes ({opened:,}) where triangles would cut others")


def _note_bound(source: Path, found: Mapping[str, float]) -> None:
    """Print a note on what a largest distance does not hold for."""
    outliers, beside = (int(found.get(name, 0)) for name in ("outliers", "off_surface"))
    if outliers or beside:
        print_error(
            f"note: {source}: outliers ({outliers:,}) and other places that noise moved or no triangle reaches "
            f"({beside:,}) may be farther than the tolerance. gppcs evaluate IN --simplified-mesh OUT measures all "
            "points"
        )


def _note_noise(source: Path, found: Mapping[str, float], moved: bool) -> None:
    """Print a note on noise that the mesh has, too."""
    noise, tolerance = found["noise"], found.get("tolerance")
    if tolerance is None and noise and not moved:
        size = number_in_words(noise)
        print_error(f"note: {source}: the points have noise of about {size}, and so has their mesh; --moved removes it")
    if tolerance is not None and noise > tolerance:
        print_error(
            f"note: {source}: the tolerance of {tolerance:.3g} is below the noise of the points, {noise:.3g}: the mesh "
            "follows the noise; give a larger tolerance, or --points M with --moved"
        )


def _shape(counts: Mapping[str, float]) -> str:
    """Return in words whether a mesh is closed, and its holes, pieces and handles."""
    holes, pieces, genus = (int(counts[name]) for name in ("borders", "pieces", "genus"))
    border = f"open at {holes:,} hole{'s' * (holes > 1)} or rim{'s' * (holes > 1)}" if holes else "closed, no holes"
    return f"{border}; {pieces:,} piece{'s' * (pieces > 1)}; genus {genus:,}"
