"""The command `gppcs mesh`: a cloud to a light mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import gppcs
from gppcs.app import options, printing
from gppcs.app.options import SIZE, option
from gppcs.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud

EPILOG = (
    "gppcs mesh scan.ply -o small.ply --points 5k\n\n"
    "gppcs mesh scan.ply -o small.glb --faces 20k --moved\n\n"
    "gppcs mesh scan.ply -o web.glb --faces 5k --texture --texture-size 2048\n\n"
    "gppcs mesh scan.ply -o best.ply --points 2k --effort 2\n\n"
    "gppcs mesh scan.ply -o small.stl --tolerance 0.5 --fill-holes 20 --lossy\n\n"
    "gppcs simplify scan.ply -o kept.ply --ratio 5% && gppcs mesh scan.ply -o small.ply --keep-points kept.ply\n\n"
    "gppcs evaluate scan.ply --simplified-mesh small.ply measures how good a mesh is."
)


def mesh(
    cloud: options.Cloud,
    output: Annotated[Path, options.output("OUT", "The mesh file to write: .ply, .obj, .stl, .off or .glb (glTF).")],
    points: options.Points = None,
    ratio: options.Ratio = None,
    faces: Annotated[str | None, option("Largest number of triangles, not of --points.", SIZE, metavar="F")] = None,
    tolerance: Annotated[
        str | None,
        option("Largest distance to the points, outliers aside, or mean one: 0.5mm:mean.", SIZE, metavar="LENGTH"),
    ] = None,
    keep_points: Annotated[
        Path | None, option("A file of points of IN, such as of gppcs simplify: the vertices.", SIZE, metavar="FILE")
    ] = None,
    moved: Annotated[
        bool | None,
        option(
            "Let vertices leave the points, to fit these better. On noisy clouds, they do.", None, "--moved/--no-moved"
        ),
    ] = None,
    effort: Annotated[int, option("0, 1 or 2: more time for a better mesh of moved vertices.", metavar="E")] = 0,
    unit: options.Unit = None,
    fill_holes: Annotated[
        str | None, option("Also close holes whose boundary loops have boxes of this diagonal.", metavar="LENGTH")
    ] = None,
    texture: Annotated[
        bool, option("Write all points' colours as a texture, to .glb. Needs the extra texture.", None, "--texture")
    ] = False,
    texture_size: Annotated[int, option("Width and height of the texture in pixels.", metavar="PIXELS")] = 1024,
    input_format: options.From = None,
    columns: options.Columns = None,
    invalid: options.Invalid = "error",
    threads: options.Threads = None,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Make a light mesh straight from a dense cloud.

    Give one of --points, --ratio, --faces, --tolerance and --keep-points. The vertices are points of the cloud, with
    all their attributes; on noisy clouds, and with --tolerance, --moved and --effort, they leave the points. Where the
    points leave holes, the mesh is open. Lengths are in the unit of the coordinates (0.5), in another one (0.5mm), or
    relative to the diagonal (0.2%).
    """
    from gppcs.app.outputs import check_output, read_each
    from gppcs.clouds.quantities import unit_of
    from gppcs.drawing.textures import bake_texture, checked_texture_size, require_colours
    from gppcs.io.files import naming
    from gppcs.io.mesh_files import fit_vertices, mesh_format_of, write_mesh
    from gppcs.meshing.arguments import Size

    timer = printing.started(quiet, threads)
    size: dict[str, Any] = {"n_points": points, "ratio": ratio, "n_faces": faces, "tolerance": tolerance}
    size |= {"unit": unit, "fill_holes": fill_holes}
    task = Size.from_arguments(**size, keep=keep_points)
    mesh_format_of(output, texture)
    if texture:
        checked_texture_size(texture_size)
    files = [cloud, *filter(None, [keep_points])]
    check_output(output, files, force)
    with timer("reading"):
        original, *selected = (read for read, _ in read_each(files, input_format, printing.names_of(columns)))
        kept = _indices_of(original, selected[0], keep_points) if keep_points else None
    fit_vertices(original, output, lossy)
    with naming(cloud):
        if texture:
            require_colours(original)
        result = gppcs.mesh(original, **size, keep=kept, moved=moved, effort=effort, invalid=invalid, timer=timer)
    baked = None
    if texture:
        with timer("texture"):
            baked = bake_texture(result.mesh, original, texture_size)
    with timer("writing"):
        dropped = write_mesh(output, result.mesh, result.cloud, force, lossy=True, texture=baked, unit=unit)
    printing.note_left_out(output, dropped)
    printing.note_units(cloud, original, unit)
    for note in _notes(result, original, task.n_points, bool(moved or effort)):
        printing.print_error(f"note: {cloud}: {note}")
    diagnostics = {name: value for name, value in asdict(result.diagnostics).items() if value is not None}
    record = {
        "input": str(cloud),
        "output": str(output),
        "points_in": len(original),
        "vertices": len(result.mesh.vertices),
        "triangles": len(result.mesh.faces),
        **printing.record_of_run(diagnostics, timer.seconds),
    }
    table = {name: record[name] for name in ("points_in", "vertices", "triangles")}
    table |= {name: value for name, value in diagnostics.items() if value}
    if excluded := table.pop("excluded", 0.0):
        table["points not covered by the mesh"] = f"{100 * excluded:.3g} %"
    table["unit"] = printing.unit_text(unit_of(original.header, unit))
    table["time"] = printing.time_in_words(timer.seconds)
    printing.emit(record, as_json, quiet, f"{cloud} → {output}", table)


