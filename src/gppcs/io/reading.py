"""Reads clouds from files, and takes clouds in any form."""

import inspect
import os
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, BinaryIO, TypeVar, cast

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.errors import ParameterError
from gppcs.io.cloud_files import CloudFiles

Function = TypeVar("Function", bound=Callable[..., Any])

OLD_NAMES = ("format", "columns", "inside", "only", "resolution", "assume_same_crs")


def taking_old_names(function: Function) -> Function:
    """Let a function of files take arguments that went to `gppcs.open`, with a warning, until release 0.3."""
    first, signature = next(iter(function.__annotations__)), inspect.signature(function)

    @wraps(function)
    def with_old_names(*arguments: Any, **options: Any) -> Any:
        if old := [name for name in OLD_NAMES if name in options and name not in function.__annotations__]:
            reading = {name: options.pop(name) for name in OLD_NAMES if name in options}
            bound = signature.bind(*arguments, **options)
            reading |= {name: bound.arguments.pop(name) for name in OLD_NAMES if name in bound.arguments}
            if isinstance(paths := bound.arguments[first], PointCloud | CloudFiles):
                actual = f"found a {type(paths).__name__}; choose points of a cloud in memory by cloud[mask]"
                raise ParameterError(f"expected `{old[0]}` where files are opened, by gppcs.open, {actual}")
            for name in old:
                instead = f"use gppcs.open(paths, {name}=...), which gppcs.{function.__name__} takes"
                warnings.warn(f"`{name}` is deprecated here: {instead}", DeprecationWarning, stacklevel=2)
            bound.arguments[first] = CloudFiles(paths, **reading)
            return function(*bound.args, **bound.kwargs)
        return function(*arguments, **options)

    return cast(Function, with_old_names)


@taking_old_names
def read(
    path: str | os.PathLike[str] | BinaryIO | Sequence[str | os.PathLike[str]] | CloudFiles,
    format: str | None = None,  # noqa: A002  # as NumPy and pandas say
    columns: Sequence[str] | None = None,
) -> PointCloud:
    """Read PLY, LAS, LAZ, COPC, XYZ, CSV, PTS, NPY, NPZ, OFF, OBJ, STL, glTF, PCD, PTX, E57, Parquet or Feather.

    The format is found by how the content begins, otherwise by the suffix of the name. Of mesh files, only the vertices
    are read. The scans of PTX and E57 files become one cloud, each moved by its pose.

    Parameters
    ----------
    path : path, binary file, sequence of paths or CloudFiles
        The file, or several that are one cloud. `gppcs.open(path, ...).read()` reads a part of the points.
    format, columns : optional
        As for `gppcs.open`: the suffix of the format, and the names of the columns of a text table.

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
    if not isinstance(path, CloudFiles):
        return CloudFiles(path, format, columns).read()
    if format is not None or columns is not None:
        raise ParameterError(
            "expected `format` and `columns` where files are opened, found opened ones; use gppcs.open"
        )
    return path.read()


def source_of(cloud: Any) -> CloudFiles | None:
    """Return files as they were opened or are named, by paths or open files; None for a cloud in memory."""
    if isinstance(cloud, CloudFiles):
        return cloud
    paths = cloud if isinstance(cloud, list | tuple) else [cloud]
    are_files = (isinstance(path, str | os.PathLike) or callable(getattr(path, "read", None)) for path in paths)
    return CloudFiles(paths) if paths and all(are_files) else None


def as_cloud(cloud: CloudLike) -> PointCloud:
    """Return the cloud of files, opened or named, or of whatever `PointCloud.from_object` takes."""
    source = source_of(cloud)
    return PointCloud.from_object(cloud) if source is None else source.read()
