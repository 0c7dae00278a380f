"""The command `gppcs render`: a picture of a cloud or a mesh."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from gppcs.app import options
from gppcs.app.printing import print_error, say, started, visible
from gppcs.errors import ParameterError, shown

EPILOG = (
    "gppcs render scan.ply -o scan.png\n\n"
    "gppcs render scan.las -o classes.png --colour classification --up z --view 30,20\n\n"
    "gppcs render scan.ply small.ply -o both.png\n\n"
    "gppcs render mesh.ply -o mesh.png --size 1920x1080"
)


def render(
    sources: Annotated[
        list[Path],
        options.files("IN [SIMPLIFIED]", "A cloud or a mesh, and a simplified one to draw beside it."),
    ],
    output: Annotated[Path, options.output("PNG", "The picture to write; - is standard output.")],
    colour: options.Colour = None,
    size: Annotated[str, options.option("Size in pixels, of one cloud or mesh.", metavar="WIDTHxHEIGHT")] = "1280x960",
    view: options.View = None,
    up: options.Up = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
) -> None:
    """Draw a picture of a cloud or a mesh. It needs no display.

    A cloud is drawn as a surface without gaps between its points, or as the mesh through them if they are few; lines
    of a sparse scan are points. Points whose value is unknown are grey. Of a simplified cloud, single points are drawn
    in the colours of the original, and beside them the surface through them. By default, clouds and meshes have
    the RGB of the first; a cloud without it shows surface variation.
    """
    from gppcs import io
    from gppcs.app.outputs import check_output
    from gppcs.app.pages import draw_beside, read_named
    from gppcs.drawing.colours import RGB, Colourable
    from gppcs.drawing.single import checked_size, draw_single
    from gppcs.drawing.surfaces import surface_through
    from gppcs.drawing.web.layers import Named
    from gppcs.engine.extras import require_matplotlib
    from gppcs.io.files import naming

    timer = started(quiet, threads, in_pipes=True)
    viewpoint = options.viewpoint_of(view, up)
    pixels = checked_size(_numbers(size))
    check_output(output, sources, force, [".png"])
    require_matplotlib()
    if len(sources) > 2:
        raise ParameterError(f"expected one cloud, or two to draw beside each other, found {len(sources)}")
    clouds = read_named(sources, input_format, columns, timer)
    if len(sources) == 2:
        first, second = (
            replace(named, name=visible(named.name), cloud=named.cloud[named.cloud.is_finite()]) for named in clouds
        )
        if colour is None and Colourable.from_cloud(first.cloud).rgb is not None:
            colour = RGB
        results = [(second, "")]
        if first.mesh is None and second.mesh is None and len(first.cloud):
            results = [(second, f"{len(second.cloud) / len(first.cloud):.1%} of the points")]
            with timer("surface"):
                surface = surface_through(second.cloud, first.cloud)
            if surface and not surface.is_noisy:
                joined = Named("surface", second.cloud, surface.mesh, is_mesh=True)
                results.append((joined, "the surface through them"))
        with io.whole_output(output, force) as file:
            draw_beside(file, first, results, viewpoint, colour, timer, close_ups=0)
        if not quiet and not io.is_standard(output):
            say(f"{output}: {first.size_text} beside {second.size_text}")
        return
    (source,), (named,) = sources, clouds
    with naming(source), io.whole_output(output, force) as file, timer("drawing"):
        title, excluded, outside = draw_single(file, named.cloud, named.mesh, colour, viewpoint, pixels)
    if excluded:
        print_error(f"note: {source}: {excluded:,} points with NaN or infinite coordinates are left out")
    if outside:
        print_error(f"note: {source}: {outside:,} points lie far from all others, outside the picture")
    if not quiet and not io.is_standard(output):
        coloured = f", coloured by {title}" if title else ""
        say(f"{output}: {pixels[0]} x {pixels[1]} pixels{coloured}")


def _numbers(size: str) -> tuple[int, int]:
    """Return width and height of a text such as 1280x960."""
    numbers = re.fullmatch(r"(\d{1,9})[xX](\d{1,9})", size.strip(), re.ASCII)
    if not numbers:
        raise ParameterError(f"expected --size WIDTHxHEIGHT in pixels, such as 1280x960, found {shown(size)}")
    return int(numbers[1]), int(numbers[2])
