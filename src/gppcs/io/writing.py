"""Writes cloud files."""

import os
import tempfile
from pathlib import Path
from typing import BinaryIO

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.errors import flag
from gppcs.io.files import format_to_write
from gppcs.io.format import Format
from gppcs.io.reading import as_cloud
from gppcs.io.streams import whole_output


def write(
    path: str | os.PathLike[str],
    cloud: CloudLike,
    format: str | None = None,  # noqa: A002
    force: bool = False,
    lossy: bool = False,
    ascii: bool | None = None,  # noqa: A002
    levels_by: str | None = None,
) -> None:
    """Write a cloud: PLY, LAS, LAZ, COPC, XYZ, CSV, PTS, NPY, NPZ, OFF, OBJ, PCD, E57, Parquet or Feather.

    The file appears under its name only when it is complete. Coordinates are written in the cloud's
    `coordinate_dtype`, attributes in their own types if the format has these.

    Parameters
    ----------
    path : str or path
        The file. Its suffix selects the format; a further suffix .gz compresses it. `-` is standard output.
    cloud : PointCloud, (N, 3) array-like, path or object of another library
        The points and their attributes.
    format : str, optional
        Suffix of the format, such as "ply" or ".ply". It overrides the suffix of `path`.
    force : bool
        Whether to overwrite an existing file.
    lossy : bool
        Whether to leave out values that the format cannot hold: attributes, and the precision of coordinates. What a
        file says of the whole cloud, such as comments, is left out where the format has no place for it.
    ascii : bool, optional
        Whether to write PLY and PCD as text. By default, they are binary.
    levels_by : str, optional
        Which points are on the coarse levels of a COPC file: "order" takes the first ones of the cloud, "even" spreads
        them over all points. The default is "order" for a `Result` whose points are ranked, the order of an attribute
        `rank` if that numbers the points, and otherwise "even".

    Raises
    ------
    FileFormatError
        If the format is unknown or only read (STL, PTX), or it has no choice of `ascii` or `levels_by`.
    OutputError
        If the file exists and `force` is False, it cannot be made, or it cannot hold the cloud and `lossy` is False.
    MissingExtraError
        If the format needs a package that is not installed (E57, Parquet, Feather).
    InputError, ParameterError
        If an argument has a wrong type.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=100)
    >>> gppcs.write("sphere.ply", cloud)
    >>> len(gppcs.read("sphere.ply"))
    100
    """
    chosen = format_to_write(path, format, ascii, levels_by)
    is_ranked = levels_by is None and getattr(cloud, "ranked", False) is True
    store(path, as_cloud(cloud), chosen.ranked() if is_ranked else chosen, force, lossy)


def store(path: str | os.PathLike[str], cloud: PointCloud, chosen: Format, force: bool, lossy: bool) -> list[str]:
    """Write a file of a format, and return in words what it does not hold of the cloud."""
    with whole_output(path, flag("force", force)) as file:
        return store_in(file, path, cloud, chosen, flag("lossy", lossy))


def store_in(file: BinaryIO, path: str | os.PathLike[str], cloud: PointCloud, chosen: Format, lossy: bool) -> list[str]:
    """Write a cloud to a file that is open under its name, and return in words what the format does not hold."""
    fit = chosen.fit(cloud, path, lossy)
    assert chosen.write is not None
    chosen.write(file, fit.cloud)
    return [*fit.values, *fit.remarks]


def check_storable(path: Path, cloud: PointCloud, chosen: Format, lossy: bool) -> None:
    """Check before long work that `store` can write a cloud: write one of its points to a temporary file."""
    fit = chosen.fit(cloud, path, lossy)
    with tempfile.TemporaryFile() as trial:
        assert chosen.write is not None
        chosen.write(trial, fit.cloud[:1])
