"""The command `gppcs view`: point clouds in the browser."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from gppcs.app import options
from gppcs.app.printing import print_error, say, started

if TYPE_CHECKING:
    from gppcs.drawing.web.serving import LevelsServer

EPILOG = "gppcs view scan.ply\n\ngppcs view before.ply after.ply --up z\n\ngppcs view scan.ply -o scan.html --no-open"


def view(
    context: typer.Context,
    inputs: Annotated[list[Path], options.files("FILE...", "Point cloud files.")],
    output: Annotated[
        Path | None, options.output("HTML", "The page to write, - for standard output; by default a temporary file.")
    ] = None,
    opened: Annotated[bool, options.option("Open the page in the browser.", None, "--open/--no-open")] = True,
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
    network. A single COPC file of more than a million points is shown by level, unless --output is given: the page is
    at an address of this machine, and asks for the points that are looked at until Ctrl-C ends the command.
    """
    from gppcs import io
    from gppcs.app.outputs import check_output
    from gppcs.app.pages import SUFFIXES, how_made, how_run, read_named
    from gppcs.drawing.show import new_page
    from gppcs.drawing.web.contents import view_page
    from gppcs.drawing.web.layers import MOST_SHOWN
    from gppcs.drawing.web.levels import Levels
    from gppcs.drawing.web.serving import LevelsServer
    from gppcs.io.copc import nodes_of
    from gppcs.io.files import naming

    timer = started(quiet, threads)
    viewpoint = options.viewpoint_of(view, up)
    if output:
        check_output(output, inputs, force, SUFFIXES)
    if output is None and input_format is None and len(inputs) == 1:
        with naming(inputs[0]), nodes_of(inputs[0], more_than=MOST_SHOWN) as nodes:
            if nodes:
                with timer("first levels"):
                    levels = Levels(nodes, inputs[0].name, how_run(context.obj), viewpoint)
                _serve(LevelsServer(levels), opened, quiet)
                return
    clouds = read_named(inputs, input_format, columns, timer)
    page = view_page(clouds, how_made(context.obj, inputs), viewpoint)
    if output is None:
        output = new_page()
    with io.whole_output(output, force) as file:
        file.write(page.content())
    is_file = not io.is_standard(output)
    if is_file and not quiet:
        say(str(output))
    if is_file and opened:
        _open(output.absolute().as_uri(), str(output))


def _open(address: str, name: str) -> None:
    """Open a page in the browser, or print where it is."""
    if not webbrowser.open(address):
        print_error(f"note: no browser was found; open {name} yourself")


def _serve(server: LevelsServer, opened: bool, quiet: bool) -> None:
    """Answer the browser until Ctrl-C."""
    if not (quiet and opened):
        say(server.url)
    if not quiet:
        print_error("note: the page asks for points as they are looked at, until Ctrl-C ends this command")
    with server, tempfile.TemporaryDirectory(prefix="gppcs-") as folder:
        if opened:
            # All users see the command line of the browser, but not the address on a page that only this user can read.
            page = Path(folder) / "view.html"
            page.touch(mode=0o600)
            page.write_text(f'<meta http-equiv="refresh" content="0; url={server.url}">')
            # In a thread, as a browser in this terminal comes back only when it is closed.
            Thread(target=_open, args=(page.as_uri(), server.url), daemon=True).start()
        server.serve_forever()