def _indices_of(original: PointCloud, kept: PointCloud, path: Path) -> NDArray[Any]:
    """Return the indices of the points of a file in the original."""
    import numpy as np

    from gppcs.clouds.cloud import usable
    from gppcs.spatial.kdtree import KdTree

    finite, points = np.flatnonzero(original.is_finite()), usable(kept, "cloud of points to keep")
    if not len(finite):
        return finite  # `mesh` says what is wrong with the cloud
    nearest, squared = KdTree.build(original.points[finite]).nearest_of(points, 1)
    if len(strange := np.flatnonzero(squared[:, 0] > 0)):
        first = f"found {len(strange)} that are none, the first at index {strange[0]}"
        raise InputError(
            f"{path}: expected points of the cloud, {first}; methods that move points, such as wlop, give none"
        )
    return finite[nearest[:, 0]]


def _notes(result: gppcs.MeshResult, original: PointCloud, n_points: int | None, must_move: bool) -> Iterator[str]:
    """Yield what the mesh lacks, what its tolerance does not hold for, and what became of the noise of the points."""
    import numpy as np

    diagnostics, made = result.diagnostics, len(result.indices)
    noise, tolerance = diagnostics.noise, diagnostics.tolerance
    if n_points is not None and made < n_points:
        yield f"the mesh has {made:,} vertices, fewer than the {n_points:,} asked for"
    if diagnostics.missing:
        yield f"{diagnostics.missing:,} of the points to keep are on no piece of the surface"
    if diagnostics.added:
        yield f"{diagnostics.added:,} vertices are no points to keep, as holes, handles and small pieces need them"
    if diagnostics.excluded > 0.001 and tolerance is None:
        yield f"{diagnostics.excluded:.1%} of the points are not covered by the mesh: their pieces are too small"
    if diagnostics.area_ratio < 0.9 or diagnostics.off_sheet > 0.05:
        area = f"the mesh has {diagnostics.area_ratio:.0%} of the area of the cloud"
        yield f"{area}, and {diagnostics.off_sheet:.1%} of the points are off it or on another sheet"
    if diagnostics.open_holes:
        yield f"the mesh has small holes ({diagnostics.open_holes:,}) where triangles would cut others"
    if diagnostics.outliers or diagnostics.off_surface:
        misses = f"{diagnostics.outliers:,} outliers, and {diagnostics.off_surface:,} that the full mesh misses, too"
        yield f"points that the tolerance does not cover: {misses}; see gppcs evaluate IN --simplified-mesh OUT"
    if diagnostics.joined_sheets:
        near = f"two sheets, such as those of a plate, are about {diagnostics.joined_sheets:.3g} apart"
        yield f"{near}, nearer than the points, and became one; scan with more points to keep both"
    elif tolerance is None and noise and not must_move:
        noisy = f"the points have noise of about {noise:.4g}"
        if np.array_equal(result.mesh.vertices, original.points[result.indices]):
            yield f"{noisy}, and so has their mesh; --moved removes it"
        else:
            yield f"{noisy}, so vertices left them; --no-moved keeps vertices at points"
    if tolerance is not None and noise > tolerance:
        below = f"the tolerance of {tolerance:.3g} is below the noise of the points, {noise:.3g}"
        yield f"{below}, which the mesh follows; give a larger tolerance, or --points M with --moved"
