"""Polygons of GeoJSON files, and which points are inside."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError, ParameterError, number

Ring: TypeAlias = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Polygons:
    """Polygons in the plane of x and y, given by closed lines around areas and around their holes."""

    rings: tuple[Ring, ...]  # the corners (x, y) of each line; the first follows the last

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 3) are inside: a line from there crosses the rings an odd number of times."""
        order = np.argsort(points[:, 1])  # so that the points beside an edge follow each other
        x, y = points[order, 0], points[order, 1]
        inside = np.zeros(len(points), dtype=np.bool_)
        for ring in self.rings:
            positions = np.searchsorted(y, np.array(ring)[:, 1])
            for k in np.flatnonzero(positions != np.roll(positions, -1)):
                (ax, ay), (bx, by) = ring[k], ring[(k + 1) % len(ring)]
                begin, end = sorted((positions[k], positions[(k + 1) % len(ring)]))
                if by < ay:  # from the lower end, whichever way the edge is given: two polygons may share it
                    ax, ay, bx, by = bx, by, ax, ay
                with np.errstate(over="ignore", invalid="ignore"):
                    inside[begin:end] ^= x[begin:end] < ax + (y[begin:end] - ay) / (by - ay) * (bx - ax)
        result = np.empty_like(inside)
        result[order] = inside
        return result


def polygon_of(corners: NDArray[np.float64]) -> Polygons:
    """Return a polygon with these corners, (n, 2)."""
    if corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise ParameterError(f"expected 3 or more finite corners of a polygon, (n, 2), found shape {corners.shape}")
    return Polygons((tuple((x, y) for x, y in corners.tolist()),))


def read_polygons(path: Path) -> Polygons:
    """Read the polygons of a GeoJSON file."""
    try:
        rings = tuple(_rings(json.loads(path.read_bytes())))
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise FileFormatError(f"{path}: expected polygons in GeoJSON, but {error}") from error
    if not rings:
        raise FileFormatError(f"{path}: expected a polygon in GeoJSON, found none")
    return Polygons(rings)


def _rings(content: Any) -> Iterator[Ring]:
    """Yield the rings of all polygons in a part of GeoJSON."""
    kind = content.get("type") if isinstance(content, dict) else None
    if kind in ("Polygon", "MultiPolygon"):
        coordinates = content["coordinates"]
        for ring in coordinates if kind == "Polygon" else chain.from_iterable(coordinates):
            corners = tuple((number(x), number(y)) for x, y, *_ in ring)
            if len(corners) < 3 or not np.isfinite(corners).all():
                raise ValueError("a ring has no three finite corners")
            yield corners
    else:
        parts = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
        for part in parts:
            yield from _rings(part)
