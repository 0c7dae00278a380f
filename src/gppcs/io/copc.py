"""Finds the chunks of a COPC file that a query asks for, by the octree in the file.

laspy's reader is not used: it holds all points that it finds at once, and some damaged files keep it busy for ever.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from io import BufferedReader
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError
from gppcs.io.query import Query

# As the COPC specification names and places them. The chunk of an entry holds the points of one cell of the octree.
INFO = np.dtype(
    [
        ("center", "<f8", 3), ("halfsize", "<f8"), ("spacing", "<f8"), ("root_offset", "<u8"), ("root_size", "<u8"),
        ("gps_time", "<f8", 2), ("reserved", "V88"),
    ]
)  # fmt: skip
ENTRY = np.dtype([("level", "<i4"), ("cell", "<i4", 3), ("offset", "<u8"), ("size", "<i4"), ("count", "<i4")])
_PAGE = -1  # the count of an entry that stands for a page with more entries


def chunks_of(
    file: BufferedReader, info: bytes, query: Query, scales: NDArray[np.float64]
) -> list[tuple[int, int, int]]:
    """Return the chunks with all points that a query asks for. Shapes: scales (3,)."""
    found = entries_of(file, info_of(info), query, scales)
    return list(zip(found["offset"].tolist(), found["size"].tolist(), found["count"].tolist(), strict=True))


def info_of(info: bytes) -> Any:
    """Return what a file says of its octree, by the names of `INFO`."""
    if len(info) < INFO.itemsize:
        raise FileFormatError(f"expected at least {INFO.itemsize} bytes about the COPC index, found {len(info)}")
    fields = np.frombuffer(info, INFO, 1)[0]
    if not (0 < fields["spacing"] < math.inf and 0 < fields["halfsize"] < math.inf):
        raise FileFormatError(
            "expected a COPC index with a spacing and a size above 0, found "
            f"{fields['spacing']:g} and {fields['halfsize']:g}; get the whole file again"
        )
    return fields


def entries_of(file: BufferedReader, info: Any, query: Query, scales: NDArray[np.float64]) -> NDArray[Any]:
    """Return the entries, (K,), of all nodes with points that a query asks for, in the order of the file."""
    deepest = np.iinfo(np.int32).max
    if query.resolution is not None:
        deepest = math.ceil(math.log2(info["spacing"]) - math.log2(query.resolution))
    pages = _pages(file, info, query, max(0, deepest), scales)
    found = np.concatenate([np.empty(0, ENTRY), *(page[page["count"] > 0] for page in pages)])
    found = found[np.lexsort([found["count"], found["size"], found["offset"]])]
    offsets, sizes = found["offset"].tolist(), found["size"].tolist()
    if any(offset + size > after for offset, size, after in zip(offsets, sizes, offsets[1:], strict=False)):
        raise FileFormatError("expected a COPC index of chunks side by side, found some that overlap; get it again")
    return found


def _pages(
    file: BufferedReader, info: Any, query: Query, deepest: int, scales: NDArray[np.float64]
) -> Iterator[NDArray[Any]]:
    """Yield the entries that a query asks for, page by page."""
    size = left = file.seek(0, 2)
    places = [(int(info["root_offset"]), int(info["root_size"]))]
    while places:
        offset, length = places.pop()
        left -= length
        if not 0 <= length <= size - offset or left < 0:  # pages that lead to each other would be read for ever
            raise FileFormatError("expected a COPC index within the file, found another; get the whole file again")
        file.seek(offset)
        page = np.frombuffer(file.read(length // ENTRY.itemsize * ENTRY.itemsize), ENTRY)
        page = page[(page["level"] <= deepest) & _meets(page, info, query, scales)]
        further = page[page["count"] == _PAGE]
        places += zip(further["offset"].tolist(), further["size"].tolist(), strict=True)
        yield page


def _meets(page: NDArray[Any], info: Any, query: Query, scales: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether the cell of each entry meets the box."""
    with np.errstate(all="ignore"):  # an entry of no possible level meets nothing
        side = np.ldexp(2 * info["halfsize"], -page["level"])[:, np.newaxis]
        low = info["center"] - info["halfsize"] + page["cell"] * side
        # Coordinates are rounded to the scale, which may move a point out of its cell.
        return np.logical_and.reduce((low - scales <= query.high) & (low + side + scales >= query.low), axis=1)
