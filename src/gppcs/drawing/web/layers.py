"""Prepares clouds for the page: what is drawn of each point, and what its colours can show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.attributes import Colourable, kinds_of
from gppcs.drawing.colours import scale_ends
from gppcs.drawing.estimates import Estimates
from gppcs.drawing.web.packing import Blocks, octahedral, packed_faces, quantised_points, quantised_values
from gppcs.errors import InputError
from gppcs.simplification import simplify
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised

MOST_SHOWN = 1_000_000  # points of a cloud on the page; larger clouds are thinned by the default method
MOST_TRIANGLES = 1_000_000  # of a mesh on the page; larger ones are left out
MOST_ATTRIBUTES = 12  # of a cloud; a million values take about two megabytes

SIXTH, SPACINGS_TO_SIXTH = 6, 1.4  # the sixth neighbour is 1.4 mean spacings away
SPREAD_PER_OCTAVE, USUAL_SPREAD, WIDEST = 40.0, 128.0, 4.0  # sizes of points in 8 bits, and the largest

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """What a cloud tells of its surface at each of its points.

    Attributes
    ----------
    cloud : PointCloud
        Its finite points.
    rows : (N,) array, int64
        The row of each point in the file.
    variation : (N,) array, float64
        Surface variation; NaN where fewer than four points lie near, which always seem flat.
    normals : (N, 3) array, float64
        Unit normals of either sign.
    tree : KdTree
        Over the distinct points, shifted and scaled as `normalised` does.
    """

    cloud: PointCloud
    rows: NDArray[np.int64]
    variation: Array
    normals: Array
    tree: KdTree

    @classmethod
    def of(cls, cloud: PointCloud) -> Surface:
        """Estimate the surface of a cloud."""
        rows = cloud.finite_rows()
        if len(rows) == 0:
            raise InputError(f"expected points with finite coordinates to show, found none among {len(cloud)}")
        finite = cloud if len(rows) == len(cloud) else cloud.take(rows)
        found, carried = Estimates.of(finite.points), finite.normals()
        return cls(finite, rows, found.variation, found.normals if carried is None else carried, found.tree)

    def spacings(self) -> Array:
        """Return the mean distance of each point to the next ones around it.

        Shapes: returns (N,).
        """
        local, _, exponent = normalised(self.cloud.points)
        neighbours = min(SIXTH + 1, self.tree.points.shape[1])
        squared = self.tree.nearest_of(local, neighbours)[1][:, -1]
        return np.ldexp(np.sqrt(squared) / SPACINGS_TO_SIXTH, exponent)

    def shown(self) -> NDArray[np.int64]:
        """Return the points to draw: all, or as many as the page holds, chosen by the default method.

        Shapes: returns (K,).
        """
        if len(self.rows) <= MOST_SHOWN:
            return np.arange(len(self.rows))
        return np.sort(simplify(self.cloud.points, n_points=MOST_SHOWN).indices)


class Layer:
    """One cloud of the page.

    Attributes
    ----------
    described : dict
        What the page needs to know, as JSON.
    shown : (K,) array, int64
        The points of the surface that are drawn.
    notes : list of str
        What the page should say of the cloud.
    """

    def __init__(self, blocks: Blocks, name: str, role: str, surface: Surface, points: int) -> None:
        self._blocks = blocks
        self.shown = surface.shown()
        self.cloud = surface.cloud if len(self.shown) == len(surface.rows) else surface.cloud.take(self.shown)
        placed = quantised_points(self.cloud.points)
        spacings = surface.spacings()[self.shown] * (len(surface.rows) / len(self.shown)) ** 0.5
        usual = float(np.median(spacings)) or float(placed.step.max()) * 100
        rows, normals = surface.rows[self.shown].astype(np.uint32), surface.normals[self.shown]
        self.described: dict[str, Any] = {
            "name": name,
            "role": role,
            "points": points,
            "shown": len(self.shown),
            "low": placed.low.tolist(),
            "step": placed.step.tolist(),
            "spacing": usual,
            "blocks": {
                "positions": blocks.add(placed.numbers),
                "normals": blocks.add(octahedral(normals)),
                "spreads": blocks.add(_spreads(spacings / usual if usual else np.ones(len(spacings)))),
            },
            "values": [],
            "prefixes": [],
            "mesh": None,
            "reason": None,
        }
        if len(rows) != points:
            self.described["blocks"]["rows"] = blocks.add(rows)
        self.notes = self._notes(len(surface.rows))

    def _notes(self, finite: int) -> list[str]:
        """Return what the page should say of points that are not drawn."""
        name, points = self.described["name"], self.described["points"]
        notes = []
        if finite < points:
            notes.append(f"{name}: {points - finite:,} points with NaN or infinite coordinates are left out.")
        if len(self.shown) < finite:
            notes.append(
                f"{name}: {len(self.shown):,} of {finite:,} points are drawn, chosen by the method gp. "
                "All figures are those of all points."
            )
        return notes

    def add_values(self, key: str, title: str, unit: str, values: NDArray[Any], root: bool = False) -> None:
        """Add a quantity that colours can show.

        Shapes: values (K,).
        """
        kinds = kinds_of(values)
        held = quantised_values(values if kinds is None else np.searchsorted(kinds, values))
        first, last = scale_ends(values, root)
        described = {
            "key": key,
            "title": title,
            "unit": unit,
            "low": held.low.item(),
            "step": held.step.item(),
            "from": first,
            "to": last,
            "root": root,
            "whole": not np.issubdtype(values.dtype, np.floating),
            "categories": None if kinds is None else [float(kind) for kind in kinds],
            "block": self._blocks.add(held.numbers),
        }
        self.described["values"].append(described)

    def add_attributes(self) -> None:
        """Add all attributes of numbers, and RGB, up to the limit of the page."""
        attributes = Colourable.of(self.cloud)
        if attributes.rgb is not None:
            self.described["blocks"]["colours"] = self._blocks.add(attributes.rgb)
        wanted = [name for name in attributes.columns if name not in NORMALS]
        for name in wanted[:MOST_ATTRIBUTES]:
            self.add_values(f"attribute:{name}", name, "as in the file", attributes.columns[name])
        if left_out := wanted[MOST_ATTRIBUTES:]:
            self.notes.append(f"{self.described['name']}: left out of this page: attributes {', '.join(left_out)}.")

    def add_mesh(self, mesh: Mesh | None) -> None:
        """Add the surface rebuilt from the cloud."""
        if mesh is None:
            return
        if len(mesh.faces) > MOST_TRIANGLES:
            self.notes.append(
                f"{self.described['name']}: its mesh of {len(mesh.faces):,} triangles is left out; the page holds at "
                f"most {MOST_TRIANGLES:,}."
            )
            return
        used, faces = np.unique(mesh.faces, return_inverse=True)
        placed = quantised_points(mesh.vertices[used])
        self.described["mesh"] = {
            "vertices": len(used),
            "triangles": len(mesh.faces),
            "low": placed.low.tolist(),
            "step": placed.step.tolist(),
            "blocks": {
                "positions": self._blocks.add(placed.numbers),
                "faces": self._blocks.add(packed_faces(faces.reshape(mesh.faces.shape))),
            },
        }


def _spreads(relative: Array) -> NDArray[np.uint8]:
    """Return the sizes of points, relative to the usual one, on a logarithmic scale of 8 bits."""
    octaves = np.log2(np.clip(relative, 1.0 / WIDEST, WIDEST))
    return np.round(USUAL_SPREAD + SPREAD_PER_OCTAVE * octaves).astype(np.uint8)
