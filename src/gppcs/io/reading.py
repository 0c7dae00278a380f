"""Reads clouds from files, and takes clouds in any form."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, BinaryIO

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.io.cloud_files import CloudFiles


def read(
    path: str | os.PathLike[str] | BinaryIO,
    format: str | None = None,  # noqa: A002 - as numpy, pandas say
    columns: Sequence[str] | None = None,
    inside: Any = None,
    only: str | None = None,
    resolution: float | None = None,
    assume_same_crs: bool = False,
) -> PointCloud:
    """Read PLY, LAS, LAZ, COPC, XYZ, CSV, PTS, NPY, NPZ, OFF, OBJ, STL, glTF, PCD, PTX, E57, Parquet or Feather.

    The format is found by how the content begins, otherwise by the suffix of the name. Of mesh files, only the vertices
    are read. The scans of PTX and E57 files become one cloud, each moved by its pose.

    Parameters
    ----------
    path : str, path or binary file
        The file, its address on a server such as https:// or s3:// (with the extra `remote`; of COPC files, only what
        `inside` and `resolution` ask for is fetched), or an open file. A gzip file is decompressed; `-` is standard
        input. The files that a virtual point cloud (.vpc) lists become one cloud; they must have the same attributes.
    format : str, optional
        Suffix of the format, such as "ply" or "kitti", if neither content nor name tell it.
    columns : sequence of str, optional
        The name of each column of a text table, with x, y and z. They replace any names in the file.
    inside : sequence of 4 or 6 float, path, (n, 2) array, or list of these, optional
        Read only the points in the box xmin, ymin, xmax, ymax or xmin, ymin, zmin, xmax, ymax, zmax, border included;
        a side is open if its limit is infinite. Or those inside the polygons of a GeoJSON file, in the coordinate
        system of the cloud, or inside a polygon with these corners. Of a list of texts or paths: those inside of all.
    only : str, optional
        Read only the points that meet a condition on attributes and x, y and z, such as "classification == 6"
        (docs/ask.md#conditions).
    resolution : float, optional
        Read a COPC file down to the level on which neighbours are about that far from each other.
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
        If the format is unknown or another, or the content does not follow it or has not what is asked for.
    ParameterError
        If an argument is not as above.
    MissingExtraError
        If the format or the server needs a package that is not installed.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> gppcs.write("scan.csv", gppcs.PointCloud([[0, 0, 0], [1, 2, 3]], {"intensity": [7, 9]}))
    >>> cloud = gppcs.read("scan.csv")
    >>> cloud
    PointCloud(2 points, each with intensity)
    """
    with CloudFiles([path], format, columns, inside, only, resolution, assume_same_crs) as files:
        return files.read()


def as_cloud(cloud: CloudLike) -> PointCloud:
    """Return the cloud of a file, if it is a path, or of whatever `PointCloud.from_object` takes."""
    return read(cloud) if isinstance(cloud, str | os.PathLike) else PointCloud.from_object(cloud)
