"""Makes the two pages: a report of simplified clouds beside their original, and a view of any clouds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.quantities import unit_of
from gppcs.drawing.viewpoint import GUESSED, Viewpoint
from gppcs.drawing.web.layers import Layer, Surface
from gppcs.drawing.web.packing import Blocks
from gppcs.drawing.web.page import Page
from gppcs.engine.stages import Stages
from gppcs.errors import InputError
from gppcs.evaluation.judge import evaluate
from gppcs.evaluation.report import Report
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import normalised
from gppcs.surface.local_surface import LocalSurface

PARTS = 8, 4, 2, 1  # a result is also measured after the first eighth of its points, and so on
LEAST = 4  # points of a part that is measured
VARIATION = "surface variation", "a ratio from 0 (flat) to 1/3"
MOVED = 2**32 - 1  # stands for the row of the original of a point that is at none of its places

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Named:
    """A cloud with the name that the page gives it."""

    name: str
    cloud: PointCloud
    mesh: Mesh | None = None
    reason: str | None = None


def report_page(
    original: Named,
    results: Sequence[Named],
    made: Sequence[tuple[str, str]],
    viewpoint: Viewpoint = GUESSED,
    stages: Stages | None = None,
) -> Page:
    """Return a page of simplified clouds beside their original, with figures."""
    stages, blocks, notes = Stages.of(stages), Blocks(), []
    with stages("original"):
        surface = _surface(original)
        first = Layer(blocks, original.name, "original", surface, len(original.cloud))
        first.add_values("variation", *VARIATION, surface.variation[first.shown], root=True)
        first.add_attributes()
        first.add_mesh(original.mesh)
    layers = [first]
    lengths = unit_of(original.cloud.header) or "the unit of the coordinates"
    for number, result in enumerate(results, start=1):
        with stages(f"views of {result.name}"):
            layer, kept = _result(blocks, result, surface)
            distances = _distances(first.cloud.points, kept.cloud.points)
        layers.append(layer)
        try:
            with stages(f"figures of {result.name}"):
                layer.described["prefixes"] = _prefixes(surface.cloud, kept.cloud)
        except InputError as error:
            notes.append(f"{result.name}: there are no figures: {error}.")
        first.add_values(f"distance:{number}", f"distance to {result.name}", f"in {lengths}", distances, True)
    low, high = surface.cloud.points.min(axis=0), surface.cloud.points.max(axis=0)
    lead = f"{len(original.cloud):,} points beside {_counted(results)}"
    diagonal = math.hypot(*(high - low))  # which does not overflow
    return Page(original.name, lead, layers, blocks, viewpoint, made, notes, diagonal, lengths)


def view_page(clouds: Sequence[Named], made: Sequence[tuple[str, str]], viewpoint: Viewpoint = GUESSED) -> Page:
    """Return a page of any clouds."""
    blocks, layers = Blocks(), []
    for each in clouds:
        surface = _surface(each)
        layer = Layer(blocks, each.name, "cloud", surface, len(each.cloud))
        layer.add_values("variation", *VARIATION, surface.variation[layer.shown], root=True)
        layer.add_attributes()
        layer.add_mesh(each.mesh)
        layers.append(layer)
    points = sum(len(each.cloud) for each in clouds)
    title = clouds[0].name if len(clouds) == 1 else f"{clouds[0].name} and {len(clouds) - 1} more"
    return Page(title, f"{points:,} points", layers, blocks, viewpoint, made)


def _surface(named: Named) -> Surface:
    """Return the surface of a cloud; errors name the cloud."""
    try:
        return Surface.of(named.cloud)
    except InputError as error:
        raise InputError(f"{named.name}: {error}") from error


def _result(blocks: Blocks, result: Named, original: Surface) -> tuple[Layer, Surface]:
    """Return the layer of a result, with surface variation and normals of the original, and its finite points."""
    own = _surface(result)
    _, corner, exponent = normalised(original.cloud.points)
    nearest, squared = original.tree.nearest_of(np.ldexp(own.cloud.points - corner, -exponent), 1)
    distinct = np.flatnonzero(first_occurrences(original.cloud.points))[nearest[:, 0]]
    kept = Surface(own.cloud, own.rows, original.variation[distinct], original.normals[distinct], own.tree)
    layer = Layer(blocks, result.name, "result", kept, len(result.cloud))
    layer.add_values("variation", *VARIATION, kept.variation[layer.shown], root=True)
    layer.add_attributes()
    layer.add_mesh(result.mesh)
    layer.described["reason"] = result.reason
    rows = np.where(squared[:, 0] == 0.0, original.rows[distinct], MOVED)
    layer.described["blocks"]["originals"] = blocks.add(rows[layer.shown].astype(np.uint32))
    return layer, kept


def _distances(points: Array, simplified: Array) -> Array:
    """Return the distances (N,) of points (N, 3) to the local surface of a simplified cloud (M, 3)."""
    local, corner, exponent = normalised(simplified)
    surface = LocalSurface.of(local[first_occurrences(local)])
    distances, _ = surface.nearest_to(np.ldexp(points - corner, -exponent))
    return np.ldexp(distances, exponent)


def _prefixes(original: PointCloud, result: PointCloud) -> list[dict[str, object]]:
    """Return the figures of a result after some numbers of its first points."""
    counts = sorted({len(result), *(count for part in PARTS if (count := len(result) // part) >= LEAST)})
    measured = []
    for count in counts:
        report: Report = evaluate(original, result.take(np.arange(count)))
        measured.append({"points": count, "figures": report.figures(), "relative": report.figures(relative=True)})
    return measured


def _counted(results: Sequence[Named]) -> str:
    """Return in words how many results there are, of how many points."""
    if len(results) == 1:
        return f"a result of {len(results[0].cloud):,}"
    counts = {len(result.cloud) for result in results}
    sizes = f"{min(counts):,}" if len(counts) == 1 else f"{min(counts):,} to {max(counts):,}"
    return f"{len(results)} results of {sizes}"
