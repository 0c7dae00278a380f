"""What the commands share that show clouds: their names, surfaces rebuilt from them, pictures, how a page was made."""

import hashlib
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from gppcs import __version__, io
from gppcs.app.outputs import read_each
from gppcs.app.printing import names_of, print_error
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Viewpoint, spread_over
from gppcs.drawing.cloud_images import painted
from gppcs.drawing.side_by_side import CLOSE_UPS, Column, draw_comparison
from gppcs.drawing.web.layers import Named, in_one_unit
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError, with_addresses
from gppcs.evaluation.comparison import Entry, rebuilt_mesh
from gppcs.io.remote import address_of

SUFFIXES = (".html", ".htm")  # of pages
MOST_TO_REBUILD = 1_000_000  # points; to rebuild a mesh from a larger cloud would take minutes


def different_names(paths: Sequence[Path]) -> list[str]:
    """Return a different name for each file: its own, or its path if another file has the same name."""
    names = [path.name for path in paths]
    return [with_addresses(str(path)) if names.count(path.name) > 1 else path.name for path in paths]


def rebuilt(name: str, cloud: PointCloud, original: PointCloud, advice: str = "") -> Mesh | None:
    """Return a surface rebuilt from a cloud, to be shown. If the cloud is too large, print a note instead."""
    if len(cloud) > MOST_TO_REBUILD:
        print_error(f"note: there is no mesh of {name}, as it has more than {MOST_TO_REBUILD:,} points{advice}")
        return None
    return rebuilt_mesh(cloud, original)


def named_clouds(entries: Sequence[Entry], finite: PointCloud, is_measured: bool, is_drawn: bool) -> list[Named]:
    """Return the clouds of a comparison, with their surfaces if these were measured or are drawn."""
    named = []
    for entry in entries:
        measured, mesh = entry.report.rebuilt, None
        if measured or (is_drawn and not is_measured):
            mesh = rebuilt_mesh(entry.result.cloud, finite, measured.mesh if measured else None)
        named.append(Named(str(entry.method), entry.result.cloud, mesh, entry.method.summary))
    return named


def read_named(paths: Sequence[Path], input_format: str | None, columns: str | None, timer: Timer) -> list[Named]:
    """Read clouds and meshes, and name them by their files."""
    with timer("reading"):
        read = read_each(paths, input_format, names_of(columns), use_faces=True)
    named = zip(different_names(paths), read, strict=True)
    return [Named(name, cloud, mesh, is_mesh=mesh is not None) for name, (cloud, mesh) in named]


def draw_beside(
    file: BinaryIO,
    original: Named,
    results: Sequence[tuple[Named, str]],
    viewpoint: Viewpoint,
    colour: str | None,
    timer: Timer | None = None,
    close_ups: int = CLOSE_UPS,
) -> None:
    """Write a PNG of a finite cloud or mesh and of results, in the colours of the nearest original points."""
    timer, captions = timer_of(timer), ["", *(caption for _, caption in results)]
    shown = in_one_unit([original, *(named for named, _ in results)])
    for named in shown:
        if not len(named.cloud):
            raise InputError(f"{named.name}: expected points with finite coordinates to draw, found none")
    with timer("colours"):
        everything, legend = painted(shown[0].cloud, colour)
        columns = []
        for named, caption in zip(shown, captions, strict=True):
            points = spread_over(named.mesh) if named.mesh and named.is_mesh else named.cloud.points
            cloud = everything if points is shown[0].cloud.points else everything.at(points)
            columns.append(Column(named, cloud, caption))
    with timer("drawing"):
        draw_comparison(file, columns, viewpoint, legend, close_ups)


def how_made(command: Sequence[str], inputs: Sequence[Path]) -> list[tuple[str, str]]:
    """Return how a page was made, so that anybody can make it again."""
    made = how_run(command)
    for name, path in zip(different_names(inputs), inputs, strict=True):
        if not (io.is_standard(path) or address_of(path)):
            with open(path, "rb") as file:
                made.append((f"SHA-256 of {name}", hashlib.file_digest(file, "sha256").hexdigest()))
    return [*made, ("views", "Coordinates and values in 16 bits of their range, normals in 16 bits.")]


def how_run(command: Sequence[str]) -> list[tuple[str, str]]:
    """Return what has made a page."""
    return [("gppcs", __version__), ("command", shlex.join(command))]
