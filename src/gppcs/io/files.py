"""Files by name: which format one has, reading it, writing it.

A new format is one module with a `Format` and one line in `FORMATS`.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, InputError
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
    """Read a point cloud.

    The content decides what format the file has, where it carries a mark (PLY, NPY, NPZ, OFF, STL); otherwise
    the suffix of its name does.

    Parameters
    ----------
    path : path
        The file.
    format : str, optional
        Suffix of the format, as "ply" or ".ply", to be used whatever content and name say.

    Returns
    -------
    PointCloud
        N points with their attributes in file order. Coordinates that are not finite are kept as they are.

    Raises
    ------
    FileFormatError
        If the format is unknown, or the content is not what it promises.
    OSError
        If there is no such file, or it cannot be read.
    """
    source = Path(path)
    if source.exists() and not source.is_file():
        raise FileFormatError(f"{source}: expected a file, found a folder or device; name a file")
    with open(source, "rb") as file:
        head = file.read(_HEAD)
        file.seek(0)
        chosen = _of_suffix(format) if format else _of_content(head, source.stat().st_size) or _of_path(source)
        try:
            with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any
                return chosen.read(file)
        except (FileFormatError, InputError) as error:
            raise FileFormatError(f"{source}: {error}") from error


def write(
    path: str | os.PathLike[str],
    cloud: PointCloud,
    format: str | None = None,  # noqa: A002
    force: bool = False,
) -> None:
    """Write a point cloud; the file appears under its name only when it is whole.

    Coordinates are written in the cloud's `coordinate_dtype`, attributes in their own types as far as the
    format has these. OFF and OBJ files hold the points only.

    Parameters
    ----------
    path : path
        The file; the suffix gives the format.
    cloud : PointCloud
        The points and their attributes.
    format : str, optional
        Suffix of the format, as "ply" or ".ply", to be used whatever the name says.
    force : bool
        Whether a file that exists may be overwritten.

    Raises
    ------
    FileFormatError
        If the format is unknown or cannot hold points.
    OutputError
        If the file exists and `force` is not given, its folder is missing, or the format cannot hold the
        cloud.
    """
    chosen = format_to_write(path, format)
    with whole_file(path, force) as file:
        assert chosen.write is not None
        chosen.write(file, cloud)


def format_to_write(path: str | os.PathLike[str], format: str | None = None) -> Format:  # noqa: A002
    """Return the format that `write` would use, so that a bad choice shows before any work is done.

    Parameters
    ----------
    path : path
        The file to be written.
    format : str, optional
        Suffix of the format, to be used whatever the name says.

    Raises
    ------
    FileFormatError
        If the format is unknown or cannot hold points.
    """
    chosen = _of_suffix(format) if format else _of_path(Path(path))
    if chosen.write is None:
        raise FileFormatError(
            f"{path}: expected a format that holds points, found {chosen.name}; choose one of {_listed(writable=True)}"
        )
    return chosen


def _of_content(head: bytes, size: int) -> Format | None:
    return next((known for known in FORMATS if known.recognises(head, size)), None)


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
