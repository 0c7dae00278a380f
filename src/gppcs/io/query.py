"""The class `Query`: which points of a file are read, as a box, polygons of GeoJSON and a condition say."""

import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.errors import FileFormatError, InputError, ParameterError, file_path, number, shown
from gppcs.io.format import Format, Reader

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


@dataclass(frozen=True)
class Query:
    """Which points of a file are read: those in a box and in all polygons that meet a condition."""

    lower: tuple[float, ...] = (-math.inf,) * 3
    upper: tuple[float, ...] = (math.inf,) * 3
    polygons: tuple[Polygons, ...] = ()
    only: Expression | None = None
    resolution: float | None = None  # the distance of neighbours down to which a COPC file is read

    @classmethod
    def from_options(cls, inside: Any = None, only: str | None = None, resolution: float | None = None) -> Self | None:
        """Check the arguments of `gppcs.read` with these names; None if all are None."""
        if inside is None and only is None and resolution is None:
            return None
        if resolution is not None and not 0 < number(resolution) < math.inf:
            raise ParameterError(f"expected a resolution above 0, found {shown(resolution)}")
        areas = _areas(inside)
        boxes = np.array([area for area in areas if not isinstance(area, Polygons)]).reshape(-1, 2, 3)
        return cls(
            tuple(boxes[:, 0].max(axis=0, initial=-math.inf).tolist()),
            tuple(boxes[:, 1].min(axis=0, initial=math.inf).tolist()),
            tuple(area for area in areas if isinstance(area, Polygons)),
            None if only is None else Expression.from_text(only),
            None if resolution is None else float(resolution),
        )

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points, (N, 3), are in the box, border included, and in the polygons."""
        limited = np.isfinite(self.lower) | np.isfinite(self.upper)
        inside = np.logical_and.reduce((points >= self.lower) & (points <= self.upper) | ~limited, axis=1)
        for polygons in self.polygons:
            inside &= polygons.contains(points)
        return inside

    def part(self, cloud: PointCloud) -> PointCloud:
        """Return the points of a cloud that are asked for."""
        inside = self.contains(cloud.points)
        if self.only is not None:
            inside &= self.only.mask(cloud)
        return cloud if inside.all() else cloud.take(np.flatnonzero(inside))

    def restricted(self, file_format: Format, reader: Reader) -> Reader:
        """Return a reader of a format that reads only what is asked for."""
        if self.resolution is not None and "query" not in file_format.options:
            raise FileFormatError(
                f"expected a COPC file, which alone has levels, found {file_format.name}; leave out `resolution`"
            )

        return replace(reader, chunks=lambda n: map(self.part, reader.chunks(n)), spans=lambda n: [], bounds=None)

    def nothing_found(self) -> InputError:
        """Return the error for a cloud without such points."""
        return InputError(f"expected {self.text}, found none; gppcs info shows where they lie")

    @property
    def text(self) -> str:
        """What is asked for, in words."""
        conditions = ["in the box"] if np.isfinite((*self.lower, *self.upper)).any() else []
        conditions += ["inside the polygons"] if self.polygons else []
        conditions += [f"with {self.only.text}"] if self.only else []
        return f"points {' and '.join(conditions) or 'in the file'}"


def _areas(inside: Any) -> list[Polygons | tuple[list[float], list[float]]]:
    """Return the boxes, each by two corners, and the polygons that an argument `inside` names: one or a list."""
    if inside is None:
        return []
    if isinstance(inside, str) and (not inside or ("," in inside and not Path(inside).exists())):
        return [_box(inside)]
    if isinstance(inside, str | os.PathLike):
        return [read_polygons(file_path(inside))]
    if isinstance(inside, list | tuple) and any(isinstance(part, str | os.PathLike) for part in inside):
        return [area for part in inside for area in _areas(part)]
    try:
        numbers = np.array(inside, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty(0)
    return [polygon_of(numbers)] if numbers.ndim == 2 else [_box(inside)]


def _box(inside: Any) -> tuple[list[float], list[float]]:
    """Return the lower and the upper corner, (3,), of a box, infinite where it is open."""
    limits = inside.split(",") if isinstance(inside, str) else inside
    try:
        values = [float(limit) if isinstance(limit, str) else number(limit) for limit in limits]
    except (TypeError, ValueError):  # it is no sequence, or one limit no number
        values = []
    half = len(values) // 2
    lower, upper = [*values[:half], -math.inf][:3], [*values[half:], math.inf][:3]
    if len(values) not in (4, 6) or not all(
        -math.inf < b >= a < math.inf for a, b in zip(values[:half], values[half:], strict=True)
    ):
        raise ParameterError(
            "expected `inside` to be a box xmin, ymin, xmax, ymax or xmin, ymin, zmin, xmax, ymax, zmax, with no "
            "minimum above its maximum, no minimum of inf and no maximum of -inf, or else a GeoJSON file, or the "
            f"corners of a polygon, (n, 2), found {shown(inside)}"
        )
    return lower, upper


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
