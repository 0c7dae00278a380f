"""The class `Query`: which part of a file is read."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.errors import FileFormatError, InputError, ParameterError, number, shown
from gppcs.io.format import Format
from gppcs.io.polygons import Polygons, read_polygons
from gppcs.io.rows import BLOCK


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
            None if only is None else Expression.of(only),
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


def restricted(known: Format, query: Query) -> Format:
    """Return a format that reads only the part of a file that a query asks for."""
    if query.resolution is not None and not known.takes_query:
        raise without_levels(known.name)
    chunks = partial(known.chunks, query=query) if known.takes_query else known.chunks
    if query.only is not None or not known.takes_query:
        chunks = partial(_chunks, query, chunks)
    count = None if known.whole else (lambda file: sum(map(len, chunks(file, BLOCK, False))))
    return replace(known, chunks=chunks, spans=None, count=count or known.count)


def _chunks(
    query: Query,
    chunks: Callable[..., Iterator[PointCloud]],
    file: Any,
    rows: int,
    attributes: bool,
    **names: list[str],
) -> Iterator[PointCloud]:
    """Read the wanted points in chunks, as `Format.chunks` says; conditions need attributes."""
    parts = not_empty(map(query.part, chunks(file, rows, attributes or query.only is not None, **names)))
    return parts if attributes else (replace(part, attributes={}) for part in parts)


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
