"""Writes cloud files, and chooses the format of all by content or suffix.

To add a format, write a module with a `Format` and add it to `FORMATS`.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.errors import FileFormatError, InputError, OutputError, ParameterError, file_path, flag, one_of, shown
from gppcs.io import arrays, arrow, colmap, copc_writing, e57, las, meshes, pcd, ply, ptx, text
from gppcs.io.format import Format
from gppcs.io.streams import inner_name, suffix_in_words, whole_output
from gppcs.io.whole_file import is_standard

FORMATS: tuple[Format, ...] = (
    ply.FORMAT,
    copc_writing.FORMAT,  # before LAZ, of which it is a kind
    *las.FORMATS,
    *colmap.FORMATS,  # before text, of which it is a kind
    *text.FORMATS,
    *arrays.FORMATS,
    *meshes.FORMATS,
    pcd.FORMAT,
    ptx.FORMAT,
    e57.FORMAT,
    *arrow.FORMATS,
)


def check_input(path: Path) -> None:
    """Check that a path is not something else than a file. That there is one is found when it is opened."""
    if path.exists() and not path.is_file():
        raise FileFormatError(f"{path}: expected a file, found a folder or device; name a file")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Begin the messages of errors about the content of a file with its name."""
    try:
        yield
    except (FileFormatError, InputError) as error:
        name = "standard input" if is_standard(path) else path
        raise FileFormatError(f"{name}: {error}") from error


def checked_columns(columns: Sequence[str]) -> list[str]:
    """Return names of columns after checking that they are different and that x, y and z are among them."""
    try:
        names = [] if isinstance(columns, str) else list(columns)
    except TypeError:
        names = []
    if not all(isinstance(name, str) and name for name in names) or not {"x", "y", "z"} <= set(names):
        raise ParameterError(
            f"expected names of columns with x, y and z, such as x, y, z, red, green, blue, found {shown(columns)}"
        )
    if len(set(names)) < len(names):
        raise ParameterError(f"expected different names of columns, found {shown(columns)}")
    return names


def losses(path: str | os.PathLike[str], cloud: PointCloud, format: str | None = None) -> list[str]:  # noqa: A002
    """Return in words what a file cannot hold of a cloud. `write` leaves out values only if `lossy` is True."""
    fit = format_to_write(path, format).fit(cloud)
    return [*fit.values, *fit.remarks]


def check_storable(path: Path, cloud: PointCloud, format: str | None, lossy: bool) -> None:  # noqa: A002
    """Check before long work that `write` can write a cloud: write one of its points to a temporary file."""
    chosen = format_to_write(path, format)
    fit = chosen.fit(cloud)
    if not lossy:
        refuse_losses(path, chosen.name, fit.values)
    with tempfile.TemporaryFile() as trial:
        assert chosen.write is not None
        chosen.write(trial, fit.cloud[:1])


def refuse_losses(path: str | os.PathLike[str], name: str, lost: list[str]) -> None:
    """Raise an error if a format of a name cannot hold some values, given in words."""
    if lost:
        raise OutputError(
            f"{path}: expected a format that holds all of the cloud, but {name} cannot hold: {', '.join(lost)}; choose "
            "another format, or leave this out with lossy"
        )


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
        The file. Its suffix selects the format; a further suffix .gz or .zst compresses it. `-` is standard output.
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        The points and their attributes.
    format : str, optional
        Suffix of the format, such as "ply" or ".ply". It overrides the suffix of `path`.
    force : bool
        Whether to overwrite an existing file.
    lossy : bool
        Whether to leave out values that the format cannot hold: attributes, and the precision of coordinates. What a
        file says of the whole cloud, such as comments, is left out where the format has no place for it.
    ascii : bool, optional
        Whether to write PLY and PCD as text, or else as binary data. By default, a cloud that was read from PCD as text
        is written as such again; all others are binary. Other formats have no such choice.
    levels_by : str, optional
        Which points are on the coarse levels of a COPC file: "order", the default, takes the first ones of the cloud,
        such as those that `simplify` has chosen first; "random" takes random ones.

    Raises
    ------
    FileFormatError
        If the format is unknown, gppcs only reads it (STL, PTX), or it leaves no choice and `ascii` or `levels_by` is
        given.
    OutputError
        If the file exists and `force` is False, the folder is missing or not writable, the format cannot hold all
        values of the cloud and `lossy` is False, or it cannot hold its points.
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
    store(path, cloud, format, force, lossy, ascii, levels_by)


