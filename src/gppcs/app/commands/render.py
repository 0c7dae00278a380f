"""The command `gppcs render`: a picture of a cloud or a mesh."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from gppcs.app import panels
from gppcs.app.printing import Columns, Force, From, Quiet, Threads, names_of, note_left_out, print_error, say
from gppcs.app.viewpoint import Up, View, viewpoint_of
from gppcs.engine.threads import set_threads
from gppcs.errors import OutputError, ParameterError, file_path, shown

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs render scan.ply -o scan.png\n\n"
    "gppcs render scan.las -o classes.png --colour classification --up z --view 30,20\n\n"
    "gppcs render mesh.ply -o mesh.png --size 1920x1080"
)


def render(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            parser=file_path,
            help="A point cloud file. If a PLY, OBJ, OFF or STL file holds triangles, the mesh is drawn. That needs "
            "the extras view and evaluate.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="PNG", parser=file_path, help="The picture to write; - is standard output."
        ),
    ],
    colour: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What the colours show: rgb, variation (surface variation), or the name of an attribute. By default "
            "rgb if IN has colours. If not, a cloud shows surface variation, and a mesh is white.",
            rich_help_panel=panels.LOOK,
        ),
    ] = None,
    size: Annotated[
        str,
        typer.Option(
            metavar="WIDTHxHEIGHT",
            help="Size in pixels.",
            rich_help_panel=panels.LOOK,
        ),
    ] = "1280x960",
    view: View = None,
    up: Up = None,
    input_format: From = None,
    columns: Columns = None,
    threads: Threads = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Draw a picture of a cloud or a mesh. It needs no display.

    A cloud is drawn as a surface without gaps between its points. Points whose value is unknown are grey.
    """
    from gppcs import io
    from gppcs.drawing.single import checked_size, draw_single
    from gppcs.engine.extras import require_matplotlib
    from gppcs.io.files import naming
    from gppcs.io.mesh_files import mesh_of

    set_threads(threads)
    viewpoint = viewpoint_of(view, up, picture=True)
    pixels = checked_size(_numbers(size))
    if not io.is_standard(output) and output.suffix.lower() != ".png":
        raise OutputError(f"{output}: expected a name that ends in .png for the picture")
    require_matplotlib()
    io.check_distinct([output], [source])
    io.check_output(output, force)
    cloud, faces, unread = io.load(source, input_format, names_of(columns))
    mesh = mesh_of(source, input_format)
    with naming(source), io.whole_output(output, force) as file:
        drawn = draw_single(file, cloud, mesh, colour, viewpoint, pixels)
    if faces and mesh is None:
        note_left_out(output, unread)
    if drawn.left_out:
        print_error(f"note: {source}: {drawn.left_out:,} points with NaN or infinite coordinates are left out")
    if drawn.outside:
        print_error(f"note: {source}: {drawn.outside:,} points lie far from all others, outside the picture")
    if not quiet and not io.is_standard(output):
        coloured = f", coloured by {drawn.colour}" if drawn.colour else ""
        say(f"{output}: {pixels[0]} x {pixels[1]} pixels{coloured}")


def _numbers(size: str) -> tuple[int, int]:
    """Return width and height of a text such as 1280x960."""
    found = re.fullmatch(r"(\d{1,9})[xX](\d{1,9})", size.strip(), re.ASCII)
    if not found:
        raise ParameterError(f"expected --size WIDTHxHEIGHT in pixels, such as 1280x960, found {shown(size)}")
    return int(found[1]), int(found[2])
