"""Reads COPC files by the octree that they hold: parts of the cloud, or single nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError
from gppcs.io import las as las_files
from gppcs.io.format import Reader, begins
from gppcs.io.las_header import LasHeader, read_header
from gppcs.io.laz import points_of
from gppcs.io.query import Query
from gppcs.io.rows import damaged

if TYPE_CHECKING:
    import laspy
    from laspy.copc import CopcInfoVlr

# An entry of the index, as the COPC specification places its fields: a node, whose points are a chunk of the file.
ENTRY = np.dtype([("level", "<i4"), ("cell", "<i4", 3), ("offset", "<u8"), ("size", "<i4"), ("count", "<i4")])

is_copc = begins(rb"LASF.{373}copc\0")


def open_copc(file: BufferedReader, query: Query | None = None) -> Reader:
    """Open a COPC file, of which only those nodes are read that a query may need."""
    return las_files.open_las(file, partial(_chunks_in, query=query)) if query else las_files.open_las(file)


def _chunks_in(file: BufferedReader, las: laspy.LasHeader, query: Query) -> NDArray[Any]:
    """Return the entries (K,) of the nodes that a query may need, in the order of the file."""
    info, entries = index_of(file, las)
    if query.resolution is not None:
        deepest = math.ceil(math.log2(info.spacing) - math.log2(query.resolution))
        entries = entries[entries["level"] <= max(0, deepest)]
    with np.errstate(all="ignore"):  # an entry of no possible level meets nothing
        side = np.ldexp(2 * info.halfsize, -entries["level"])[:, np.newaxis]
        lower = info.center - info.halfsize + entries["cell"] * side
        # Coordinates are rounded to the scale, which may move a point out of its cell.
        meets = (lower - las.scales <= query.upper) & (lower + side + las.scales >= query.lower)
    return entries[meets.all(axis=1)]


def index_of(file: BufferedReader, las: laspy.LasHeader) -> tuple[CopcInfoVlr, NDArray[Any]]:
    """Return what a file says of its octree, and the entries (K,) of all nodes with points, in the order of the file.

    laspy's reader of queries is not used: it holds all points at once, and some damaged files keep it busy for ever.
    """
    records = las.vlrs.get("CopcInfoVlr")
    if not records:
        raise FileFormatError("expected a COPC file, found LAS or LAZ without its index")
    info = records[0]
    if not (0 < info.spacing < math.inf and 0 < info.halfsize < math.inf):
        raise damaged("a COPC index with a spacing and a size above 0", f"{info.spacing:g} and {info.halfsize:g}")
    size = unread = file.seek(0, 2)
    pages, parts = [(info.hierarchy_root_offset, info.hierarchy_root_size)], [np.empty(0, ENTRY)]
    visited = set[int]()
    while pages:
        offset, length = pages.pop()
        unread -= length
        # Pages that overlap, or lead to each other, would be read for ever.
        if not 0 <= length <= size - offset or unread < 0 or offset in visited:
            raise damaged("a COPC index within the file", "another")
        visited.add(offset)
        file.seek(offset)
        page = np.frombuffer(file.read(length // ENTRY.itemsize * ENTRY.itemsize), ENTRY)
        links = page[page["count"] == -1]
        pages += zip(links["offset"].tolist(), links["size"].tolist(), strict=True)
        parts.append(page[page["count"] > 0])
    entries = np.concatenate(parts)
    entries = entries[np.lexsort([entries["count"], entries["size"], entries["offset"]])]
    ends = entries["offset"] + entries["size"].astype(np.uint64)
    if (ends[:-1] > entries["offset"][1:]).any():
        raise damaged("a COPC index of chunks side by side", "some that overlap")
    if (count := int(entries["count"].sum(dtype=np.int64))) != las.point_count:
        raise FileFormatError(
            f"expected a COPC index of all {las.point_count:,} points, found one of {count:,}; get the file again, or "
            "read it without a box and a resolution"
        )
    return info, entries


class CopcNodes:
    """The nodes of an open COPC file that have points, from coarse to fine.

    Of K nodes, `entries`, (K,), is what the index says of each, of type `ENTRY`, and `starts`, (K,), the index of its
    first point in the file. `las` is the header of the file, and `info` what it says of the octree.
    """

    def __init__(self, file: BufferedReader) -> None:
        self._file = file
        self.las = read_header(file)
        self._header = LasHeader.from_laspy(self.las)
        self.info, entries = index_of(file, self.las)
        order = np.argsort(entries["level"], kind="stable")
        counts = entries["count"].astype(np.int64)
        self.entries, self.starts = entries[order], (np.cumsum(counts) - counts)[order]

    def read(self, numbers: Sequence[int]) -> tuple[NDArray[np.int64], PointCloud]:
        """Return the points of some nodes: their coordinates as whole numbers (N, 3), and as a cloud."""
        empty = np.empty(0, self.las.point_format.dtype())
        records = np.concatenate([empty, *points_of(self._file, self.las, self.entries[list(numbers)])])
        multiples = np.stack([records[axis].astype(np.int64) for axis in "XYZ"], axis=1)
        return multiples, las_files.cloud_of(records, self.las, self._header)


@contextmanager
def nodes_of(path: Path, more_than: int = 0) -> Iterator[CopcNodes | None]:
    """Open a COPC file by its nodes; return none if the file is another one, or has no more points than that."""
    if not path.is_file():
        yield None
        return
    with open(path, "rb") as file:
        nodes = CopcNodes(file) if is_copc(file.read(1024), path.stat().st_size) else None
        yield nodes if nodes and nodes.entries["count"].sum() > more_than else None
