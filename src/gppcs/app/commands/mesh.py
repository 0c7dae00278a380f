"""The command `gppcs mesh`: a cloud to a light mesh."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs import __version__
from gppcs.app import options, panels
from gppcs.app.printing import (
    names_of,
    note_left_out,
    number_in_words,
    print_error,
    print_json,
    progress,
    time_in_words,
)
from gppcs.engine.memory import peak_memory
from gppcs.engine.threads import set_threads
from gppcs.engine.timer import COMPILATION
from gppcs.errors import InputError, file_path

WORDS = {
    "dense_points": "dense points",
    "noise": "noise of the points",
    "mean_distance": "mean distance of the points from the mesh",
    "left_out": "share of the points on no piece of the surface",
    "opened": "places with small holes",
    "missing": "points to keep that are no vertices",
}  # for the diagnostics

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud
    from gppcs.meshing.pipeline import MeshResult

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs mesh scan.ply -o small.ply --points 5k\n\n"
    "gppcs mesh scan.ply -o small.glb --faces 20k --moved\n\n"
    "gppcs mesh scan.ply -o small.stl --tolerance 0.5 --fill-holes 20 --lossy\n\n"
    "gppcs simplify scan.ply -o kept.ply --ratio 5% && gppcs mesh scan.ply -o small.ply --keep-points kept.ply\n\n"
    "gppcs evaluate scan.ply --simplified-mesh small.ply measures how good a mesh is."
)


def mesh(
    cloud: Annotated[
        Path, typer.Argument(metavar="IN", parser=file_path, help="A point cloud file.", show_default=False)
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            parser=file_path,
            help="The mesh file to write: .ply, .obj, .stl, .off or .glb (glTF).",
        ),
    ],
    points: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="Number of vertices, such as 5000, 5,000, 5k or 1.5M.",
            rich_help_panel=panels.SIZE,
        ),
    ] = None,
    ratio: options.Ratio = None,
    faces: Annotated[
        str | None,
        typer.Option(
            metavar="F",
            help="Number of triangles at most, with those that fill holes.",
            rich_help_panel=panels.SIZE,
        ),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help="Mean distance from the points to the mesh at most: 0.5 (in the unit of the coordinates), 0.5mm, or "
            "0.02% of the diagonal.",
            rich_help_panel=panels.SIZE,
        ),
    ] = None,
    keep_points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A file of points of IN: they become the vertices. They may come from gppcs simplify.",
            rich_help_panel=panels.SIZE,
        ),
    ] = None,
    moved: Annotated[
        bool, typer.Option("--moved", help="Let the vertices leave the points, so that the mesh fits these better.")
    ] = False,
    unit: options.Unit = None,
    fill_holes: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help="Also close holes up to this size: the diagonal of the box around the border.",
        ),
    ] = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    drop: options.DropInvalid = None,
    threads: options.Threads = None,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make a light mesh straight from a dense cloud.

    Give one of --points, --ratio, --faces, --tolerance and --keep-points. The vertices are points of the cloud, with
    all their attributes. Where the points leave holes, the mesh is open.
    """
    from gppcs import io
    from gppcs.engine.timer import Timer
    from gppcs.io.files import naming
    from gppcs.io.mesh_files import check_mesh_format, check_mesh_storable, write_mesh
    from gppcs.meshing.pipeline import Size
    from gppcs.meshing.pipeline import mesh as meshed

    set_threads(threads)
    size: dict[str, Any] = {
        "n_points": points,
        "ratio": ratio,
        "n_faces": faces,
        "tolerance": tolerance,
        "unit": unit,
        "fill_holes": fill_holes,
    }
    asked = Size.of(**size, keep=keep_points)
    check_mesh_format(output)
    io.check_distinct([output], [cloud, *([keep_points] if keep_points else [])])
    io.check_writable(output, force)
    timer = Timer(progress(quiet))
    with timer("reading"):
        files = [cloud, *([keep_points] if keep_points else [])]
        original, *others = io.read_each(files, input_format, names_of(columns))
        kept = _rows_of(original, others[0], keep_points) if keep_points else None
    check_mesh_storable(output, original, lossy)
    with naming(cloud):
        result = meshed(original, **size, keep=kept, moved=moved, invalid="drop" if drop else "error", timer=timer)
    with timer("writing"):
        lost = write_mesh(output, result.mesh, result.cloud, force, lossy=True)
    note_left_out(output, lost)
    _note_fewer(cloud, result, asked.n_points)
    if as_json:
        print_json(_record(cloud, output, len(original), result))
    elif not quiet:
        _print(cloud, output, len(original), result)


def _rows_of(original: PointCloud, kept: PointCloud, path: Path) -> NDArray[Any]:
    """Return the rows of the points of a file in the original."""
    import numpy as np

    from gppcs.spatial.kdtree import KdTree

    rows = original.finite_rows()
    usable = kept.usable("cloud of points to keep")
    if not len(rows):
        return rows  # `mesh` tells what is wrong with the cloud
    nearest, squared = KdTree.build(original.points[rows]).nearest_of(usable, 1)
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
    if (share := result.diagnostics["left_out"]) > 0.001:
        print_error(f"note: {source}: {share:.1%} of the points are on no piece of the surface that is large enough")
    if opened := int(result.diagnostics["opened"]):
        print_error(f"note: {source}: the mesh has small holes in {opened:,} places, where triangles would cut others")


def _record(source: Path, output: Path, n: int, result: MeshResult) -> dict[str, Any]:
    """Return the run as the record that `--json` prints."""
    return {
        "input": str(source),
        "output": str(output),
        "points_in": n,
        "vertices": len(result.mesh.vertices),
        "triangles": len(result.mesh.faces),
        "diagnostics": dict(result.diagnostics),
        "seconds": dict(result.seconds),
        "seconds_compiling": result.seconds.get(COMPILATION, 0.0),
        "peak_memory": peak_memory(),
        "version": __version__,
    }


def _print(source: Path, output: Path, n: int, result: MeshResult) -> None:
    """Print the run as a table."""
    from gppcs.app.console import print_table

    print_table(
        f"{source} → {output}",
        {
            "points": f"{n:,}",
            "mesh": f"{len(result.mesh.vertices):,} vertices, {len(result.mesh.faces):,} triangles",
            "shape": _shape(result.diagnostics),
            **{word: number_in_words(value) for name, word in WORDS.items() if (value := result.diagnostics.get(name))},
            "time": time_in_words(result.seconds),
        },
    )


def _shape(counts: Mapping[str, float]) -> str:
    """Return in words whether a mesh is closed, and its holes, pieces and handles."""
    holes, pieces, genus = (int(counts[name]) for name in ("borders", "pieces", "genus"))
    border = f"open at {holes:,} hole{'s' * (holes > 1)} or rim{'s' * (holes > 1)}" if holes else "closed, no holes"
    return f"{border}; {pieces:,} piece{'s' * (pieces > 1)}; genus {genus:,}"
