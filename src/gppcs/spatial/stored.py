"""Points on disk, sorted by the boxes in which they lie, so that a tile and its halo can be read.

Each chunk of a cloud is sorted by itself, and written to a file of its own, a *run*. So several processes can write.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.spatial.boxes import Boxes, Tile
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.row_sample import drawn, row_hashes

SAMPLED = 1 << 18  # Points of the sample by which space is divided.
PER_BOX = 16  # Sampled points of a box at least.
BOX = 1 << 16  # Points of a box, unless there are more boxes than the sample can tell apart.

_RECORD = np.dtype([("row", np.int64), ("place", np.float64, 3)])
BYTES_ON_DISK = _RECORD.itemsize  # for each point


class TilePoints(NamedTuple):
    """The points of a tile.

    Attributes
    ----------
    rows : (n,) array, int64
        Rows of the points in the cloud, ascending.
    points : (n, 3) array
    """

    rows: NDArray[np.int64]
    points: NDArray[np.float64]


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
    """The points of a cloud, in a file for each run.

    Attributes
    ----------
    folder : path
        An existing folder.
    boxes : Boxes
    counts : (boxes,) array, int64
        Number of points in each box.
    runs : tuple of int
        The row of the first point of each run.
    """

    folder: Path
    boxes: Boxes
    counts: NDArray[np.int64]
    runs: tuple[int, ...]

    def inside(self, tile: Tile) -> NDArray[np.float64]:
        """Read the points of a tile alone.

        Parameters
        ----------
        tile : Tile

        Returns
        -------
        (n, 3) array
            In any order.
        """
        places: NDArray[np.float64] = self._records(tile)["place"]
        return places

    def own(self, tile: Tile) -> TilePoints:
        """Read the points of a tile alone, with their rows.

        Parameters
        ----------
        tile : Tile

        Returns
        -------
        TilePoints
        """
        records = self._records(tile)
        order = np.argsort(records["row"], kind="stable")
        return TilePoints(records["row"][order], records["place"][order])

    def halo(self, tile: Tile, width: float, most: int) -> NDArray[np.float64] | None:
        """Read the points around a tile, unless they are too many.

        Parameters
        ----------
        tile : Tile
        width : float
            Of the halo, along each axis.
        most : int
            Number of points at most.

        Returns
        -------
        (n, 3) array or None
            In any order.
        """
        low, high = tile.low - width, tile.high + width
        boxes = [(box, box + 1) for box in self.boxes.around(tile, width).tolist()]
        found, count = [np.empty((0, 3))], 0
        for run in self.runs:
            for part in self._read(run, boxes):
                places = part["place"]
                found.append(places[((places >= low) & (places <= high)).all(axis=1)])
                count += len(found[-1])
                if count > most:
                    return None
        return np.concatenate(found)

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
        boxes = [(tile.first, tile.last), *((box, box + 1) for box in self.boxes.around(tile, width).tolist())]
        inside, around = [], []
        for run in self.runs:
            parts = self._read(run, boxes)
            inside.append(next(parts))
            around += [p[((p["place"] >= low) & (p["place"] <= high)).all(axis=1)] for p in parts if len(p)]
        records = np.concatenate(inside + around)
        order = np.argsort(records["row"], kind="stable")
        return Neighbourhood(records["row"][order], records["place"][order], order < sum(map(len, inside)))

    def remove(self) -> None:
        """Remove the files."""
        for run in self.runs:
            _run(self.folder, run).unlink(missing_ok=True)

    def _records(self, tile: Tile) -> NDArray[Any]:
        """Read the records of a tile alone, in any order."""
        return np.concatenate([next(self._read(run, [(tile.first, tile.last)])) for run in self.runs])

    def _read(self, run: int, boxes: Sequence[tuple[int, int]]) -> Iterator[NDArray[Any]]:
        """Yield the points of a run in some boxes, several of which may be given by the first and the one behind."""
        with _run(self.folder, run).open("rb") as file:
            starts = np.fromfile(file, np.int64, len(self.boxes) + 1)
            begin = file.tell()
            for first, last in boxes:
                file.seek(begin + int(starts[first]) * _RECORD.itemsize)
                yield np.fromfile(file, _RECORD, int(starts[last] - starts[first]))


def _run(folder: Path, first: int) -> Path:
    return folder / f"{first}.points"


def _write_run(
    folder: Path, boxes: Boxes, first: int, points: NDArray[np.float64]
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Write a run. Return its first row, the boxes with points, and how many these have."""
    of_point = boxes.box_of(points)
    order = np.argsort(of_point, kind="stable")
    records = np.empty(len(points), dtype=_RECORD)
    records["row"], records["place"] = first + order, points[order]
    counts = np.bincount(of_point, minlength=len(boxes))
    path = _run(folder, first)
    unfinished = folder / f"{path.name}.{uuid4().hex}"  # a task may be done by two workers at once
    with unfinished.open("wb") as file:
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64).tofile(file)
        records.tofile(file)
    os.replace(unfinished, path)
    filled = np.flatnonzero(counts)
    return first, filled, counts[filled]


def store(points: ChunkedPoints, folder: Path, stages: Stages) -> tuple[StoredPoints, NDArray[np.float64]]:
    """Store points by boxes, in two passes over them. If these are made by workers, the workers write the points.

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
    for left in folder.glob("*.points*"):  # by an interrupted run
        left.unlink()
    share = min(1.0, (SAMPLED + 8.0 * math.sqrt(SAMPLED)) / len(points))  # so that there are hardly ever too few
    with stages("sample", len(points)) as advanced:
        found = list(points.each(partial(_drawn, share), advanced))
    hashes, places = map(np.concatenate, zip(*found, strict=True))
    sample = places[np.argsort(hashes)[:SAMPLED]]
    wanted, most = -(-len(points) // BOX), max(1, len(sample) // PER_BOX)
    boxes = Boxes.of(sample, 1 << min((wanted - 1).bit_length(), most.bit_length() - 1))
    counts, runs = np.zeros(len(boxes), dtype=np.int64), []
    with stages("boxes", len(points)) as advanced:
        for first, filled, of_box in points.each(partial(_write_run, folder, boxes), advanced):
            counts[filled] += of_box
            runs.append(first)
    return StoredPoints(folder, boxes, counts, tuple(runs)), sample


def _drawn(share: float, first: int, points: NDArray[np.float64]) -> tuple[NDArray[np.uint64], NDArray[np.float64]]:
    """Return a random number for each point of a sample of a chunk, and these points."""
    rows = np.arange(first, first + len(points))
    some = np.flatnonzero(drawn(rows, share))
    return row_hashes(rows[some]), points[some]


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
