"""Reads the nodes of a COPC file one by one, as far as somebody looks at them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError
from gppcs.io import copc_writing, las
from gppcs.io.copc import entries_of, info_of
from gppcs.io.files import naming
from gppcs.io.las_header import COPC, LASZIP, read_header
from gppcs.io.laz import decompressed_chunks
from gppcs.io.query import Query

_ALL = Query((-math.inf,) * 3, (math.inf,) * 3, None)
_HEAD = 1024  # bytes that tell whether a file is COPC


class CopcNodes:
    """The nodes of an open COPC file that have points, from coarse to fine.

    Of K nodes, `entries`, (K,), is what the index says of each, of type `ENTRY`, and `rows`, (K,), the row in the file
    of its first point. `info`, of type `INFO`, is what the file says of the octree. Coordinates are whole numbers times
    `scales`, (3,), plus `offsets`, (3,).
    """

    def __init__(self, file: BufferedReader) -> None:
        self._file = file
        self._header, fields, own = read_header(file)
        if COPC not in own:
            raise FileFormatError("expected a COPC file, found LAS or LAZ without its index")
        self._layout, self._laszip = las.layout_of(self._header, fields), own.get(LASZIP)
        self.scales, self.offsets = fields["scales"][0], fields["offsets"][0]
        self.info = info_of(own[COPC].data)
        found = entries_of(file, self.info, _ALL, self.scales)
        order = np.argsort(found["level"], kind="stable")
        self.entries, self.rows = found[order], (np.cumsum(found["count"], dtype=np.int64) - found["count"])[order]

    def read(self, numbers: Sequence[int]) -> tuple[NDArray[np.int64], PointCloud]:
        """Return the points of some nodes: their coordinates as whole numbers (N, 3), and as a cloud."""
        wanted = self.entries[list(numbers)]
        chunks = list(zip(*(wanted[name].tolist() for name in ("offset", "size", "count")), strict=True))
        blocks = list(decompressed_chunks(self._file, self._layout.record, chunks, self._laszip))
        records = np.concatenate([np.empty(0, self._layout.record), *blocks])
        whole = np.stack([records[axis].astype(np.int64) for axis in "XYZ"], axis=1)
        points = las.coordinates_of(records, self.scales, self.offsets)
        return whole, PointCloud(points, las.attributes_of(records, self._layout), header=self._header)


@contextmanager
def nodes_of(path: Path, more_than: int = 0) -> Iterator[CopcNodes | None]:
    """Open a COPC file by its nodes; return none if the file is another one, or has no more points than that."""
    if not path.is_file():
        yield None
        return
    with naming(path), open(path, "rb") as file:
        if copc_writing.FORMAT.recognises(file.read(_HEAD), path.stat().st_size):
            nodes = CopcNodes(file)
            yield nodes if nodes.entries["count"].sum() > more_than else None
        else:
            yield None
