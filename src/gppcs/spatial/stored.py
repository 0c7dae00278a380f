"""Points on disk, sorted by the boxes in which they lie, so that a tile and its halo can be read."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.spatial.boxes import Boxes, Tile
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.row_sample import RowSample

SAMPLED = 1 << 18  # Points of the sample by which space is divided.
PER_BOX = 16  # Sampled points of a box at least.
BOX = 1 << 16  # Points of a box, unless there are more boxes than the sample can tell apart.

_RECORD = np.dtype([("row", np.int64), ("place", np.float64, 3)])
BYTES_ON_DISK = _RECORD.itemsize  # for each point


class Neighbourhood(NamedTuple):
    """The points of a tile and of its halo.

    Attributes
    ----------
    rows : (n,) array, int64
        Rows of the points in the cloud, ascending.
    points : (n, 3) array
    inside : (n,) array, bool
        Whether a point lies in the tile itself.
    """

    rows: NDArray[np.int64]
    points: NDArray[np.float64]
    inside: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class StoredPoints:
    """The points of a cloud, in a file for each box.

    Attributes
    ----------
    folder : path
        An existing folder.
    boxes : Boxes
    counts : (boxes,) array, int64
        Number of points in each box.
    """

    folder: Path
    boxes: Boxes
    counts: NDArray[np.int64]

    @classmethod
    def none(cls, folder: Path, boxes: Boxes) -> StoredPoints:
        """Return a store without points.

        Parameters
        ----------
        folder : path
        boxes : Boxes

        Returns
        -------
        StoredPoints
        """
        return cls(folder, boxes, np.zeros(len(boxes), dtype=np.int64))

    def add(self, first: int, points: NDArray[np.float64]) -> None:
        """Append points.

        Parameters
        ----------
        first : int
            Row of the first of them.
        points : (n, 3) array
        """
        boxes = self.boxes.box_of(points)
        order = np.argsort(boxes, kind="stable")
        records = np.empty(len(points), dtype=_RECORD)
        records["row"], records["place"] = first + order, points[order]
        counts = np.bincount(boxes, minlength=len(self.boxes))
        for box, last in zip(np.flatnonzero(counts).tolist(), np.cumsum(counts[counts > 0]), strict=True):
            with self._path(box).open("ab") as file:
                records[last - counts[box] : last].tofile(file)
        self.counts[:] += counts

    def near(self, tile: Tile, width: float) -> Neighbourhood:
        """Read the points of a tile and of a halo around it.

        Parameters
        ----------
        tile : Tile
        width : float
            Of the halo, along each axis.

        Returns
        -------
        Neighbourhood
        """
        low, high = tile.low - width, tile.high + width
        parts = [self._read(box) for box in range(tile.first, tile.last)]
        own = sum(map(len, parts))
        for box in self.boxes.around(tile, width):
            found = self._read(int(box))
            parts.append(found[((found["place"] >= low) & (found["place"] <= high)).all(axis=1)])
        records = np.concatenate(parts)
        order = np.argsort(records["row"], kind="stable")
        return Neighbourhood(records["row"][order], records["place"][order], order < own)

    def remove(self) -> None:
        """Remove the files."""
        for box in np.flatnonzero(self.counts).tolist():
            self._path(box).unlink(missing_ok=True)

    def _read(self, box: int) -> NDArray[Any]:
        return np.fromfile(self._path(box), dtype=_RECORD) if self.counts[box] else np.empty(0, dtype=_RECORD)

    def _path(self, box: int) -> Path:
        return self.folder / f"{box}.points"


def store(points: ChunkedPoints, folder: Path, stages: Stages) -> tuple[StoredPoints, NDArray[np.float64]]:
    """Store points by boxes, in two passes over them.

    Parameters
    ----------
    points : ChunkedPoints
        N points.
    folder : path
        An existing folder. It takes 32 bytes for each point. If the same points are there already, they stay.
    stages : Stages
        Times "sample" and "boxes". A step is a point.

    Returns
    -------
    stored : StoredPoints
    sample : (n, 3) array
        The random sample of the points by which space is divided into boxes.
    """
    return Journal(folder).once("boxes", lambda: _store(points, folder, stages))


def _store(points: ChunkedPoints, folder: Path, stages: Stages) -> tuple[StoredPoints, NDArray[np.float64]]:
    for left in folder.glob("*.points"):  # by an interrupted run
        left.unlink()
    with stages("sample", len(points)) as advanced:
        sample = RowSample(SAMPLED)
        for chunk in points.chunks():
            sample.add(chunk)
            advanced(len(chunk))
    wanted, most = -(-len(points) // BOX), max(1, len(sample.points) // PER_BOX)
    stored = StoredPoints.none(
        folder, Boxes.of(sample.points, 1 << min((wanted - 1).bit_length(), most.bit_length() - 1))
    )
    with stages("boxes", len(points)) as advanced:
        first = 0
        for chunk in points.chunks():
            stored.add(first, chunk)
            first += len(chunk)
            advanced(len(chunk))
    return stored, sample.points


@dataclass(frozen=True, eq=False)
class StoredTable:
    """A table with a file for each column. Its rows are sorted by the boxes in which their places lie.

    Attributes
    ----------
    folder : path
        An existing folder.
    boxes : Boxes
    starts : (boxes + 1,) array, int64
        Where the rows of each box start.
    """

    folder: Path
    boxes: Boxes
    starts: NDArray[np.int64]

    def __len__(self) -> int:
        return int(self.starts[-1])

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of rows in each box."""
        return np.diff(self.starts)

    def rows_of(self, tile: Tile) -> slice:
        """Return the rows of a tile.

        Parameters
        ----------
        tile : Tile

        Returns
        -------
        slice
        """
        return slice(int(self.starts[tile.first]), int(self.starts[tile.last]))

    def rows_near(self, tile: Tile, width: float) -> NDArray[np.int64]:
        """Return the rows of a tile and of a halo around it.

        Parameters
        ----------
        tile : Tile
        width : float
            Of the halo, along each axis.

        Returns
        -------
        (n,) array, int64
            Ascending.
        """
        own, parts = self.rows_of(tile), []
        column = np.load(self._path("place"), mmap_mode="r")
        for box in self.boxes.around(tile, width):
            begin, end = self.starts[box : box + 2]
            if begin < end:
                places = np.array(column[begin:end])
                inside = ((places >= tile.low - width) & (places <= tile.high + width)).all(axis=1)
                parts.append(begin + np.flatnonzero(inside))
        return np.sort(np.concatenate([np.arange(own.start, own.stop), *parts]))

    def create(self, column: str, like: NDArray[Any]) -> None:
        """Add a column of zeros.

        Parameters
        ----------
        column : str
        like : (n, ...) array
            Of the type and the shape of its values.
        """
        shape = (len(self), *like.shape[1:])
        np.lib.format.open_memmap(self._path(column), mode="w+", dtype=like.dtype, shape=shape)

    def take(self, column: str, rows: slice | NDArray[np.int64]) -> NDArray[Any]:
        """Read some values of a column.

        Parameters
        ----------
        column : str
        rows : slice or (n,) array, int64

        Returns
        -------
        (n, ...) array
        """
        return np.array(np.load(self._path(column), mmap_mode="r")[rows])  # the file is unmapped at once

    def chunks_of(self, column: str, rows: int) -> Iterator[NDArray[Any]]:
        """Read a column from its start to its end.

        Parameters
        ----------
        column : str
        rows : int
            Values to read at once.

        Yields
        ------
        (n, ...) array
        """
        for begin in range(0, len(self), rows):
            yield self.take(column, slice(begin, begin + rows))

    def put(self, column: str, rows: slice | NDArray[np.int64], values: Any) -> None:
        """Write some values of a column.

        Parameters
        ----------
        column : str
        rows : slice or (n,) array, int64
        values : (n, ...) array or scalar
        """
        np.load(self._path(column), mmap_mode="r+")[rows] = values

    def remove(self) -> None:
        """Remove the files."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, column: str) -> Path:
        return self.folder / f"{column}.npy"


def store_part(folder: Path, tile: Tile, boxes: Boxes, columns: Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """Write the rows of a table that lie in a tile.

    Parameters
    ----------
    folder : path
    tile : Tile
    boxes : Boxes
    columns : mapping of str to (n, ...) array
        In the order in which the rows of a box are to be. One of them is "place", (n, 3).

    Returns
    -------
    (boxes of the tile,) array, int64
        Number of rows in each.
    """
    of_row = boxes.box_of(columns["place"]) - tile.first
    order = np.argsort(of_row, kind="stable")
    for name, values in columns.items():
        np.save(_part(folder, tile, name), values[order])
    return np.bincount(of_row, minlength=tile.last - tile.first)


def joined(
    folder: Path, boxes: Boxes, counts: Sequence[tuple[Tile, NDArray[np.int64]]], columns: Sequence[str]
) -> StoredTable:
    """Join the parts of a table.

    Parameters
    ----------
    folder : path
        That of the parts. Their files are removed.
    boxes : Boxes
    counts : sequence of (Tile, array)
        What `store_part` returned for each tile, in the order of the boxes.
    columns : sequence of str
        Their names.

    Returns
    -------
    StoredTable
    """
    in_box = np.zeros(len(boxes), dtype=np.int64)
    for tile, rows in counts:
        in_box[tile.first : tile.last] = rows
    table = StoredTable(folder, boxes, np.concatenate([[0], np.cumsum(in_box)]))
    for name in columns:
        for number, (tile, _) in enumerate(counts):
            part = np.load(_part(folder, tile, name))
            if number == 0:
                table.create(name, part)
            table.put(name, table.rows_of(tile), part)
            _part(folder, tile, name).unlink()
    return table


def _part(folder: Path, tile: Tile, column: str) -> Path:
    return folder / f"{column}-{tile.first}.npy"
