"""Reads a cloud from a file, or from the files that a virtual point cloud lists."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from typing import NamedTuple

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.errors import FileFormatError
from gppcs.io.cloud_files import open_clouds
from gppcs.io.format import Format
from gppcs.io.query import Query


def as_cloud(cloud: CloudLike) -> PointCloud:
    """Return the cloud of a file, if it is a path, or of whatever `PointCloud.from_object` takes."""
    return read(cloud) if isinstance(cloud, str | os.PathLike) else PointCloud.from_object(cloud)


def read(
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002 - as numpy, pandas say
    columns: Sequence[str] | None = None,
    box: Sequence[float] | None = None,
    resolution: float | None = None,
    only: str | None = None,
    polygon: str | os.PathLike[str] | None = None,
    assume_same_crs: bool = False,
) -> PointCloud:
    """Read PLY, LAS, LAZ, COPC, XYZ, CSV, PTS, NPY, NPZ, OFF, OBJ, STL, glTF, PCD, PTX, E57, Parquet or Feather.

    The format is found by how the content begins, otherwise by the suffix of the name. Of mesh files, only the vertices
    are read. The scans of PTX and E57 files become one cloud, each moved by its pose. The files that a virtual point
    cloud (.vpc) lists become one cloud, too, in the order of the list; they must have the same attributes.

    Parameters
    ----------
    path : str or path
        The file, or a virtual point cloud. A gzip or Zstandard file is decompressed; `-` is standard input.
    format : str, optional
        Suffix of the format, such as "ply" or ".ply". It overrides content and name.
    columns : sequence of str, optional
        The name of each column of a text table, with x, y and z. They replace any names in the file.
    box : sequence of 4 or 6 float, optional
        Read only the points in the box xmin, ymin, xmax, ymax or xmin, ymin, zmin, xmax, ymax, zmax, border included.
        A side is open if its limit is infinite.
        Of a COPC file, only the parts that meet the box are decompressed.
    resolution : float, optional
        Read a COPC file only down to the level on which neighbours are about that far from each other, in the unit of
        the coordinates.
    only : str, optional
        Read only the points that meet a condition on attributes and x, y and z, such as "classification == 6"
        (docs/ask.md#conditions).
    polygon : str or path, optional
        Read only the points inside the polygons of a GeoJSON file, in the coordinate system of the cloud.
    assume_same_crs : bool
        Whether all files of a virtual point cloud get the coordinate system of the first one. Otherwise, files with
        different coordinate systems are an error.

    Returns
    -------
    PointCloud
        N points with their attributes, both in file order. NaN and infinite coordinates are kept.

    Raises
    ------
    FileFormatError
        If the format is unknown, the content does not follow it, `resolution` is given and the file is not COPC, a
        condition names an attribute that the cloud has not, `polygon` is no GeoJSON, or the files of a virtual point
        cloud do not fit each other.
    ParameterError
        If `path` is neither text nor a path, `format` is no text, `columns` are not different names with x, y and z,
        or `box`, `resolution` or `assume_same_crs` is not as above, or a condition cannot be read.
    MissingExtraError
        If the format needs a package that is not installed (E57, Parquet, Feather).
    OSError
        If the file does not exist or cannot be read.

    Examples
    --------
    >>> gppcs.write("scan.csv", gppcs.PointCloud([[0, 0, 0], [1, 2, 3]], {"intensity": [7, 9]}))
    >>> cloud = gppcs.read("scan.csv")
    >>> cloud
    PointCloud(2 points, each with intensity)
    """
    query = Query.of(box, resolution, only, polygon)
    with open_clouds([path], format, columns, query, assume_same_crs) as files:
        return files.read()


class Loaded(NamedTuple):
    """What `load` has read, and what it has not."""

    cloud: PointCloud
    faces: int  # a file with faces is a mesh
    unread: list[str]  # what the file has and the cloud does not hold, in words, faces included


def load(
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002
    columns: Sequence[str] | None = None,
    query: Query | None = None,
    assume_same_crs: bool = False,
) -> Loaded:
    """Read a point cloud file as `read` does, and tell what is left out."""
    with open_clouds([path], format, columns, query, assume_same_crs) as files:
        return Loaded(files.read(), files.n_faces, files.skipped())


def read_each(
    paths: Sequence[str | os.PathLike[str]],
    format: str | None = None,  # noqa: A002
    columns: Sequence[str] | None = None,
) -> list[tuple[PointCloud, int]]:
    """Read clouds, each with its number of faces, that a command puts side by side; only some need a format."""
    several = len(paths) > 1
    with ExitStack() as stack:
        each = [stack.enter_context(open_clouds([path], format, columns, if_needed=several)) for path in paths]
        if several:
            _check_needed([known for files in each for known in files.formats()], format, columns)
        return [(files.read(), files.n_faces) for files in each]


def _check_needed(found: list[Format], format: str | None, columns: Sequence[str] | None) -> None:  # noqa: A002
    """Raise an error if a format or names of columns are given and no file needs them."""
    names = " and ".join(dict.fromkeys(known.name for known in found))
    if format is not None and not any(known.has_suffix(format) for known in found):
        raise FileFormatError(f"expected a file of the format {format}, found {names}")
    if columns is not None and not any("columns" in known.options for known in found):
        raise FileFormatError(f"expected a text table, whose columns can be named, found {names}")
