"""One or several files as one cloud, read as a whole or in chunks, as often as needed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.header import Header
from gppcs.errors import file_path, flag
from gppcs.io.files import check_input, check_suffix, checked_columns, format_of, naming
from gppcs.io.format import Format, Reader, Span
from gppcs.io.joining import JointColumns
from gppcs.io.query import Query, restricted
from gppcs.io.rows import BLOCK
from gppcs.io.streams import is_plain, plain_input
from gppcs.io.vpc import files_of


class _Opened(NamedTuple):
    """An open file, decompressed."""

    file: Any
    format: Format
    reader: Reader
    is_copy: bool

    @property
    def size(self) -> int:
        """Its size in bytes."""
        return os.fstat(self.file.fileno()).st_size


@dataclass
class CloudFiles:
    """One or several files that together are one cloud: its points are theirs, in the order of the files.

    Each file is opened, and its header read, when it is first needed. Compressed files and standard input are copied to
    temporary files. The `with` statement closes and removes these. Another process can read a pickled object.
    """

    paths: Sequence[Path]
    format: str | None = None
    columns: Sequence[str] | None = None
    query: Query | None = None
    assume_same_crs: bool = False
    if_needed: bool = False  # format and columns are only for the files that need them
    span: Span | None = None  # the part of a single file that is read
    _header: Header | None = field(default=None, init=False)  # of the first file that has one
    _opened: dict[Path, _Opened] = field(default_factory=dict, init=False)
    _stacks: dict[Path, ExitStack] = field(default_factory=dict, init=False)  # close what is open
    _clouds: dict[Path, PointCloud] = field(default_factory=dict, init=False)  # already read, for `read`

    def __post_init__(self) -> None:
        check_suffix(self.format)
        self.columns = None if self.columns is None else checked_columns(self.columns)

    def __enter__(self) -> CloudFiles:
        return self

    def __exit__(self, *_: object) -> None:
        self._clouds.clear()
        self._opened.clear()
        while self._stacks:
            self._stacks.popitem()[1].close()

    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in vars(self).items() if name not in ("preview", "_count")}
        return {**state, "_opened": {}, "_stacks": {}, "_clouds": {}}

    @cached_property
    def preview(self) -> PointCloud:
        """Up to 65,536 of the first points, with attributes and header.

        A file that has to be read at once is kept for the next `read`.
        """
        cloud = None
        for path in self.paths:
            with self._reading(path) as (_, known, reader, _):
                cloud = next(self._chunks(known, reader, BLOCK, True))
                if reader.at_once:
                    self._clouds[path] = cloud
            if len(cloud):
                break
        assert cloud is not None
        return cloud[:BLOCK] if len(cloud) > BLOCK else cloud

    @property
    def n_points(self) -> int:
        """The number of points in all files; an estimate if `is_counted` is False."""
        return self._count[0]

    @property
    def is_counted(self) -> bool:
        """Whether all files tell their number of points."""
        return self._count[1]

    @cached_property
    def _count(self) -> tuple[int, bool]:
        total, density, is_exact = 0.0, 0.0, True
        if len(self.preview) and self.paths[0] in self._clouds:
            density = len(self._clouds[self.paths[0]]) / max(1, self._open(self.paths[0]).size)
        for path in self.paths:
            with self._reading(path) as opened:
                reader = opened.reader
                if path in self._clouds:
                    total += len(self._clouds[path])
                elif self.query:
                    total += sum(len(cloud) for cloud in self._chunks(opened.format, reader, BLOCK, False))
                elif reader.n_points is not None:
                    total += reader.n_points
                else:
                    if not reader.at_once:
                        cloud = next(self._chunks(opened.format, reader, BLOCK, True))
                        end = opened.file.tell() if len(cloud) == BLOCK else opened.size
                        density = len(cloud) / max(1, end)
                    total += opened.size * density
                    is_exact = False
        return round(total), is_exact

    @property
    def at_once(self) -> tuple[str | None, int]:
        """The name of a format of which all points are in memory before some are read, if any, and the bytes of these.

        Bytes are those of the coordinates, or of the file if it does not tell its number of points.
        """
        name, size = None, 0
        for path in self.paths:
            with self._reading(path) as opened:
                if opened.reader.at_once:
                    name, count = opened.format.name, opened.reader.n_points
                    size += opened.size if count is None else 24 * count
        return name, size

    @property
    def n_faces(self) -> int:
        """The number of faces, of which nothing is read."""
        count = 0
        for path in self.paths:
            with self._reading(path) as opened:
                count += opened.reader.n_faces()
        return count

    def skipped(self) -> list[str]:
        """Return in words what of the files is not read."""
        skipped = []
        for path in self.paths:
            with self._reading(path) as opened:
                count = opened.reader.n_faces()
                skipped += [f"faces ({count:,})"] if count else []
                skipped += opened.reader.skipped()
        return skipped

    def formats(self) -> list[Format]:
        """Return the format of each file."""
        return [self._open(path).format for path in self.paths]

    def read(self) -> PointCloud:
        """Read all points with their attributes."""
        clouds, columns = [], JointColumns()
        for path in self.paths:
            with self._reading(path) as opened:
                cloud = self._clouds.pop(path) if path in self._clouds else opened.reader.read()
                clouds.append(self._in_one_system(cloud))
                columns.add(clouds[-1])
        return clouds[0] if len(clouds) == 1 else columns.joined(clouds)

    def chunks(self, attributes: bool = True, n: int = 1 << 20) -> Iterator[PointCloud]:
        """Read all points once, with attributes or without, at most n at once unless a file is read at once."""
        for path in self.paths:
            with self._reading(path) as opened:
                for cloud in self._chunks(opened.format, opened.reader, n, attributes):
                    if len(cloud):
                        yield self._in_one_system(cloud)

    def parts(self, n: int) -> list[CloudFiles]:
        """Return each file, or parts of about n points of a file, by itself."""
        parts = []
        header = self.preview.header if self.assume_same_crs else None
        for path in self.paths:
            with self._reading(path) as opened:
                divides = opened.reader.spans is not None and not opened.is_copy
                spans = opened.reader.spans(n) if divides and opened.reader.spans else []
            for span in spans if len(spans) > 1 else [None]:
                part = replace(self, paths=[path], span=span)
                part._header = header
                if opened.is_copy:
                    part._opened[path] = opened
                parts.append(part)
        return parts

    @property
    def first(self) -> int:
        """The index in the first file of the first point of `chunks`."""
        return self.span[0] if self.span else 0

    def _chunks(self, known: Format, reader: Reader, n: int, attributes: bool) -> Iterator[PointCloud]:
        """Read an open file in chunks, or as a whole if that is the only way."""
        if reader.at_once:
            return iter([reader.read()])
        return reader.chunks(n, attributes, self.span) if self.span else reader.chunks(n, attributes)

    def _in_one_system(self, cloud: PointCloud) -> PointCloud:
        """Return a cloud with the header of the first file, if its coordinate system counts for all files.

        A cloud whose attributes are to be read in another way keeps its own header, which says so.
        """
        if not self.assume_same_crs or cloud.header is None:
            return cloud
        first = self._header = self._header or cloud.header
        ours, theirs = first.conventions, cloud.header.conventions
        return cloud if any(ours.get(n) != theirs.get(n) for n in cloud.attributes) else replace(cloud, header=first)

    @contextmanager
    def _reading(self, path: Path) -> Iterator[_Opened]:
        """Yield an open file; errors in the block name it."""
        with np.errstate(invalid="ignore"):  # of a signalling NaN
            opened = self._open(path)
            with naming(path):
                yield opened

    def _open(self, path: Path) -> _Opened:
        """Open a file and read its header, unless it is open."""
        if path in self._opened:
            return self._opened[path]
        check_input(path)
        plain = [path for path, opened in self._opened.items() if not opened.is_copy]
        if len(plain) >= 64:  # of the files that a process may open
            del self._opened[plain[0]]
            self._stacks.pop(plain[0]).close()
        with naming(path), ExitStack() as stack:
            is_copy = not is_plain(path)
            file, name = stack.enter_context(plain_input(path))
            known = format_of(file, name, self.format, self.if_needed)
            columns = None if self.if_needed and "columns" not in known.options else self.columns
            reader = restricted(known, file, columns, self.query)
            self._opened[path] = _Opened(file, known, reader, is_copy)
            self._stacks[path] = stack.pop_all()
        return self._opened[path]


def open_clouds(
    paths: Sequence[str | os.PathLike[str]],
    format: str | None = None,  # noqa: A002
    columns: Sequence[str] | None = None,
    query: Query | None = None,
    assume_same_crs: bool = False,
    if_needed: bool = False,
) -> CloudFiles:
    """Return files as one cloud, given arguments of `gppcs.read`; a virtual point cloud stands for its files."""
    same = flag("assume_same_crs", assume_same_crs)
    files = [file for path in paths for file in files_of(file_path(path))]
    return CloudFiles(files, format, columns, query, same, if_needed)
