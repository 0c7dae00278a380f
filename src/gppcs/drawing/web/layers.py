"""Prepares clouds for the page: what is drawn of each point, and what its colours can show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.colours import Colourable, kinds_of, scale_ends
from gppcs.drawing.estimates import MAX_MEASURED, disc_radii, estimates
from gppcs.drawing.surfaces import NOISY
from gppcs.drawing.web.packing import Blocks, Quantised, octahedral, packed_faces, quantised, quantised_values
from gppcs.engine.arrays import Floats, Ints
from gppcs.errors import InputError
from gppcs.simplification import simplify
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame, normalised

MOST_SHOWN = 1_000_000  # points of a cloud on the page; larger clouds are thinned by the default method
MOST_TRIANGLES = 1_000_000  # of a mesh on the page; larger ones are left out


@dataclass(frozen=True)
class Named:
    """A cloud with the name that the page gives it."""

    name: str
    cloud: PointCloud
    mesh: Mesh | None = None  # its surface, to be shown in place of its points
    reason: str | None = None  # why its points were chosen
    is_mesh: bool = False  # whether it is this mesh, and the points are the vertices
    noise: float = 0.0  # of its points, in median edges of the mesh through them

    @property
    def size_text(self) -> str:
        """The number of its points, or of its vertices and triangles."""
        if self.is_mesh and self.mesh:
            return f"{len(np.unique(self.mesh.faces)):,} vertices, {len(self.mesh.faces):,} triangles"
        return f"{len(self.cloud):,} points"


def in_one_unit(clouds: Sequence[Named]) -> list[Named]:
    """Return clouds and meshes with all axes in the unit of lengths of the first cloud."""
    factors = clouds[0].cloud.factors()
    if (factors == 1.0).all():
        return list(clouds)
    scaled = []
    for named in clouds:
        mesh = named.mesh and Mesh(named.mesh.vertices * factors, named.mesh.faces)
        scaled.append(replace(named, cloud=PointCloud(named.cloud.points * factors, named.cloud.attributes), mesh=mesh))
    return scaled


class CloudSurface(NamedTuple):
    """What a cloud tells of its surface at each of its N points with finite coordinates."""

    cloud: PointCloud  # these points
    indices: Ints  # (N,), in the file
    variation: Floats  # (N,), NaN if there are fewer than four points, which always seem flat
    normals: Floats  # (N, 3), of either sign
    tree: KdTree  # over the distinct points
    frame: Frame  # in which they are
    same: Ints  # (N,), which of these each point is
    spacings: Floats  # (N,), mean distance to the next points around; less on lines

    @classmethod
    def from_cloud(cls, named: Named, maximum: int = MAX_MEASURED) -> CloudSurface:
        """Estimate the surface of a cloud, and the spacing at so many points at most; errors name the cloud."""
        cloud, indices = named.cloud, np.flatnonzero(named.cloud.is_finite())
        try:
            if len(indices) == 0:
                raise InputError(f"expected points with finite coordinates to show, found none among {len(cloud)}")
            finite = cloud if len(indices) == len(cloud) else cloud.take(indices)
            variation, normals, tree, same, frame = estimates(finite.points)
        except InputError as error:
            raise InputError(f"{named.name}: {error}") from error
        carried = finite.normals()
        spacings = frame.lengths(disc_radii(tree, maximum) / 1.4)[same]  # the sixth neighbour is 1.4 mean spacings away
        return cls(finite, indices, variation, normals if carried is None else carried, tree, frame, same, spacings)


def spread(spacings: Floats, minimum: float) -> tuple[float, NDArray[np.uint8]]:
    """Return the usual one of some spacings (N,), and each in relation to it in 8 bits (N,)."""
    usual = float(np.median(spacings)) or minimum
    octaves = np.log2(np.clip(spacings / (usual or 1.0), 0.25, 4.0))
    return usual, np.round(128.0 + 40.0 * octaves).astype(np.uint8)


class Layer:
    """One cloud of the page: `described` is what the page needs to know of it, as JSON."""

    def __init__(self, blocks: Blocks, named: Named, role: str, surface: CloudSurface) -> None:
        self.blocks, self.name, self.notes = blocks, named.name, list[str]()
        finite, points = len(surface.indices), len(named.cloud)
        self.shown = np.arange(finite)  # (K,), the points of the surface that are drawn
        if finite > MOST_SHOWN:
            self.shown = np.sort(simplify(surface.cloud.points, n_points=MOST_SHOWN).indices)
        self.cloud = surface.cloud if len(self.shown) == finite else surface.cloud.take(self.shown)
        placed = quantised(self.cloud.points)
        spacings = surface.spacings[self.shown] * (finite / len(self.shown)) ** 0.5
        usual, spreads = spread(spacings, float(placed.step.max()) * 100)
        held = {
            "positions": blocks.add(placed.numbers),
            "normals": blocks.add(octahedral(surface.normals[self.shown])),
            "spreads": blocks.add(spreads),
        }
        if len(self.shown) < points:
            held["rows"] = blocks.add(surface.indices[self.shown].astype(np.uint32))
        self.described: dict[str, Any] = {"name": named.name, "role": role, "reason": named.reason, "spacing": usual}
        self.described["counted"] = "vertices" if named.is_mesh else "points"
        self.described |= placed.described() | {"points": points, "shown": len(self.shown), "blocks": held}
        self.described |= {"values": [], "prefixes": [], "mesh": named.mesh and self._mesh(named.mesh, named.is_mesh)}
        if finite < points:
            self.note(f"{points - finite:,} points with NaN or infinite coordinates are left out.")
        if len(self.shown) < finite:
            drawn = f"{len(self.shown):,} of {finite:,} points are drawn, chosen by the method gp"
            self.note(f"{drawn}. All figures are those of all points.")
        self.is_noisy = named.noise > NOISY
        if self.is_noisy:
            edges = f"noise is about {100 * named.noise:.0f} % of the spacing"
            self.note(f"{edges}, so the page opens with points; Surfaces shows the surface through them.")
        self._add_estimates(surface)
        self._add_attributes()

    def note(self, text: str) -> None:
        """Let the page say something of the cloud."""
        self.notes.append(text)

    def add_values(self, key: str, title: str, unit: str, values: NDArray[Any], root: bool = False) -> None:
        """Add a quantity (K,) that colours can show."""
        kinds = kinds_of(values, title)
        held = self._held(values) if kinds is None else quantised_values(np.searchsorted(kinds, values))
        first, last = scale_ends(values, root)
        described = {"key": key, "title": title, "unit": unit, "from": first, "to": last, "root": root}
        categories = None if kinds is None else [float(kind) for kind in kinds]
        described |= held.described() | {"categories": categories, "block": self.blocks.add(held.numbers)}
        self.described["values"].append(described)

    def _held(self, values: NDArray[Any]) -> Quantised:
        """Return a quantity (K,) as the page holds it."""
        return quantised_values(values)

    def _add_estimates(self, surface: CloudSurface) -> None:
        """Add what is estimated about the surface."""
        ratio = "a ratio from 0 (flat) to 1/3"
        self.add_values("variation", "surface variation", ratio, surface.variation[self.shown], root=True)

    def _add_attributes(self) -> None:
        """Add all attributes of numbers, and RGB, up to the limit of the page."""
        attributes = Colourable.from_cloud(self.cloud)
        if attributes.rgb is not None:
            self.described["blocks"]["colours"] = self.blocks.add(attributes.rgb)
        names = [name for name in attributes.columns if name not in NORMALS]
        limit = 12  # a million values take about two megabytes
        for name in names[:limit]:
            self.add_values(f"attribute:{name}", name, "as in the file", attributes.columns[name])
        if excluded := names[limit:]:
            self.note(f"left out of this page: attributes {', '.join(excluded)}.")

    def _mesh(self, mesh: Mesh, is_whole: bool) -> dict[str, Any] | None:
        """Return the surface rebuilt from the cloud or all that it is, or none if it is too large."""
        triangles = len(mesh.faces)
        if triangles > MOST_TRIANGLES:
            self.note(f"its mesh of {triangles:,} triangles is left out; the page holds at most {MOST_TRIANGLES:,}.")
            return None
        used, faces = np.unique(mesh.faces, return_inverse=True)
        placed = quantised(mesh.vertices[used])
        packed = packed_faces(faces.reshape(mesh.faces.shape))
        points, frame = normalised(self.cloud.points)
        distinct = np.flatnonzero(first_occurrences(points))
        nearest, squared = KdTree.build(points[distinct]).nearest_of(frame.near(mesh.vertices[used]), 1)
        vertex_points = distinct[nearest[:, 0]]
        # Of a mesh that joins the points, those that it misses are shown with it, unless they are but its vertices.
        joins = not is_whole and np.mean(squared == 0.0) > 0.9
        missed = np.setdiff1d(distinct, vertex_points) if joins else np.empty(0, dtype=np.int64)
        held = {"positions": self.blocks.add(placed.numbers), "faces": self.blocks.add(packed)}
        held["points"] = self.blocks.add(vertex_points.astype(np.uint32))  # whose colours the vertices have
        if len(missed):
            held["missed"] = self.blocks.add(missed.astype(np.uint32))
        counts = {"vertices": len(used), "triangles": triangles, "missed": len(missed)}
        return {**counts, **placed.described(), "blocks": held}
