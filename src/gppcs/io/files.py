"""All formats, and which of them a file has, by its content or its name.

To add a format, write a module with a `Format` and add it to `FORMATS`.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any

from gppcs.errors import FileFormatError, InputError, ParameterError, file_path, flag, one_of, shown
from gppcs.io import arrays, arrow, colmap, copc_writing, e57, las, meshes, pcd, ply, ptx, text
from gppcs.io.format import Format
from gppcs.io.remote import address_of
from gppcs.io.streams import inner_name, is_standard

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


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Begin the messages of errors about the content of a file with its name."""
    try:
        yield
    except (FileFormatError, InputError) as error:
        name = "standard input" if is_standard(path) else address_of(path) or path
        raise FileFormatError(f"{name}: {error}") from error


def format_of(
    file: BufferedReader,
    path: Path,
    format: str | None = None,  # noqa: A002
    if_needed: bool = False,
) -> Format:
    """Return the format of a file by its content, or else by a suffix or its name; leave the file at its start.

    Content of another format than that of the suffix is an error, unless the suffix is for files that need it.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    start = file.peek(1024)[:1024]
    matches = [file_format for file_format in FORMATS if file_format.recognises(start, size)]
    if matches and (format is None or if_needed):
        return matches[0]
    named = _named(inner_name(path).name if format is None else format, FORMATS)
    if matches and named not in matches:
        raise FileFormatError(f"expected the format {named.name}, found {matches[0].name}; leave out `format`")
    return named


def format_to_write(
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002
    ascii: bool | None = None,  # noqa: A002
    levels_by: str | None = None,
) -> Format:
    """Return the format that `write` would use. Call it before long work, to find a bad choice early."""
    target = file_path(path)
    if is_standard(target) and format is None:
        raise FileFormatError("expected the format of standard output, found none; give it, such as ply")
    with naming(target):
        name = inner_name(target).name if format is None else format
        file_format = _named(name, [item for item in FORMATS if item.write])
        options: dict[str, Any] = {}
        if levels_by is not None:
            options["levels_by"] = one_of("levels_by", levels_by, copc_writing.ORDERS)
        if ascii is not None:
            options["ascii"] = flag("ascii", ascii)
        for option in options.keys() - file_format.options:
            able = " or ".join(other.name for other in FORMATS if option in other.options)
            raise FileFormatError(
                f"expected {able}, which has `{option}`, found {file_format.name}; leave out `{option}`"
            )
    assert file_format.write is not None
    return replace(file_format, write=partial(file_format.write, **options)) if options else file_format


def _named(name: str, formats: Sequence[Format]) -> Format:
    """Return which of some formats a name of a file, or a suffix, ends with."""
    if not isinstance(name, str):
        raise ParameterError(f"expected the suffix of a format, such as 'ply', found {shown(name)}")
    for file_format in formats:
        if file_format.has_suffix(name):
            return file_format
    listed = " ".join(suffix for file_format in formats for suffix in file_format.suffixes)
    suffix = Path(name).suffix or (name if name.startswith(".") else "")
    actual = shown(suffix) if suffix else "a name without a suffix"
    if formats is not FORMATS and any(kind.has_suffix(name) for kind in FORMATS if "faces" in kind.options):
        actual += ", in which gppcs mesh writes meshes, but points are only read"
    hint = "; name its format, such as `format='kitti'` or `format='points3d.bin'`" if suffix == ".bin" else ""
    raise FileFormatError(f"expected one of the formats {listed}, found {actual}{hint}")
