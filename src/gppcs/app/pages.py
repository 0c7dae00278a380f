"""What the commands share that show clouds: their names, surfaces rebuilt from them, pictures, how a page was made."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from gppcs import __version__, io
from gppcs.app.printing import print_error
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Viewpoint, spread_over
from gppcs.drawing.cloud_images import ColouredCloud, painted
from gppcs.drawing.colours import RGB, Colourable
from gppcs.drawing.side_by_side import Column, draw_comparison
from gppcs.drawing.surfaces import surface_through
from gppcs.drawing.web.layers import Named, in_one_unit
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError
from gppcs.evaluation.comparison import Entry, rebuilt_mesh, trimmed_mesh

SUFFIXES = (".html", ".htm")  # of pages
MOST_TO_REBUILD = 1_000_000  # points; to rebuild a mesh from a larger cloud would take minutes


def different_names(paths: Sequence[Path]) -> list[str]:
    """Return a different name for each file: its own, or its path if another file has the same name."""
    names = [path.name for path in paths]
    return [str(path) if names.count(path.name) > 1 else path.name for path in paths]


def rebuilt(name: str, cloud: PointCloud, original: PointCloud, advice: str = "") -> Mesh | None:
    """Return a surface rebuilt from a cloud, to be shown. If the cloud is too large, print a note instead."""
    if len(cloud) > MOST_TO_REBUILD:
        print_error(f"note: there is no mesh of {name}, as it has more than {MOST_TO_REBUILD:,} points{advice}")
        return None
    return rebuilt_mesh(cloud, original)


def named_clouds(entries: Sequence[Entry], finite: PointCloud, is_measured: bool, is_drawn: bool) -> list[Named]:
    """Return the clouds of a comparison, with their surfaces if these were measured or are drawn."""

    def mesh_of(entry: Entry) -> Mesh | None:
        if is_measured:
            return trimmed_mesh(entry.report.rebuilt.mesh, finite) if entry.report.rebuilt else None
        return rebuilt_mesh(entry.result.cloud, finite) if is_drawn else None

    results = [(entry.result, mesh_of(entry)) for entry in entries]
    return [Named(str(result.method), result.cloud, mesh, result.method.summary) for result, mesh in results]


def named_inputs(paths: Sequence[Path], read: Sequence[tuple[PointCloud, Mesh | None]]) -> list[Named]:
    """Return clouds and meshes that were read, by the names of their files."""
    named = zip(different_names(paths), read, strict=True)
    return [Named(name, cloud, mesh, is_mesh=mesh is not None) for name, (cloud, mesh) in named]


def draw_beside(
    file: BinaryIO,
    original: Named,
    results: Sequence[tuple[Named, str]],
    viewpoint: Viewpoint,
    colour: str | None,
) -> None:
    """Write a PNG of a finite cloud and of results with captions, in the colours of the nearest original points."""
    captions = [caption for _, caption in results]
    original, *shown = in_one_unit([original, *(named for named, _ in results)])
    everything, legend = painted(original.cloud, colour)
    columns = [Column(original.name, everything, "", original.mesh)]
    for named, caption in zip(shown, captions, strict=True):
        columns.append(Column(named.name, everything.at(named.cloud.points), caption, named.mesh))
    draw_comparison(file, columns, viewpoint, legend)


def draw_pair(
    file: BinaryIO,
    original: Named,
    simplified: Named,
    caption: str,
    viewpoint: Viewpoint,
    colour: str | None,
    timer: Timer | None = None,
) -> None:
    """Write a PNG of a finite cloud or mesh and of another beside it; of points, also the surface through them."""
    for named in (original, simplified):
        if not len(named.cloud):
            raise InputError(f"{named.name}: expected points with finite coordinates to draw, found none")
    original, simplified = in_one_unit([original, simplified])
    has_rgb = Colourable.from_cloud(original.cloud).rgb is not None
    timer = timer_of(timer)
    with timer("colours"):
        everything, legend = painted(original.cloud, colour or (RGB if has_rgb else None))

    def column(named: Named, cloud: ColouredCloud, caption: str) -> Column:
        if named.mesh is None:
            return Column(named.name, cloud, caption, None)
        return Column(named.name, everything.at(spread_over(named.mesh)), caption, named.mesh, is_mesh=True)

    columns = [column(original, everything, "")]
    columns.append(column(simplified, everything.at(simplified.cloud.points), caption))
    if original.mesh is None and simplified.mesh is None:
        with timer("surface"):
            surface = surface_through(simplified.cloud, original.cloud)
        if surface and not surface.is_noisy:
            colours = everything.at(spread_over(surface.mesh))
            columns.append(Column("surface", colours, "the surface through them", surface.mesh, is_mesh=True))
    with timer("drawing"):
        draw_comparison(file, columns, viewpoint, legend, close_ups=0)


def how_made(command: Sequence[str], inputs: Sequence[Path]) -> list[tuple[str, str]]:
    """Return how a page was made, so that anybody can make it again."""
    made = how_run(command)
    for name, path in zip(different_names(inputs), inputs, strict=True):
        if not io.is_standard(path):
            with open(path, "rb") as file:
                made.append((f"SHA-256 of {name}", hashlib.file_digest(file, "sha256").hexdigest()))
    return [*made, ("views", "Coordinates and values in 16 bits of their range, normals in 16 bits.")]


def how_run(command: Sequence[str]) -> list[tuple[str, str]]:
    """Return what has made a page."""
    return [("gppcs", __version__), ("command", shlex.join(command))]
