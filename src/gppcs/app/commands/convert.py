"""The command `gppcs convert`: a cloud from one format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from gppcs.app import options
from gppcs.app.options import option
from gppcs.app.printing import names_of, note_left_out, started
from gppcs.errors import ParameterError

EPILOG = (
    "gppcs convert scan.csv scan.ply\n\n"
    "gppcs convert scan.ply scan.xyz.gz --lossy\n\n"
    "gppcs convert scan.laz scan.copc.laz\n\n"
    "gppcs convert - - --from xyz --to ply < scan.xyz > scan.ply"
)


def convert(
    source: Annotated[Path, options.files("IN", "A point cloud file, or the list of one in several files (.vpc).")],
    target: Annotated[Path, options.files("OUT", "The file to write.")],
    input_format: options.From = None,
    output_format: options.To = None,
    ascii: options.Ascii = None,  # noqa: A002
    columns: options.Columns = None,
    inside: options.Inside = None,
    only: options.Only = None,
    resolution: options.Resolution = None,
    levels_by: Annotated[
        Literal["order", "random"] | None,
        option("Points on the coarse levels of a .copc.laz file: the first ones, as by default, or random ones."),
    ] = None,
    invalid: options.Invalid = "error",
    assume_same_crs: Annotated[
        bool, option("Give all files of one cloud the coordinate system of the first file.", None, "--assume-same-crs")
    ] = False,
    memory: options.Memory = None,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
) -> None:
    """Write a cloud in another format, with every attribute.

    For standard input or output, write - as the name. A further suffix .gz compresses the output.
    Values that the output format cannot hold are an error, which names them; with --lossy they are left out.
    """
    from gppcs import io
    from gppcs.app.outputs import check_output
    from gppcs.clouds.quantities import bytes_of
    from gppcs.streaming.copc import write_beyond_memory

    timer = started(quiet)
    chosen = io.format_to_write(target, output_format, ascii, levels_by)
    has_levels = "levels_by" in chosen.options
    if memory and not has_levels:
        raise ParameterError("expected --memory with a name that ends in .copc.laz, found another")
    check_output(target, [source, *options.files_of_inside(inside)], force)
    part = (input_format, names_of(columns), inside or None, only, resolution, assume_same_crs)
    with io.CloudFiles([source], *part) as clouds:
        if has_levels and not io.is_standard(source):
            limit = None if memory is None else bytes_of(memory)
            dropped = write_beyond_memory(target, clouds, levels_by, invalid == "drop", limit, timer, force, lossy)
            if dropped is not None:
                note_left_out(target, dropped)
                return
        with timer("reading"):
            cloud, unread = clouds.read(), clouds.skipped()
    if invalid == "drop" and (n := int((~cloud.is_finite()).sum())):
        cloud = cloud[cloud.is_finite()]
        unread = [*unread, f"points with NaN or infinite coordinates ({n:,})"]
    with timer("levels and writing" if has_levels else "writing"):
        dropped = io.store(target, cloud, chosen, force, lossy)
    note_left_out(target, [*unread, *dropped])
