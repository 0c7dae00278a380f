"""Decompresses the points of LAZ and COPC files, by the library lazrs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BufferedReader
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError
from gppcs.io.las_header import Record
from gppcs.io.rows import BLOCK, reported

_LAZRS = ("lazrs", "whole compressed points")
_MOST_IN_CHUNK = 10_000_000  # points: a table that lies takes no more memory


def decompressed_chunks(
    file: BufferedReader, record: np.dtype[Any], chunks: Sequence[tuple[int, int, int]], laszip: Record | None
) -> Iterator[NDArray[Any]]:
    """Yield the points of some chunks of a file, in blocks of at least one chunk. Shapes: returns (n,)."""
    import lazrs

    with reported(*_LAZRS):
        laszip = _checked(laszip, record)
        layers = _layers(laszip)
    content, table, n = bytearray(), [], 0
    for i, (position, size, count) in enumerate(chunks):
        if not 0 < count <= _MOST_IN_CHUNK:
            raise FileFormatError(f"expected chunks of 1 to {_MOST_IN_CHUNK:,} points, found one of {count:,}")
        _check_chunk(file, position, size, record.itemsize, layers)
        file.seek(position)
        content += file.read(size)
        table.append((count, size))
        n += count
        if n >= BLOCK or i == len(chunks) - 1:
            block = np.empty(n, record)
            with reported(*_LAZRS):
                lazrs.decompress_points_with_chunk_table(
                    content, laszip.data, block.view(np.uint8), table,
                    lazrs.DecompressionSelection(lazrs.SELECTIVE_DECOMPRESS_ALL),
                )  # fmt: skip
            yield block
            content, table, n = bytearray(), [], 0


def chunks_of_points(
    file: BufferedReader, record: np.dtype[Any], count: int, laszip: Record | None
) -> list[tuple[int, int, int]]:
    """Return all chunks of a file, for `decompressed_chunks`."""
    position, left, found = file.tell() + 8, count, []
    if not count:
        return []
    with reported(*_LAZRS):
        laszip = _checked(laszip, record)
        table, layers = _chunk_table(file, laszip), _layers(laszip)
    for points, size in table:
        if min(points, left):
            found.append((position, size, min(points, left)))
        else:  # which nobody reads
            _check_chunk(file, position, size, record.itemsize, layers)
        position, left = position + size, left - min(points, left)
    if left:
        raise _ends_early()
    return found


def fewest_points(file: BufferedReader, record: np.dtype[Any], laszip: Record | None) -> int:
    """Return how many points all chunks of a file hold at least: the last may have fewer than the table says."""
    with reported(*_LAZRS):
        table = _chunk_table(file, _checked(laszip, record))
    return sum(points for points, _ in table[:-1]) + 1


def _checked(laszip: Record | None, record: np.dtype[Any]) -> Record:
    """Return the record that describes the compression, if it is there and fits the record of a point."""
    import lazrs

    if laszip is None:
        raise FileFormatError("expected a record that describes the compression of the points, found none")
    size = lazrs.LazVlr(laszip.data).item_size()
    if size != record.itemsize:
        raise FileFormatError(f"expected compressed points of {record.itemsize} bytes, found {size}")
    return laszip


def _chunk_table(file: BufferedReader, laszip: Record) -> list[tuple[int, int]]:
    """Return the number of points and the size in bytes of each chunk. The file is at its first point before and after.

    If all chunks but the last have the same number of points, the table gives this number for the last one, too,
    even if it has fewer.
    """
    import lazrs

    start = file.tell()
    size = file.seek(0, 2)
    table = _whole_number(file, start, 8)
    if table == -1:  # of a file that was written without going back
        table = _whole_number(file, size - 8, 8)
    n_chunks = _whole_number(file, table + 4, 4) & 0xFFFFFFFF if start < table <= size - 8 else -1
    file.seek(start)
    if not 0 < n_chunks <= size:
        raise FileFormatError("expected a table of the compressed points, found none; get the whole file again")
    chunks: list[tuple[int, int]] = lazrs.read_chunk_table(file, lazrs.LazVlr(laszip.data))
    file.seek(start)
    return chunks


def _check_chunk(file: BufferedReader, position: int, length: int, point_size: int, n_layers: int) -> None:
    """Check that a chunk lies in the file and its layers in the chunk, and that none begins with four bytes 0xff.

    No arithmetic coder writes such a beginning. It brings the decoder of lazrs into a state that it never leaves: it
    calls itself until the stack is full, which ends the process.
    """
    if not 0 < length <= file.seek(0, 2) - position:
        raise _ends_early()
    sizes, start = [length - point_size], position + point_size
    if n_layers:
        file.seek(start + 4)  # behind the number of points
        sizes = np.frombuffer(file.read(4 * n_layers).ljust(4 * n_layers, b"\0"), "<u4").tolist()
        start += 4 + 4 * n_layers
    if sum(sizes) > length:
        raise _ends_early()
    for size in sizes:
        file.seek(start)
        if size >= 4 and file.read(4) == b"\xff" * 4:
            raise FileFormatError("expected whole compressed points, found damaged ones; get the whole file again")
        start += size


def _ends_early() -> FileFormatError:
    return FileFormatError("expected all compressed points within the file, found fewer; get it again")


def _layers(laszip: Record) -> int:
    """Return the number of layers in each chunk, whose sizes follow its first point and its number of points."""
    items = np.frombuffer(laszip.data, [("type", "<u2"), ("size", "<u2"), ("version", "<u2")], offset=34)
    known = {10: 9, 11: 1, 12: 2, 13: 1}  # points from format 6 on, colours, near infrared, wave packets
    return sum(int(each["size"]) if each["type"] == 14 else known.get(int(each["type"]), 0) for each in items)


def _whole_number(file: BufferedReader, position: int, length: int) -> int:
    file.seek(max(position, 0))
    return int.from_bytes(file.read(length), "little", signed=True)
