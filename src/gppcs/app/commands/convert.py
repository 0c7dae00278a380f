"""The command `gppcs convert`: a cloud from one format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from gppcs.app import options
from gppcs.app.printing import names_of, note_left_out, numbers_of, progress
from gppcs.errors import file_path

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs convert scan.csv scan.ply\n\n"
    "gppcs convert scan.ply scan.xyz.gz --lossy\n\n"
    "gppcs convert - - --from xyz --to ply < scan.xyz > scan.ply"
)


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            parser=file_path,
            help="A point cloud file, or a virtual point cloud (.vpc): the files that it lists become one cloud.",
            show_default=False,
        ),
    ],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", parser=file_path, help="The file to write.", show_default=False)
    ],
    input_format: options.From = None,
    output_format: options.To = None,
    ascii: options.Ascii = None,  # noqa: A002
    columns: options.Columns = None,
    box: options.Box = None,
    only: options.Only = None,
    polygon: options.Inside = None,
    resolution: options.Resolution = None,
    drop: Annotated[
        Literal["invalid"] | None, typer.Option(help="Leave out the points with NaN or infinite coordinates.")
    ] = None,
    assume_same_crs: options.AssumeSameCrs = False,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
) -> None:
    """Write a cloud in another format, with every attribute.

    For standard input or output, write - as the name. A further suffix .gz or .zst compresses the output.
    Values that the output format cannot hold are an error, which names them; with --lossy they are left out.
    """
    from gppcs import io

    progress(quiet)
    io.format_to_write(target, output_format, ascii)
    io.check_output(target, force)
    io.check_distinct([target], [source, *filter(None, [polygon])])
    part = (names_of(columns), numbers_of(box), resolution, only, polygon)
    cloud, _, unread = io.load(source, input_format, *part, assume_same_crs)
    if drop and (n := len(cloud.non_finite())):
        cloud = cloud.take(cloud.finite_rows())
        unread = [*unread, f"points with NaN or infinite coordinates ({n:,})"]
    lost = io.store(target, cloud, output_format, force, lossy, ascii)
    note_left_out(target, [*unread, *lost])
