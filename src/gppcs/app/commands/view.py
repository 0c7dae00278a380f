"""The command `gppcs view`: point clouds in the browser."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path

import typer

from gppcs.app import options
from gppcs.app.outputs import check_output
from gppcs.app.printing import names_of, print_error, say, started

EPILOG = "gppcs view scan.ply\n\ngppcs view before.ply after.ply --up z\n\ngppcs view scan.ply -o scan.html --no-open"


def view(
    context: typer.Context,
    inputs: list[Path] = options.file_argument("FILE...", "Point cloud files."),
    output: Path | None = options.output(
        "HTML",
        "The page to write. By default, a temporary file. With -, the page goes to standard output and is not opened.",
        default=None,
    ),
    opened: bool = options.option(None, "Open the page in the browser.", None, "--open/--no-open", default=True),
    input_format: str | None = options.FROM,
    columns: str | None = options.COLUMNS,
    view: str | None = options.VIEW,
    up: options.Axis | None = options.UP,
    threads: int | None = options.THREADS,
    force: bool = options.FORCE,
    quiet: bool = options.QUIET,
) -> None:
    """Show point clouds side by side in the browser, in views that turn together.

    Files of all formats that gppcs reads can be shown, meshes with their faces. The page is one file that needs no
    network.
    """
    from gppcs import io
    from gppcs.app.pages import SUFFIXES, different_names, how_made
    from gppcs.drawing.web.contents import Named, view_page
    from gppcs.io.mesh_files import mesh_of

    timer = started(quiet, threads)
    viewpoint = options.viewpoint_of(view, up)
    if output:
        check_output(output, inputs, force, SUFFIXES)
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
