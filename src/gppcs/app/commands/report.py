"""The command `gppcs report`: a page that shows simplified clouds beside their original."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gppcs.app import options
from gppcs.app.options import option
from gppcs.app.printing import print_error, say, started

EPILOG = (
    "gppcs report scan.ply small.ply -o report.html\n\n"
    "gppcs report scan.ply gp.ply fps.ply voxel.ply -o report.html --up z --view 30,20\n\n"
    "gppcs report scan.ply small.ply -o report.html --meshes\n\n"
    "gppcs report scan.ply small.ply -o report.html --detail rgb\n\n"
    "gppcs evaluate --help defines the figures of the page."
)


def report(
    context: typer.Context,
    original: Annotated[Path, options.files("ORIGINAL", "The original cloud.")],
    simplified: Annotated[
        list[Path], options.files("SIMPLIFIED...", "Simplified clouds, best with their points in the order of choice.")
    ],
    output: Annotated[Path, options.output("HTML", "The page to write; - is standard output.")],
    meshes: Annotated[
        bool, option("Also rebuild a mesh from each cloud, to show. Needs the extra evaluate.", None, "--meshes")
    ] = False,
    detail: options.Measured = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    view: options.View = None,
    up: options.Up = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
) -> None:
    """Write a page that shows simplified clouds beside their original, to turn in the browser.

    The page is one file that needs no network. It colours the points by surface variation, by the distance of the
    original to each result, by the order of choice, by any attribute or RGB, and holds the figures of gppcs evaluate.
    """
    from gppcs import io
    from gppcs.app.outputs import check_output
    from gppcs.app.pages import SUFFIXES, how_made, read_named, rebuilt
    from gppcs.drawing.web.contents import report_page
    from gppcs.engine.extras import require_pymeshlab

    timer = started(quiet, threads, in_pipes=True)
    viewpoint = options.viewpoint_of(view, up)
    inputs = [original, *simplified]
    check_output(output, inputs, force, SUFFIXES)
    if meshes:
        require_pymeshlab()
    clouds = read_named(inputs, input_format, columns, timer)
    if meshes and all(named.cloud.is_finite().any() for named in clouds):  # the page refuses empty clouds
        finite = [named.cloud[named.cloud.is_finite()] for named in clouds]
        with timer("meshes"):
            for number, (named, cloud) in enumerate(zip(clouds, finite, strict=True)):
                if named.mesh is None:
                    clouds[number] = replace(named, mesh=rebuilt(named.name, cloud, finite[0]))
    page = report_page(clouds[0], clouds[1:], how_made(context.obj, inputs), viewpoint, timer, detail or ())
    with io.whole_output(output, force) as file:
        file.write(page.content())
    for note in page.described["notes"]:
        print_error(f"note: {note}")
    if not quiet and not io.is_standard(output):
        say(f"{output}: {output.stat().st_size / 1e6:.1f} MB; open it in a browser")
