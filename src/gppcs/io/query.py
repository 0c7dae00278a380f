"""The class `Query`: which part of a file is read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, ParameterError, number, shown
from gppcs.io.format import Format
from gppcs.io.rows import BLOCK


@dataclass(frozen=True)
class Query:
    """Which points of a file are read.

    Attributes
    ----------
    low, high : tuple of 3 float
        The corners of the box with the points; infinite if there is none.
    resolution : float or None
        The distance of neighbours up to which a COPC file is read; None for all points.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    resolution: float | None

    @classmethod
    def of(cls, box: Sequence[float] | None, resolution: float | None) -> Query | None:
        """Check the arguments `box` and `resolution` of `gppcs.read`.

        Parameters
        ----------
        box, resolution
            As for `gppcs.read`.

        Returns
        -------
        Query or None
            None if both are None.

        Raises
        ------
        ParameterError
            If they are not as expected.
        """
        if box is None and resolution is None:
            return None
        if resolution is not None and not 0 < number(resolution) < math.inf:
            raise ParameterError(f"expected a resolution above 0, found {shown(resolution)}")
        limits = [number(value) for value in box] if isinstance(box, Iterable) else []
        low, high = limits[: len(limits) // 2], limits[len(limits) // 2 :]
        if box is not None and not (
            len(limits) in (4, 6) and all(least <= most for least, most in zip(low, high, strict=True))
        ):
            raise ParameterError(
                "expected a box xmin, ymin, xmax, ymax or xmin, ymin, zmin, xmax, ymax, zmax, with no minimum above "
                f"its maximum, found {shown(box)}"
            )
        fill = 3 - len(low)
        return cls(
            (*low, *[-math.inf] * fill),
            (*high, *[math.inf] * fill),
            None if resolution is None else float(resolution),
        )

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points are in the box; those on its border are.

        Parameters
        ----------
        points : (N, 3) array

        Returns
        -------
        (N,) array
            All, also NaN, if there is no box.
        """
        limited = np.isfinite(self.low) | np.isfinite(self.high)
        return np.logical_and.reduce((points >= self.low) & (points <= self.high) | ~limited, axis=1)

    def part(self, cloud: PointCloud) -> PointCloud:
        """Return the points of a cloud that are in the box.

        Parameters
        ----------
        cloud : PointCloud

        Returns
        -------
        PointCloud
            The cloud itself if all are.
        """
        inside = self.holds(cloud.points)
        return cloud if inside.all() else cloud.take(np.flatnonzero(inside))


def restricted(known: Format, query: Query) -> Format:
    """Return a format that reads only the part of a file that a query asks for.

    Parameters
    ----------
    known : Format
    query : Query

    Returns
    -------
    Format
        It counts points by reading them, and its files cannot be divided.

    Raises
    ------
    FileFormatError
        If the query has a resolution, and no file of the format has levels of resolution.
    """
    if query.resolution is not None and not known.takes_query:
        raise without_levels(known.name)
    known = replace(known, spans=None)
    read, read_named, chunks = known.read, known.read_named, known.chunks
    if known.takes_query:
        part = replace(known, read=partial(read, query=query), chunks=chunks and partial(chunks, query=query))
    else:
        part = replace(
            known,
            read=lambda file: query.part(read(file)),
            read_named=read_named and (lambda file, names: query.part(read_named(file, names))),
            chunks=chunks and (lambda *arguments: not_empty(map(query.part, chunks(*arguments)))),
        )
    if part.chunks is None:
        return part
    some = part.chunks
    return replace(part, count=lambda file: sum(map(len, some(file, BLOCK, False))))


def not_empty(clouds: Iterator[PointCloud]) -> Iterator[PointCloud]:
    """Yield the clouds that have points, or the last one if none has.

    Parameters
    ----------
    clouds : iterator of PointCloud
        At least one.

    Yields
    ------
    PointCloud
    """
    found = False
    for cloud in clouds:
        if len(cloud):
            found = True
            yield cloud
    if not found:
        yield cloud


def without_levels(name: str) -> FileFormatError:
    """Return the error for a file that cannot be read to a resolution.

    Parameters
    ----------
    name : str
        Of its format.

    Returns
    -------
    FileFormatError
    """
    found = f"expected a COPC file, which alone has levels of resolution, found {name}; leave out "
    return FileFormatError(f"{found}resolution=", command=f"{found}--resolution")