def store(
    path: str | os.PathLike[str],
    cloud: CloudLike,
    format: str | None = None,  # noqa: A002
    force: bool = False,
    lossy: bool = False,
    ascii: bool | None = None,  # noqa: A002
    levels_by: str | None = None,
) -> list[str]:
    """Write a point cloud file as `write` does, and return in words what the file does not hold of the cloud."""
    from gppcs.io.reading import as_cloud

    cloud, force = as_cloud(cloud), flag("force", force)
    chosen = format_to_write(path, format, ascii, levels_by)
    fit = chosen.fit(cloud)
    if not flag("lossy", lossy):
        refuse_losses(path, chosen.name, fit.values)
    with whole_output(path, force) as file:
        assert chosen.write is not None
        chosen.write(file, fit.cloud)
    return [*fit.values, *fit.remarks]


def format_to_write(
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002
    ascii: bool | None = None,  # noqa: A002
    levels_by: str | None = None,
) -> Format:
    """Return the format that `write` would use. Call it before long work, to find a bad choice early."""
    check_suffix(format)
    target = file_path(path)
    if is_standard(target) and not format:
        raise FileFormatError("expected the format of standard output, found none; give it, such as ply")
    try:
        chosen = _of_suffix(format or _suffix_of(inner_name(target)), writable=True)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    if chosen.write is None:
        raise FileFormatError(
            f"{path}: expected a format that gppcs writes, found {chosen.name}, which it only reads; choose one of "
            f"{_listed(writable=True)}"
        )
    choices = (
        ("levels_by", "a name that ends in .copc.laz, as only COPC has levels"),
        ("ascii", "PLY or PCD with a choice between text and binary data"),
    )
    given: dict[str, Any] = {}
    if levels_by is not None:
        given["levels_by"] = one_of("levels_by", levels_by, copc_writing.ORDERS)
    if ascii is not None:
        given["ascii"] = flag("ascii", ascii)
    for name, expected in choices:
        if name in given and name not in chosen.options:
            raise FileFormatError(f"{path}: expected {expected}, found {chosen.name}; leave out {name}")
    return replace(chosen, write=partial(chosen.write, **given)) if given else chosen


def format_of(
    file: BufferedReader,
    path: Path,
    format: str | None = None,  # noqa: A002
    if_needed: bool = False,
) -> Format:
    """Return the format of a file by its content or else its name; leave the file at its start."""
    start, size = file.read(1024), os.fstat(file.fileno()).st_size
    file.seek(0)
    recognised = next((known for known in FORMATS if known.recognises(start, size)), None)
    return recognised if recognised and (if_needed or not format) else _of_suffix(format or _suffix_of(path))


def check_suffix(suffix: str | None) -> None:
    """Check that what names a format is text."""
    if not isinstance(suffix, str | None):
        raise ParameterError(f"expected the suffix of a format, such as 'ply', found {shown(suffix)}")


def _of_suffix(suffix: str, writable: bool = False) -> Format:
    for known in FORMATS:
        if known.has_suffix(suffix):
            return known
    raise FileFormatError(f"expected one of the formats {_listed(writable)}, found {suffix_in_words(suffix)}")


def _suffix_of(path: Path) -> str:
    """Return the suffix of a name, or the last two if together they name a format."""
    both = f".{path.name}" if path.name.lower().startswith("points3d.") else "".join(path.suffixes[-2:])
    return both if any(known.has_suffix(both) for known in FORMATS) else path.suffix


def _listed(writable: bool = False) -> str:
    return " ".join(suffix for known in FORMATS for suffix in known.suffixes if known.write or not writable)
