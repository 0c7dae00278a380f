"""Reads and writes the points of COLMAP, `points3D.txt` and `points3D.bin`: seeds of Gaussian splatting."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from io import SEEK_END, BufferedReader
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.objects import COLOUR
from gppcs.errors import FileFormatError
from gppcs.io.format import Format, Reader, from_start, keeping
from gppcs.io.meshes import colours_of
from gppcs.io.rows import lines_of, read_rows, write_rows

ID, ERROR = "point3D_id", "error"
NO_ERROR = -1.0  # as COLMAP says it
TITLE = "# 3D point list with one line of data per point:"  # begins the text files of COLMAP
LINES = f"{TITLE}\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
WORDS = 8  # of a line before its track
COUNT = np.dtype("<u8")
RECORD = np.dtype([("id", "<u8"), ("place", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("track", "<u8")])
MOST = 2**53  # Larger numbers and coordinates than this are no points of COLMAP.
TRACKS = "the tracks of the points"
TRACK = 8  # bytes of each image in which a point is seen


def read_colmap_text(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read the points of a text file, without their tracks."""
    for columns in read_rows(map(_before_track, lines_of(file)), WORDS):
        yield _cloud(columns[0], np.stack(columns[1:4], axis=1), np.stack(columns[4:7], axis=1), columns[7])


def _before_track(line: str) -> str:
    return " ".join(line.split(None, WORDS)[:WORDS]) + "\n"


def read_colmap_binary(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read the points of a binary file, without their tracks."""
    data = np.frombuffer(file.read(), dtype=np.uint8)
    starts = _starts(data)
    some = data[starts[:, np.newaxis] + np.arange(RECORD.itemsize)].reshape(-1).view(RECORD)
    yield _cloud(some["id"].astype(np.int64), some["place"], some["colour"], some["error"])


def _starts(data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return where the records of the points begin, (N,)."""
    size, at = len(data), COUNT.itemsize
    if size < at:
        raise FileFormatError(f"expected the number of points of COLMAP in 8 bytes, found {size}")
    count = int(data[:at].view(COUNT)[0])
    starts: list[int] = []
    tracks = data.data
    while at + RECORD.itemsize <= size and len(starts) < count:
        starts.append(at)
        at += RECORD.itemsize
        at += TRACK * int.from_bytes(tracks[at - COUNT.itemsize : at], "little")
    if len(starts) < count or at != size:
        raise FileFormatError(
            f"expected {count:,} points of COLMAP to fill the file of {size:,} bytes, found {len(starts):,} that end "
            f"at byte {at:,}; is it a points3D.bin, and whole?"
        )
    return np.array(starts, dtype=np.int64)


def _cloud(ids: NDArray[Any], places: NDArray[Any], colours: NDArray[Any], errors: NDArray[Any]) -> PointCloud:
    """Return a cloud of what a file says."""
    if "f" in (ids.dtype.kind, colours.dtype.kind):
        raise FileFormatError("expected whole numbers as POINT3D_ID, R, G and B, found fractions or numbers too large")
    if ((colours < 0) | (colours > 255)).any():
        raise FileFormatError(f"expected colours from 0 to 255, found {colours.min():g} to {colours.max():g}")
    channels = dict(zip(COLOUR, colours.astype(np.uint8).T.copy(), strict=True))
    return PointCloud(places, {ID: ids.astype(np.int64), **channels, ERROR: errors.astype(np.float64)})


def write_colmap_text(file: BinaryIO, cloud: PointCloud) -> None:
    """Write points with colours as text, each without a track."""
    ids, colours, errors = _columns(cloud)
    file.write(f"{LINES}# Number of points: {len(cloud)}, mean track length: 0\n".encode())
    write_rows(file, [ids, *cloud.points.T, *colours.T, errors])


def write_colmap_binary(file: BinaryIO, cloud: PointCloud) -> None:
    """Write points with colours in binary, each without a track."""
    records = np.zeros(len(cloud), RECORD)
    records["id"], records["colour"], records["error"] = _columns(cloud)
    records["place"] = cloud.points
    file.write(np.array(len(cloud), COUNT).tobytes())
    file.write(records.tobytes())


def _columns(cloud: PointCloud) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return numbers, colours and errors of points; where there are none: from 1 on, black and unknown."""
    colours = colours_of(cloud)
    return (
        cloud.attributes.get(ID, np.arange(1, len(cloud) + 1)),
        np.zeros((len(cloud), 3), np.uint8) if colours is None else colours,
        cloud.attributes.get(ERROR, np.full(len(cloud), NO_ERROR)),
    )


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud with the attributes that COLMAP has."""
    has_colours = set(COLOUR) <= set(cloud.attributes)

    def held(name: str, values: NDArray[Any]) -> bool:
        if values.ndim > 1 or values.dtype.kind not in "biuf":
            return False
        if name == ID:
            return values.dtype.kind in "iu" and len(np.unique(values)) == len(values) and not (values < 0).any()
        return name == ERROR or (name in COLOUR and has_colours)

    return keeping(cloud, held)


def _is_binary(head: bytes, size: int) -> bool:
    """Return whether a file is long enough for the number of points that it begins with, and these look like points."""
    count, at, end = int.from_bytes(head[: COUNT.itemsize], "little"), COUNT.itemsize, len(head) - RECORD.itemsize
    if not 0 < count <= (size - COUNT.itemsize) // RECORD.itemsize or end < at:
        return False
    while at <= end and count:
        record = np.frombuffer(head, RECORD, 1, at)[0]
        if record["id"] > MOST or record["track"] > size or not (np.abs(record["place"]) < MOST).all():
            return False
        at, count = at + RECORD.itemsize + TRACK * int(record["track"]), count - 1
    return at <= size


def _unread_text(file: BufferedReader) -> list[str]:
    """Return in words what is not read of a text file."""
    lines = (line.split(None, WORDS) for line in lines_of(file) if not line.lstrip().startswith("#"))
    return [TRACKS] if any(len(words) > WORDS for words in lines) else []


def _unread_binary(file: BufferedReader) -> list[str]:
    """Return in words what is not read of a binary file."""
    head = file.read(COUNT.itemsize)
    size = file.seek(0, SEEK_END)
    return [TRACKS] if size > COUNT.itemsize + RECORD.itemsize * int.from_bytes(head, "little") else []


def open_colmap_text(file: BufferedReader) -> Reader:
    """Open a text file."""
    return Reader(
        partial(from_start, read_colmap_text, file), at_once=True, skipped=partial(from_start, _unread_text, file)
    )


def open_colmap_binary(file: BufferedReader) -> Reader:
    """Open a binary file."""
    return Reader(
        partial(from_start, read_colmap_binary, file), at_once=True, skipped=partial(from_start, _unread_binary, file)
    )


FORMATS = (
    Format(
        "COLMAP text",
        (".points3d.txt",),
        open_colmap_text,
        write_colmap_text,
        lambda start, size: start.startswith(TITLE.encode()),
        _stored,
    ),
    Format("COLMAP binary", (".points3d.bin",), open_colmap_binary, write_colmap_binary, _is_binary, _stored),
)
