"""The command `gppcs view`: point clouds in the browser."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from gppcs.app import options
from gppcs.app.printing import names_of, print_error, progress, say
from gppcs.app.viewpoint import viewpoint_of
from gppcs.engine.threads import set_threads
from gppcs.errors import file_path

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs view scan.ply\n\n"
    "gppcs view before.ply after.ply --up z\n\n"
    "gppcs view scan.ply -o scan.html --no-open"
)


def view(
    context: typer.Context,
    inputs: Annotated[
        list[Path], typer.Argument(metavar="FILE...", parser=file_path, help="Point cloud files.", show_default=False)
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="HTML",
            parser=file_path,
            help="The page to write. By default, a temporary file. With -, the page goes to standard output and is not "
            "opened.",
        ),
    ] = None,
    opened: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    input_format: options.From = None,
    columns: options.Columns = None,
    view: options.View = None,
    up: options.Up = None,
    threads: options.Threads = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
) -> None:
    """Show point clouds side by side in the browser, in views that turn together.

    Files of all formats that gppcs reads can be shown, meshes with their faces. The page is one file that needs no
    network.
    """
    from gppcs import io
    from gppcs.app.pages import check_page, different_names, how_made
    from gppcs.drawing.web.contents import Named, view_page
    from gppcs.engine.timer import Timer
    from gppcs.io.mesh_files import mesh_of

    set_threads(threads)
    viewpoint = viewpoint_of(view, up, picture=True)
    if output:
        io.check_distinct([output], inputs)
        check_page(output, force)
    timer = Timer(progress(quiet))
    with timer("reading"):
        read = io.read_each(inputs, input_format, names_of(columns))
        meshes = [mesh_of(path, input_format) for path in inputs]
    clouds = [Named(*each) for each in zip(different_names(inputs), read, meshes, strict=True)]
    page = view_page(clouds, how_made(context.obj, inputs), viewpoint)
    if output is None:
        output = Path(tempfile.mkdtemp(prefix="gppcs-")) / "view.html"
    with io.whole_output(output, force) as file:
        page.write(file)
    if io.is_standard(output):
        return
    if not quiet:
        say(str(output))
    if opened and not webbrowser.open(output.absolute().as_uri()):
        print_error(f"note: no browser was found; open {output} yourself")
