"""The command `gppcs convert`: a cloud from one format to another."""

from pathlib import Path
from typing import Annotated, Literal

from gppcs.app import options
from gppcs.app.options import option
from gppcs.app.printing import names_of, note_left_out, say, started
from gppcs.errors import ParameterError

EPILOG = (
    "gppcs convert scan.csv scan.ply\n\n"
    "gppcs convert scan.ply scan.xyz.gz --lossy\n\n"
    "gppcs convert scan.laz scan.copc.laz\n\n"
    "gppcs convert tiles whole.laz\n\n"
    "gppcs convert - - --from xyz --to ply < scan.xyz > scan.ply"
)


def convert(
    inputs: Annotated[list[Path], options.files("IN...", f"{options.FILES} Several files become one cloud.")],
    target: Annotated[Path, options.files("OUT", "The file to write.")],
    input_format: options.From = None,
    output_format: options.To = None,
    ascii: options.Ascii = None,  # noqa: A002
    columns: options.Columns = None,
    inside: options.Inside = None,
    only: options.Only = None,
    resolution: options.Resolution = None,
    levels_by: Annotated[
        Literal["order", "even"] | None,
        option(
            "Points on the coarse levels of a .copc.laz file: the first ones, or evenly spread ones. By default even, "
            "but by the attribute rank if the points have one."
        ),
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
    """Write one cloud of one file or several in another format, with every attribute.

    For standard input or output, write - as the name. A further suffix .gz compresses the output.
    Values that the output format cannot hold are an error, which names them; with --lossy they are left out.
    """
    import numpy as np

    from gppcs import io
    from gppcs.app.outputs import check_output, note_empty, note_unused, sources_of
    from gppcs.clouds.quantities import bytes_of
    from gppcs.streaming.copc import write_beyond_memory

    timer = started(quiet)
    chosen = io.format_to_write(target, output_format, ascii, levels_by)
    has_levels = "levels_by" in chosen.options
    if memory and not has_levels:
        raise ParameterError("expected --memory with a name that ends in .copc.laz, found another")
    sources = sources_of(inputs)
    source = f"{sources[0]} and {len(sources) - 1} more" if len(sources) > 1 else str(sources[0])
    check_output(target, [*inputs, *sources, *options.files_of_inside(inside)], force)
    part = (input_format, names_of(columns), inside or None, only, resolution, assume_same_crs)
    with io.CloudFiles(sources, *part) as clouds:
        written = None
        if has_levels and not clouds.reads_standard_input:
            limit = None if memory is None else bytes_of(memory)
            written = write_beyond_memory(target, clouds, levels_by, invalid == "drop", limit, timer, force, lossy)
        if written is None:
            with timer("reading"):
                cloud = clouds.read()
            is_usable = cloud.is_finite() if invalid == "drop" else np.ones(len(cloud), np.bool_)
            n_invalid = int((~is_usable).sum())
            with timer("levels and writing" if has_levels else "writing"):
                dropped = io.store(target, cloud[is_usable] if n_invalid else cloud, chosen, force, lossy)
            unusable = [f"points with NaN or infinite coordinates ({n_invalid:,})"] if n_invalid else []
            written = len(cloud) - n_invalid, [*unusable, *dropped]
        note_unused(source, clouds)
        note_empty(source, clouds, written[0])
    note_left_out(target, written[1])
    if not (quiet or io.is_standard(target)):
        say(f"{source} → {target}: {written[0]:,} points")
