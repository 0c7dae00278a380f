"""Reads points of LAS, LAZ and COPC files by chunks, and checks the sizes of these; lazrs decompresses them."""

from __future__ import annotations

from collections.abc import Iterator
from io import BufferedReader
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError
from gppcs.io.rows import BLOCK, check_length, damaged, reported

if TYPE_CHECKING:
    import laspy

CHUNK = np.dtype([("offset", "<u8"), ("size", "<i8"), ("count", "<i8")])  # bytes of a chunk in the file, its points
_LAZRS = ("lazrs", "whole compressed points")
_WITHIN = ("all compressed points within the file", "fewer")


def chunks_of(file: BinaryIO, las: laspy.LasHeader) -> NDArray[Any]:
    """Return all chunks of a compressed file, (C,), of type `CHUNK`; the last may have fewer points than it says."""
    import lazrs

    start, laszip = las.offset_to_point_data, _laszip(las)
    size = file.seek(0, 2)
    table = _whole_number(file, start, 8)
    if table == -1:  # of a file that was written without going back
        table = _whole_number(file, size - 8, 8)
    n_chunks = _whole_number(file, table + 4, 4) & 0xFFFFFFFF if start < table <= size - 8 else -1
    if not 0 < n_chunks <= size:
        raise damaged("a table of the compressed points", "none")
    file.seek(start)
    with reported(*_LAZRS):
        counts, sizes = np.array(lazrs.read_chunk_table(file, lazrs.LazVlr(laszip)), np.int64).T
    return _chunks(start + 8, sizes, counts)


def _whole_number(file: BinaryIO, position: int, length: int) -> int:
    file.seek(max(position, 0))
    return int.from_bytes(file.read(length), "little", signed=True)


def _chunks(start: int, sizes: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[Any]:
    """Return chunks side by side."""
    chunks = np.empty(len(counts), CHUNK)
    chunks["size"], chunks["count"] = sizes, counts
    chunks["offset"] = start + np.cumsum(sizes) - sizes
    return chunks


def checked_chunks(file: BufferedReader, las: laspy.LasHeader) -> NDArray[Any]:
    """Return the chunks of the points that the header counts, (C,), of type `CHUNK`."""
    count, start = las.point_count, las.offset_to_point_data
    if not las.are_points_compressed:
        file.seek(start)
        check_length(file, las.point_format.size, count)
        counts = np.diff([*range(0, count, BLOCK), count])
        return _chunks(start, counts * las.point_format.size, counts)
    chunks = chunks_of(file, las) if count else np.empty(0, CHUNK)
    check_counts(chunks)
    ends = np.cumsum(chunks["count"])
    if count > ends.max(initial=0):
        raise damaged(*_WITHIN)
    chunks = chunks[: np.searchsorted(ends, count) + 1]
    chunks["count"][-1:] -= ends[len(chunks) - 1 : len(chunks)] - count
    return chunks


def check_counts(chunks: NDArray[Any]) -> None:
    """Check that chunks have so few points that a table that lies takes no more memory."""
    bad = chunks["count"][(chunks["count"] <= 0) | (chunks["count"] > 10_000_000)]
    if len(bad):
        raise damaged("chunks of 1 to 10,000,000 points", f"one of {bad[0]:,}")


def points_of(file: BufferedReader, las: laspy.LasHeader, chunks: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield the points of some chunks, (n,), as they are stored, in blocks of one chunk or several."""
    import lazrs

    record = las.point_format.dtype()
    if not las.are_points_compressed:
        for offset, _, count in chunks.tolist():
            points = np.empty(count, record)
            file.seek(offset)
            file.readinto(points.view(np.uint8).data)
            yield points
        return
    check_counts(chunks)
    laszip = _laszip(las)
    with reported(*_LAZRS):
        size = lazrs.LazVlr(laszip).item_size()
        n_layers = _number_of_layers(laszip)
    if size != record.itemsize:
        raise damaged(f"compressed points of {record.itemsize} bytes", str(size))
    everything = lazrs.DecompressionSelection(lazrs.SELECTIVE_DECOMPRESS_ALL)
    blocks = np.cumsum(chunks["count"]) // (4 * BLOCK)  # of several chunks, for several cores
    for block in np.split(chunks, np.flatnonzero(np.diff(blocks)) + 1) if len(chunks) else ():
        content = bytearray()
        for offset, size in block[["offset", "size"]].tolist():
            content += _checked_chunk(file, offset, size, record.itemsize, n_layers)
        points = np.empty(block["count"].sum(), record)
        table = block[["count", "size"]].tolist()
        with reported(*_LAZRS):
            lazrs.decompress_points_with_chunk_table(content, laszip, points.view(np.uint8), table, everything)
        yield points


def _laszip(las: laspy.LasHeader) -> bytes:
    """Return the content of the record that describes the compression."""
    records = las.vlrs.get("LasZipVlr")
    if not records:
        raise damaged("a record of the compression", "none")
    laszip = bytes(records[0].record_data)
    if (compressor := int.from_bytes(laszip[:2], "little")) not in (2, 3):
        raise FileFormatError(
            f"expected points compressed in chunks, found compressor {compressor}; use LASzip to convert"
        )
    return laszip


def _number_of_layers(laszip: bytes) -> int:
    """Return the number of layers in each chunk, whose sizes follow its first point and its number of points."""
    items = np.frombuffer(laszip, [("type", "<u2"), ("size", "<u2"), ("version", "<u2")], offset=34)
    layers = {10: 9, 11: 1, 12: 2, 13: 1}  # points from format 6 on, colours, near infrared, wave packets
    return sum(size if kind == 14 else layers.get(kind, 0) for kind, size, _ in items.tolist())  # 14: extra bytes


def _checked_chunk(file: BufferedReader, offset: int, size: int, point_size: int, n_layers: int) -> bytes:
    """Read a chunk, and check that its layers lie in it and that none begins with four bytes 0xff.

    No arithmetic coder writes such a beginning. It brings the decoder of lazrs into a state that it never leaves: it
    calls itself until the stack is full, which ends the process.
    """
    if not 0 < size <= file.seek(0, 2) - offset:
        raise damaged(*_WITHIN)
    file.seek(offset)
    content = file.read(size)
    sizes, start = [size - point_size], point_size
    if n_layers:
        start += 4  # the number of points
        sizes = np.frombuffer(content[start : start + 4 * n_layers].ljust(4 * n_layers, b"\0"), "<u4").tolist()
        start += 4 * n_layers
    if sum(sizes) > size:
        raise damaged(*_WITHIN)
    for layer in sizes:
        if content[start : start + min(layer, 4)] == b"\xff" * 4:
            raise damaged("whole compressed points", "damaged ones")
        start += layer
    return content
