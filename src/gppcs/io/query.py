"""The class `Query`: which part of a file is read."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.errors import FileFormatError, InputError, ParameterError, file_path, number, shown
from gppcs.io.format import Format, Reader
from gppcs.io.polygons import Polygons, read_polygons


@dataclass(frozen=True)
class Query:
    """Which points of a file are read."""

    low: tuple[float, ...]  # with `high` the corners of a box, infinite if there is none
    high: tuple[float, ...]
    resolution: float | None  # the distance of neighbours up to which a COPC file is read
    only: Expression | None = None
    polygons: Polygons | None = None

    @classmethod
    def of(
        cls,
        box: Sequence[float] | None,
        resolution: float | None,
        only: str | None = None,
        polygon: str | os.PathLike[str] | None = None,
    ) -> Query | None:
        """Check the arguments of `gppcs.read` with these names."""
        if box is None and resolution is None and only is None and polygon is None:
            return None
        if resolution is not None and not 0 < number(resolution) < math.inf:
            raise ParameterError(f"expected a resolution above 0, found {shown(resolution)}")
        try:
            limits = [] if box is None else [number(value) for value in box]
        except TypeError:  # it is no sequence
            limits = []
        low, high = limits[: len(limits) // 2], limits[len(limits) // 2 :]
        if box is not None and not (
            len(limits) in (4, 6)
            and all(-math.inf < most >= least < math.inf for least, most in zip(low, high, strict=True))
        ):
            raise ParameterError(
                "expected a box xmin, ymin, xmax, ymax or xmin, ymin, zmin, xmax, ymax, zmax, with no minimum above "
                f"its maximum, no minimum of inf and no maximum of -inf, found {shown(box)}"
            )
        fill = 3 - len(low)
        return cls(
            (*low, *[-math.inf] * fill),
            (*high, *[math.inf] * fill),
            None if resolution is None else float(resolution),
            None if only is None else Expression.from_text(only),
            None if polygon is None else read_polygons(polygon),
        )

    @property
    def wanted(self) -> str:
        """Which points are wanted, in words."""
        boxed = bool(np.isfinite((*self.low, *self.high)).any())
        parts = (
            (boxed, "in the box"),
            (self.polygons is not None, "inside the polygons"),
            (self.only is not None, f"with {self.only.text if self.only else ''}"),
        )
        return " and ".join(words for known, words in parts if known) or "in the box"

    def nothing_found(self) -> InputError:
        """Return the error for a cloud without such points."""
        return InputError(f"expected points {self.wanted}, found none; gppcs info shows where they lie")

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 3) are in the box and in the polygons; those on the border of the box are."""
        limited = np.isfinite(self.low) | np.isfinite(self.high)
        inside = np.logical_and.reduce((points >= self.low) & (points <= self.high) | ~limited, axis=1)
        return inside if self.polygons is None else inside & self.polygons.holds(points)

    def part(self, cloud: PointCloud) -> PointCloud:
        """Return the points of a cloud that are wanted."""
        inside = self.holds(cloud.points)
        if self.only is not None:
            inside &= self.only.mask(cloud)
        return cloud if inside.all() else cloud.take(np.flatnonzero(inside))


def box_and_polygon(inside: Any) -> tuple[list[float] | None, Path | None]:
    """Return the limits of a box and the file of polygons that an argument `inside` names: one of them, or both.

    A text with commas that names no file is a box.
    """
    if inside is None:
        return None, None
    is_list = isinstance(inside, list | tuple) and any(isinstance(part, str | os.PathLike) for part in inside)
    parts = inside if is_list else [inside]
    boxes: list[Any] = []
    files: list[Path] = []
    for part in parts:
        if isinstance(part, str) and "," in part and not Path(part).exists():
            boxes.append([_as_number(limit) for limit in part.split(",")])
        elif isinstance(part, str | os.PathLike) and part != "":
            files.append(file_path(part))
        else:
            boxes.append(part)
    if len(boxes) > 1 or len(files) > 1:
        raise ParameterError("expected inside with at most one box and one file, found two of a kind")
    return boxes[0] if boxes else None, files[0] if files else None


def _as_number(text: str) -> Any:
    """Return the number that a text means, or the text itself."""
    try:
        return float(text)
    except ValueError:
        return text


def restricted(known: Format, file: BufferedReader, columns: Sequence[str] | None, query: Query | None) -> Reader:
    """Open a file to read only what a query asks for, and a table with names of its columns."""
    if columns is not None and "columns" not in known.options:
        raise FileFormatError(f"expected a text table, whose columns can be named, found {known.name}")
    options: dict[str, Any] = {} if columns is None else {"columns": columns}
    if query is None:
        return known.open(file, **options)
    if "query" in known.options:
        options["query"] = query
    elif query.resolution is not None:
        raise without_levels(known.name)
    reader = known.open(file, **options)

    def chunks(n: int, attributes: bool) -> Iterator[PointCloud]:
        """Read the points that are asked for; conditions need attributes."""
        parts = not_empty(map(query.part, reader.chunks(n, attributes or query.only is not None)))
        return parts if attributes else (replace(part, attributes={}) for part in parts)

    return replace(reader, chunks=chunks, spans=None)


def not_empty(clouds: Iterator[PointCloud]) -> Iterator[PointCloud]:
    """Yield the clouds that have points, or the last one if none has."""
    found = False
    for cloud in clouds:
        if len(cloud):
            found = True
            yield cloud
    if not found:
        yield cloud


def without_levels(name: str) -> FileFormatError:
    """Return the error for a file that cannot be read to a resolution."""
    return FileFormatError(
        f"expected a COPC file, which alone has levels of resolution, found {name}; leave out resolution"
    )
