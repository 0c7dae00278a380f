"""Reads and writes cloud files: chooses the format by content or suffix.

To add a format, write a module with a `Format` and add it to `FORMATS`.
"""

from __future__ import annotations

import os
from io import BufferedReader
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, InputError, OutputError, ParameterError, file_path, flag, shown
from gppcs.io import arrays, meshes, ply, text
from gppcs.io.format import Format
from gppcs.io.whole_file import whole_file

_HEAD = 1024

FORMATS: tuple[Format, ...] = (
    ply.FORMAT,
    *text.FORMATS,
    *arrays.FORMATS,
    *meshes.FORMATS,
)


def read(path: str | os.PathLike[str], format: str | None = None) -> PointCloud:  # noqa: A002 - as numpy, pandas say
    """Read a point cloud file: PLY, XYZ, TXT, ASC, CSV, PTS, NPY, NPZ, OFF, OBJ or STL.

    The format is found by a signature in the content (PLY, NPY, NPZ, OFF, STL), otherwise by the suffix of the name. Of
    mesh files, only the vertices are read.

    Parameters
    ----------
    path : str or path
        The file.
    format : str, optional
        Suffix of the format, such as "ply" or ".ply". It overrides content and name.

    Returns
    -------
    PointCloud
        N points with their attributes, both in file order. NaN and infinite coordinates are kept.

    Raises
    ------
    FileFormatError
        If the format is unknown, or the content does not follow it.
    ParameterError
        If `path` is neither text nor a path, or `format` is no text.
    OSError
        If the file does not exist or cannot be read.

    Examples
    --------
    >>> gppcs.write("scan.csv", gppcs.PointCloud([[0, 0, 0], [1, 2, 3]], {"intensity": [7, 9]}))
    >>> cloud = gppcs.read("scan.csv")
    >>> cloud
    PointCloud(2 points, each with intensity)
    """
    source = file_path(path)
    _require_text(format)
    if source.exists() and not source.is_file():
        raise FileFormatError(f"{source}: expected a file, found a folder or device; name a file")
    with open(source, "rb") as file:
        chosen = _of_suffix(format) if format else _of_file(file, source)
        try:
            with np.errstate(invalid="ignore"):  # converting a signalling NaN is no error
                return chosen.read(file)
        except (FileFormatError, InputError) as error:
            raise FileFormatError(f"{source}: {error}") from error


def unread(path: str | os.PathLike[str]) -> list[str]:
    """Return in words what `read` leaves out of a file, such as the faces of a mesh.

    Parameters
    ----------
    path : str or path
        The file that `read` has read.

    Returns
    -------
    list of str
    """
    with open(path, "rb") as file:
        return _of_file(file, Path(path)).unread(file)


def losses(path: str | os.PathLike[str], cloud: PointCloud, format: str | None = None) -> list[str]:  # noqa: A002
    """Return in words what a file cannot hold of a cloud. `write` leaves it out only if `lossy` is True.

    Parameters
    ----------
    path : str or path
        The file to be written.
    cloud : PointCloud
        The points with their attributes.
    format : str, optional
        Suffix of the format. It overrides the suffix of `path`.

    Returns
    -------
    list of str
        Attributes, what the header says, and the precision of coordinates, as far as they are lost.
    """
    return format_to_write(path, format).fitted(cloud)[1]


def check_losses(path: str | os.PathLike[str], cloud: PointCloud, format: str | None = None) -> None:  # noqa: A002
    """Check that a file can hold all of a cloud. Call it before long work.

    Parameters
    ----------
    path, cloud, format
        As for `losses`.

    Raises
    ------
    OutputError
        If something would be lost.
    """
    if lost := losses(path, cloud, format):
        raise OutputError(
            f"{path}: expected a format that holds all of the cloud, but {format_to_write(path, format).name} cannot "
            f"hold: {', '.join(lost)}; choose another format, or leave this out with --lossy (lossy=True)"
        )


def write(
    path: str | os.PathLike[str],
    cloud: PointCloud | ArrayLike,
    format: str | None = None,  # noqa: A002
    force: bool = False,
    lossy: bool = False,
) -> None:
    """Write a point cloud file: PLY, XYZ, TXT, ASC, CSV, PTS, NPY, NPZ, OFF or OBJ.

    The file appears under its name only when it is complete. Coordinates are written in the cloud's
    `coordinate_dtype`, attributes in their own types if the format has these.

    Parameters
    ----------
    path : str or path
        The file. Its suffix selects the format.
    cloud : PointCloud or (N, 3) array-like
        The points and their attributes.
    format : str, optional
        Suffix of the format, such as "ply" or ".ply". It overrides the suffix of `path`.
    force : bool
        Whether to overwrite an existing file.
    lossy : bool
        Whether to leave out what the format cannot hold. OFF and OBJ files, for instance, hold no attributes.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs only reads it (STL).
    OutputError
        If the file exists and `force` is False, the folder is missing or not writable, the format cannot hold all of
        the cloud and `lossy` is False, or it cannot hold its points.
    InputError, ParameterError
        If an argument has a wrong type.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=100)
    >>> gppcs.write("sphere.ply", cloud)
    >>> len(gppcs.read("sphere.ply"))
    100
    """
    cloud, force = PointCloud.of(cloud), flag("force", force)
    chosen = format_to_write(path, format)
    if not flag("lossy", lossy):
        check_losses(path, cloud, format)
    fitted = chosen.fitted(cloud)[0]
    with whole_file(path, force) as file:
        assert chosen.write is not None
        chosen.write(file, fitted)


def format_to_write(path: str | os.PathLike[str], format: str | None = None) -> Format:  # noqa: A002
    """Return the format that `write` would use. Call it before long work, to find a bad choice early.

    Parameters
    ----------
    path : str or path
        The file to be written.
    format : str, optional
        Suffix of the format. It overrides the suffix of `path`.

    Returns
    -------
    Format
        A format with a `write` function.

    Raises
    ------
    FileFormatError
        If the format is unknown, or gppcs only reads it.
    """
    _require_text(format)
    chosen = _of_suffix(format) if format else _of_path(file_path(path))
    if chosen.write is None:
        raise FileFormatError(
            f"{path}: expected a format that holds points, found {chosen.name}; choose one of {_listed(writable=True)}"
        )
    return chosen


def _of_file(file: BufferedReader, path: Path) -> Format:
    """Return the format of a file by its content or else its name; leave the file at its start."""
    head, size = file.read(_HEAD), os.fstat(file.fileno()).st_size
    file.seek(0)
    return next((known for known in FORMATS if known.recognises(head, size)), None) or _of_path(path)


def _require_text(suffix: str | None) -> None:
    if not isinstance(suffix, str | None):
        raise ParameterError(f"expected the suffix of a format, such as 'ply', found {shown(suffix)}")


def _of_path(path: Path) -> Format:
    try:
        return _of_suffix(path.suffix)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _of_suffix(suffix: str) -> Format:
    wanted = "." + suffix.lower().removeprefix(".")
    for known in FORMATS:
        if wanted in known.suffixes:
            return known
    raise FileFormatError(f"expected one of the formats {_listed()}, found {suffix or 'no suffix'!r}")


def _listed(writable: bool = False) -> str:
    return " ".join(suffix for known in FORMATS for suffix in known.suffixes if known.write or not writable)
