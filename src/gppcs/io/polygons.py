"""Polygons of GeoJSON files, and which points are inside."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError, ParameterError, number

Ring: TypeAlias = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Polygons:
    """Polygons in the plane of x and y, which may overlap."""

    polygons: tuple[tuple[Ring, ...], ...]  # the rings around each and its holes; corner 0 follows the last

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 3) are in a polygon: a line from there crosses its rings an odd number of times."""
        order = np.argsort(points[:, 1])  # so that the points beside an edge follow each other
        x, y = points[order, 0], points[order, 1]
        inside = np.zeros(len(points), dtype=np.bool_)
        for rings in self.polygons:
            heights = [height for ring in rings for _, height in ring]
            part = slice(*np.searchsorted(y, [min(heights), max(heights)]))
            inside[part] |= _cross_oddly(rings, x[part], y[part])
        result = np.empty_like(inside)
        result[order] = inside
        return result


def _cross_oddly(rings: tuple[Ring, ...], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return of which points, (n,), in the order of y, a line to the right crosses rings an odd number of times."""
    result = np.zeros(len(x), dtype=np.bool_)
    for ring in rings:
        positions = np.searchsorted(y, np.array(ring)[:, 1])
        for k in np.flatnonzero(positions != np.roll(positions, -1)):
            (ax, ay), (bx, by) = ring[k], ring[(k + 1) % len(ring)]
            begin, end = sorted((positions[k], positions[(k + 1) % len(ring)]))
            if by < ay:  # from the lower end, whichever way the edge is given: two polygons may share it
                ax, ay, bx, by = bx, by, ax, ay
            with np.errstate(over="ignore", invalid="ignore"):
                result[begin:end] ^= x[begin:end] < ax + (y[begin:end] - ay) / (by - ay) * (bx - ax)
    return result


def polygon_of(corners: NDArray[np.float64]) -> Polygons:
    """Return a polygon with these corners, (n, 2)."""
    if corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise ParameterError(f"expected 3 or more finite corners of a polygon, (n, 2), found shape {corners.shape}")
    return Polygons(((tuple((x, y) for x, y in corners.tolist()),),))


def read_polygons(path: Path) -> Polygons:
    """Read the polygons of a GeoJSON file."""
    try:
        polygons = tuple(_polygons(json.loads(path.read_bytes())))
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise FileFormatError(f"{path}: expected polygons in GeoJSON, but {error}") from error
    if not polygons:
        raise FileFormatError(f"{path}: expected a polygon in GeoJSON, found none")
    return Polygons(polygons)


def _polygons(content: Any) -> Iterator[tuple[Ring, ...]]:
    """Yield the rings of each polygon in a part of GeoJSON that has some."""
    kind = content.get("type") if isinstance(content, dict) else None
    if kind in ("Polygon", "MultiPolygon"):
        coordinates = content["coordinates"]
        polygons = [coordinates] if kind == "Polygon" else coordinates
        yield from filter(None, (tuple(map(_ring, polygon)) for polygon in polygons))
    else:
        parts = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
        for part in parts:
            yield from _polygons(part)


def _ring(corners: Any) -> Ring:
    ring = tuple((number(x), number(y)) for x, y, *_ in corners)
    if len(ring) < 3 or not np.isfinite(ring).all():
        raise ValueError("a ring has no three finite corners")
    return ring
