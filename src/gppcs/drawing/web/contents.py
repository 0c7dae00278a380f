"""Makes two pages, a report and a view of any clouds: one HTML file each with viewer and data, without network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.accuracy import distances_to, errors_of
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import CLASS_NAMES
from gppcs.clouds.mesh import Mesh
from gppcs.clouds.quantities import unit_of
from gppcs.clouds.ranges import columns_of_detail
from gppcs.drawing.camera import GUESSED, Viewpoint, spread_over
from gppcs.drawing.estimates import MAX_MEASURED, thin_on_lines
from gppcs.drawing.surfaces import surface_of_few, surface_through
from gppcs.drawing.web.layers import CloudSurface, Layer, in_one_unit
from gppcs.drawing.web.layers import Named as Named
from gppcs.drawing.web.packing import Blocks
from gppcs.engine.arrays import Floats
from gppcs.engine.strict_json import strict_json
from gppcs.engine.threads import beside
from gppcs.engine.timer import Timer, timer_of
from gppcs.errors import InputError
from gppcs.evaluation.detail import attribute_errors
from gppcs.evaluation.judge import judged
from gppcs.evaluation.reconstruction import distances_to as distances_to_mesh
from gppcs.evaluation.report import DetailErrors, Report
from gppcs.spatial.scaling import bounds, normalised

FIRST_FIGURES = (  # that the page shows before somebody asks for all
    "covering_radius", "covering_p999", "surface_mean", "surface_p95", "surface_max", "feature_error", "feature_recall",
    "normal_deviation",
)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """A page of clouds: all that it says, and its arrays."""

    described: dict[str, Any]
    blocks: Blocks

    @classmethod
    def from_layers(
        cls, layers: Sequence[Layer], blocks: Blocks, viewpoint: Viewpoint, detail: Sequence[str] = (), **described: Any
    ) -> Page:
        """Return the page of some layers; its notes are theirs, and that they do not lie together."""
        up, (azimuth, elevation) = viewpoint.guessed(layers[0].cloud.points)
        notes, together = _notes_of(layers), _lie_together(layers)
        if not together:
            notes.append("The clouds lie far apart or differ much in size, so each view has a frame of its own.")
        described |= {"notes": notes, "up": up, "azimuth": azimuth, "elevation": elevation, "together": together}
        solid = any(layer.described["mesh"] for layer in layers) and not any(layer.is_noisy for layer in layers)
        described |= {"solid": solid, "classes": CLASS_NAMES}
        of_details = {
            f"{name}_{figure}": value for name in detail for figure, value in DetailErrors.definitions().items()
        }
        first = {*FIRST_FIGURES, *of_details}
        described["figures"] = [
            {"name": name, "title": name.replace("_", " "), "first": name in first, **figure._asdict()}
            for name, figure in (Report.definitions() | of_details).items()
        ]
        return cls(described | {"clouds": [layer.described for layer in layers]}, blocks)

    def content(self) -> bytes:
        """Return the page."""
        before, after = (files("gppcs.drawing.web") / "page.html").read_bytes().split(b"<!--DATA-->")
        json = strict_json(self.described)
        for character in "<>&":  # they could end the element
            json = json.replace(character, f"\\u{ord(character):04x}")
        texts = {f"block{number}": ("text/plain", text) for number, text in enumerate(self.blocks.texts)}
        elements = {"description": ("application/json", json), **texts}.items()
        scripts = [f'<script id="{name}" type="{kind}">{text}</script>\n' for name, (kind, text) in elements]
        return before + "".join(scripts).encode("ascii") + after


def report_page(
    original: Named,
    results: Sequence[Named],
    made: Sequence[tuple[str, str]],
    viewpoint: Viewpoint = GUESSED,
    timer: Timer | None = None,
    detail: Sequence[str] = (),
) -> Page:
    """Return a page of simplified clouds beside their original, with figures; also those of some attributes."""
    timer, blocks = timer_of(timer), Blocks()
    columns_of_detail(original.cloud, detail)  # an error if the original lacks one; a result that does gets a note
    unit = unit_of(original.cloud.header) or ""
    original, *results = in_one_unit([original, *results])
    # A mesh takes about as long as all else together, and hardly uses a second core. Each is begun one result ahead.
    meshes = (beside(partial(_with_surface, result, original)) for result in results)
    begun = [*islice(meshes, 1)]
    with timer("original"):
        surface = CloudSurface.from_cloud(original)
        first = Layer(blocks, original, "original", surface)
    layers = [first]
    lengths = f"in {unit or 'the unit of the coordinates'}"
    for number, result in enumerate(results, start=1):
        begun += islice(meshes, 1)
        prefixes, notes, errors = [], list[str](), {}
        with timer(f"figures of {result.name}"):
            kept, indices = _on_original(CloudSurface.from_cloud(result), surface)
            try:
                if result.is_mesh:
                    distances = _distances(surface, result)
                    prefixes = [_figures_of_mesh(surface.cloud, result, distances)]
                    notes.append("distances are those to its triangles.")
                else:
                    prefixes, of_distinct = _prefixes(surface.cloud, kept.cloud, detail)
                    distances = of_distinct[surface.same]
                errors = attribute_errors(first.cloud, kept.cloud, list(detail))
            except InputError as error:
                if not prefixes:
                    distances = _distances(surface, result)
                notes.append(f"there are no figures{' of attributes' if prefixes else ''}: {error}.")
        first.add_values(f"distance:{number}", f"distance to {result.name}", lengths, distances[first.shown], True)
        for name, (interpolated, _) in errors.items():
            title = f"error of {name} in {result.name}"
            first.add_values(f"error:{name}:{number}", title, "in shares of its range", interpolated, True)
        with timer(f"views of {result.name}"):
            layer = Layer(blocks, begun.pop(0)(), "result", kept)
            layer.described["blocks"]["originals"] = blocks.add(indices[layer.shown])
            layer.described["prefixes"] = prefixes
            layer.notes += notes
        layers.append(layer)
    sizes = " and ".join(r.size_text if r.is_mesh else f"{len(r.cloud):,}" for r in results)
    lead = f"{original.size_text} beside {sizes}"
    said = {"title": original.name, "lead": lead, "made": made, "unit": unit}
    diagonal = math.hypot(*np.subtract(*bounds(surface.cloud.points)))  # which does not overflow
    return Page.from_layers(layers, blocks, viewpoint, detail, diagonal=diagonal, **said)


def view_page(clouds: Sequence[Named], made: Sequence[tuple[str, str]], viewpoint: Viewpoint = GUESSED) -> Page:
    """Return a page of any clouds."""
    blocks, unit = Blocks(), unit_of(clouds[0].cloud.header) or ""
    clouds = in_one_unit(clouds)
    layers = []
    for named in clouds:
        surface = CloudSurface.from_cloud(named)
        layers.append(Layer(blocks, _with_surface(named), "cloud", surface))
    title = clouds[0].name if len(clouds) == 1 else f"{clouds[0].name} and {len(clouds) - 1} more"
    lead = ", ".join(named.size_text for named in clouds)
    if not any(named.is_mesh for named in clouds):
        lead = f"{sum(len(named.cloud) for named in clouds):,} points"
    if clouds[0].mesh and clouds[0].is_mesh:
        viewpoint = Viewpoint(*viewpoint.guessed(spread_over(clouds[0].mesh)))
    return Page.from_layers(layers, blocks, viewpoint, title=title, lead=lead, made=made, diagonal=0.0, unit=unit)


def _with_surface(named: Named, original: Named | None = None) -> Named:
    """Return a cloud with the surface through its points, if there is one; one that was rebuilt has its own."""
    if named.mesh or (original and original.mesh and not original.is_mesh):
        return named
    surface = surface_through(named.cloud, original.cloud) if original else surface_of_few(named.cloud)
    return replace(named, mesh=surface.mesh, noise=surface.noise) if surface else named


def _on_original(result: CloudSurface, original: CloudSurface) -> tuple[CloudSurface, NDArray[np.uint32]]:
    """Return a result with what the original tells of its points, and where these are in its file, or 2^32 - 1."""
    points = original.frame.near(result.cloud.points)
    nearest, squared = original.tree.nearest_of(points, 1)
    distinct = np.unique(original.same, return_index=True)[1][nearest[:, 0]]
    indices = np.where(squared[:, 0] == 0.0, original.indices[distinct], 2**32 - 1).astype(np.uint32)
    spacings = thin_on_lines(result.spacings, original.tree, points)
    variation, normals = original.variation[distinct], original.normals[distinct]
    return result._replace(variation=variation, normals=normals, spacings=spacings), indices


def _distances(original: CloudSurface, result: Named) -> Floats:
    """Return the distances (N,) of the original to a mesh, or to the local surface of a simplified cloud."""
    order = np.argsort(original.tree.positions()[original.same])  # neighbours follow each other, which is faster
    points, distances = original.cloud.points[order], np.empty(len(order))
    if result.is_mesh and result.mesh:
        local, frame = normalised(result.mesh.vertices)
        distances[order] = distances_to_mesh(Mesh(local, result.mesh.faces), frame.near(points))
    else:
        local, frame = normalised(result.cloud.points[result.cloud.is_finite()])
        distances[order] = distances_to(local, frame.near(points))
    return frame.lengths(distances)


def _figures_of_mesh(original: PointCloud, result: Named, distances: Floats) -> dict[str, object]:
    """Return the figures of a mesh that are told by the distances (N,) of the original points to it."""
    diagonal = math.hypot(*np.subtract(*bounds(original.points)))
    shared = {"points_in": len(original), "points_out": len(result.cloud), "diagonal": diagonal}
    figures, relative = (
        {f"surface_{measure}": error for measure, error in errors_of(distances / unit).items()}
        for unit in (1.0, diagonal or 1.0)
    )
    return {"points": len(result.cloud), "figures": shared | figures, "relative": shared | relative}


def _prefixes(original: PointCloud, result: PointCloud, detail: Sequence[str]) -> tuple[list[Any], Floats]:
    """Return the figures of parts of a result, by a sample of the original, and of all of it.

    Return also the distances of the original's distinct points to the result.
    """
    measured = []
    counts = [count for part in (8, 4, 2) if (count := len(result) // part) >= 4]
    sampled = original.take(np.arange(0, len(original), -(-len(original) // MAX_MEASURED)))
    for count in [*counts, len(result)]:
        among = sampled if count < len(result) and 4 * count <= len(sampled) else original
        report, _, distances = judged(among, result.take(np.arange(count)), None, Timer(), detail)
        measured.append({"points": count, "figures": report.figures(), "relative": report.figures(relative=True)})
    return measured, distances


def _notes_of(layers: Sequence[Layer]) -> list[str]:
    """Return what the page says of its clouds: what it says of several, once."""
    names = dict[str, list[str]]()
    for layer in layers:
        for note in layer.notes:
            names.setdefault(note, []).append(layer.name)
    return [f"{', '.join(names[note])}: {note}" for note in names]


def _lie_together(layers: Sequence[Layer]) -> bool:
    """Return whether clouds can be drawn in one frame."""
    boxes = np.array([bounds(layer.cloud.points) for layer in layers])
    with np.errstate(over="ignore"):
        sizes = np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
        joint = np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0))
    return bool(joint <= 2.0 * sizes.max() and sizes.min() >= 0.1 * sizes.max())
