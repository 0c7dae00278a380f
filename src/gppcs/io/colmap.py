"""Reads and writes the points of COLMAP, `points3D.txt` and `points3D.bin`: seeds of Gaussian splatting."""

from dataclasses import dataclass
from functools import partial
from io import BufferedReader
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import COLOUR, Column
from gppcs.clouds.header import Header
from gppcs.io.format import Format, begins, keeping, read_at_once
from gppcs.io.meshes import colours_of
from gppcs.io.rows import cast, damaged, is_row, lines_of, read_table, write_rows

ID, ERROR, LENGTH = "point3D_id", "error", "track_length"
TITLE = "# 3D point list with one line of data per point:"
# A point of the binary file. As many records of 8 bytes follow it as there are images in its track.
RECORD = np.dtype([("id", "<u8"), ("position", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("track", "<u8")])


@dataclass(frozen=True)
class ColmapHeader(Header):
    """The points of a COLMAP file have tracks, the images that see each."""

    def contents(self) -> list[str]:
        """Return in words that tracks are left out."""
        return ["the tracks of the points, so that COLMAP's images no longer fit"]


def _read_text(file: BufferedReader) -> tuple[PointCloud, list[str]]:
    """Return the points of a text file."""
    lengths: list[int] = []

    def without_track(line: str) -> str:
        fields = line.split()
        if is_row(line):
            lengths.append((len(fields) - 8) // 2)
        return " ".join(fields[:8]) + "\n"

    columns = read_table(map(without_track, lines_of(file)), 8)
    return _cloud([*columns, np.array(lengths, np.int64)]), []


def _read_binary(file: BufferedReader) -> tuple[PointCloud, list[str]]:
    """Return the points of a binary file."""
    data, at = file.read(), 8
    count, parts = int.from_bytes(data[:8], "little"), list[bytes]()
    while at + RECORD.itemsize <= len(data) and len(parts) < count:
        parts.append(data[at : at + RECORD.itemsize])
        at += RECORD.itemsize + 8 * int.from_bytes(parts[-1][-8:], "little")
    if len(parts) < count or at != len(data):
        filled = f"{count:,} points of COLMAP to fill the file of {len(data):,} bytes"
        raise damaged(filled, f"{len(parts):,} that end at byte {at:,}", "export the model again")
    records = np.frombuffer(b"".join(parts), RECORD)
    colours = records["colour"].T
    return _cloud([records["id"], *records["position"].T, *colours, records["error"], records["track"]]), []


def _cloud(columns: list[Column]) -> PointCloud:
    """Return a cloud of the columns of a file, the last of which is the number of images that see each point."""
    ids, *values, errors, lengths = columns
    attributes = {ID: cast(ids, np.dtype(np.int64), "a whole number as POINT3D_ID of point")}
    for name, channel in zip(COLOUR, values[3:], strict=True):
        attributes[name] = cast(channel, np.dtype(np.uint8), f"0 to 255 as {name} of point")
    attributes[ERROR] = errors.astype(np.float64)
    if not lengths.any():
        return PointCloud(np.stack(values[:3], axis=1), attributes)
    attributes[LENGTH] = lengths.astype(np.int64)
    return PointCloud(np.stack(values[:3], axis=1), attributes, header=ColmapHeader())


def write_colmap_text(file: BinaryIO, cloud: PointCloud) -> None:
    """Write points with colours as text, each without a track."""
    ids, colours, errors = _columns(cloud)
    file.write(f"{TITLE}\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n".encode())
    file.write(f"# Number of points: {len(cloud)}, mean track length: 0\n".encode())
    write_rows(file, [ids, *cloud.points.T, *colours.T, errors])


def write_colmap_binary(file: BinaryIO, cloud: PointCloud) -> None:
    """Write points with colours in binary, each without a track."""
    records = np.zeros(len(cloud), RECORD)
    records["id"], records["colour"], records["error"] = _columns(cloud)
    records["position"] = cloud.points
    file.write(len(cloud).to_bytes(8, "little") + records.tobytes())


def _columns(cloud: PointCloud) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return numbers, colours and errors of points; where there are none: from 1 on, black, and -1 for unknown."""
    colours = colours_of(cloud)
    return (
        cloud.attributes.get(ID, np.arange(1, len(cloud) + 1)),
        np.zeros((len(cloud), 3), np.uint8) if colours is None else colours,
        cloud.attributes.get(ERROR, np.full(len(cloud), -1.0)),
    )


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud with the attributes that COLMAP has; what is written has no tracks."""
    names = {ID, ERROR, LENGTH, *(COLOUR if cloud.attributes.keys() >= set(COLOUR) else ())}

    def holds(name: str, values: NDArray[Any]) -> bool:
        if name not in names or values.ndim > 1 or values.dtype.kind not in "biuf":
            return False
        is_id = values.dtype.kind in "iu" and len(np.unique(values)) == len(values) and not (values < 0).any()
        return name != ID or is_id

    return keeping(cloud, holds)


FORMATS = (
    Format(
        "COLMAP text",
        (".points3d.txt",),
        partial(read_at_once, read=_read_text),
        write_colmap_text,
        begins(TITLE.encode()),
        _stored,
    ),
    Format(
        "COLMAP binary",
        (".points3d.bin",),
        partial(read_at_once, read=_read_binary),
        write_colmap_binary,
        stored=_stored,  # there is nothing to recognise it by
    ),
)
