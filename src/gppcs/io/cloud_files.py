"""Several files that are one cloud, read as a whole or in chunks, as often as needed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.header import Header
from gppcs.errors import file_path, flag
from gppcs.io.files import check_input, check_suffix, checked_columns, format_of, naming
from gppcs.io.format import Format, Span
from gppcs.io.joining import JointColumns
from gppcs.io.query import Query
from gppcs.io.rows import BLOCK
from gppcs.io.streams import is_plain, plain_input
from gppcs.io.vpc import files_of

ROWS = 1 << 20  # Points of a chunk at most: few enough for memory, and so many that a chunk costs nothing by itself.


class Head(NamedTuple):
    """What the first points tell of a cloud."""

    cloud: PointCloud  # these points with their attributes
    points: int  # in all files
    exact: bool  # whether all files tell the number; otherwise it is an estimate
    whole: str | None  # the name of a format of these files that has to be read as a whole


@dataclass
class CloudFiles:
    """One or several files that together are one cloud: its points are theirs, in the order of the files.

    A compressed file and standard input are copied to a temporary file on the first use. Use it in a `with` statement,
    which removes these.
    """

    paths: Sequence[Path]
    format: str | None = None
    columns: Sequence[str] | None = None
    query: Query | None = None
    assume_same_crs: bool = False
    if_needed: bool = False  # format and columns are only for the files that need them
    span: Span | None = None  # the part of a single file that is read, by its rows
    _header: Header | None = field(default=None, init=False)  # of the first file that has one
    _copies: dict[Path, tuple[Any, Path]] = field(default_factory=dict, init=False)
    _whole: dict[Path, PointCloud] = field(default_factory=dict, init=False)  # read by `head`, for `read`
    _head: Head | None = field(default=None, init=False)
    _stack: ExitStack = field(default_factory=ExitStack, init=False)

    def __post_init__(self) -> None:
        check_suffix(self.format)
        self.columns = None if self.columns is None else checked_columns(self.columns)

    @classmethod
    def of(
        cls,
        paths: Sequence[str | os.PathLike[str]],
        format: str | None = None,  # noqa: A002
        columns: Sequence[str] | None = None,
        query: Query | None = None,
        assume_same_crs: bool = False,
        if_needed: bool = False,
    ) -> CloudFiles:
        """Check the arguments of `gppcs.read` and `gppcs.simplify_files`, and return the files that they name."""
        same = flag("assume_same_crs", assume_same_crs)
        files = [file for path in paths for file in files_of(file_path(path))]
        return cls(files, format, columns, query, same, if_needed)

    def __enter__(self) -> CloudFiles:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._whole.clear()
        self._head = None
        self._stack.close()

    def each(self, rows: int) -> list[CloudFiles]:
        """Return each file, or each part of a file, by itself; another process can read its `chunks` too."""
        found = [replace(self, paths=[path], span=span) for path in self.paths for span in self._spans(path, rows)]
        header = self.head().cloud.header if self.assume_same_crs else None
        for each in found:
            each._copies = {path: copy for path, copy in self._copies.items() if path in each.paths}
            each._header = header
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs: it makes copies of its own, and holds no points."""
        return {**vars(self), "_copies": {}, "_whole": {}, "_head": None}

    def _spans(self, path: Path, rows: int) -> list[Span | None]:
        """Return the parts of a file; None stands for all of it."""
        with self._opened(path) as (file, known):
            if path in self._copies or self._columns_of(known) is not None or known.spans is None:
                return [None]
            spans = known.spans(file, rows)
            return [*spans] if len(spans) > 1 else [None]

    @property
    def first(self) -> int:
        """The row of the first point of `chunks` in the first file."""
        return self.span[0] if self.span else 0

    def formats(self) -> list[Format]:
        """Return the format of each file."""
        found = []
        for path in self.paths:
            with self._opened(path) as (_, known):
                found.append(known)
        return found

    def _columns_of(self, known: Format) -> Sequence[str] | None:
        """Return the names of the columns of a file of a format; None for those in the file."""
        return None if self.if_needed and not known.is_table else self.columns

    def read(self) -> PointCloud:
        """Read all points with their attributes."""
        clouds, columns = [], JointColumns()
        for path in self.paths:
            clouds.append(self._in_one_system(self._read(path)))
            with naming(path):
                columns.add(clouds[-1])
        return clouds[0] if len(clouds) == 1 else columns.joined(clouds)

    def _read(self, path: Path) -> PointCloud:
        """Read a file, unless `head` has read it as a whole; each cloud is held until then only."""
        if path in self._whole:
            return self._whole.pop(path)
        with self._opened(path) as (file, known):
            return known.read(file, self._columns_of(known))

    def chunks(self, attributes: bool, rows: int = ROWS) -> Iterator[PointCloud]:
        """Read all points once, in chunks."""
        for path in self.paths:
            with self._opened(path) as (file, known):
                parts = self._chunks(file, known, rows, attributes)
                yield from (self._in_one_system(cloud) for cloud in parts if len(cloud))

    def head(self) -> Head:
        """Read the first points, once, and tell the number of all: as each file says, or as its own first points do.

        A file that has to be read as a whole is kept for the next `read`.
        """
        if self._head is None:
            first: PointCloud | None = None
            whole, points, density, exact = None, 0.0, 0.0, True
            for path in self.paths:
                with self._opened(path) as (file, known):
                    if first is None or not len(first) or not (known.whole or known.count):
                        cloud = next(self._chunks(file, known, BLOCK, True))
                        density = len(cloud) / max(1, file.tell() if len(cloud) == BLOCK else _size(file))
                        if known.whole or len(cloud) > BLOCK:
                            whole = known.name
                            self._whole[path] = cloud
                        first = first if first is not None and len(first) else cloud
                    file.seek(0)
                    if path in self._whole:
                        points += len(self._whole[path])
                    else:
                        points += known.count(file) if known.count else _size(file) * density
                        exact = exact and known.count is not None
            assert first is not None
            self._head = Head(first[:BLOCK] if len(first) > BLOCK else first, round(points), exact, whole)
        return self._head

    def read_whole(self) -> tuple[str | None, int]:
        """Return the name of a format of these files that is read as a whole, if any, and the bytes of coordinates."""
        name, size = None, 0
        for path in self.paths:
            with self._opened(path) as (file, known):
                if known.whole:
                    name = known.name
                    size += 24 * known.count(file) if known.count else _size(file)
        return name, size

    def faces(self) -> int:
        """Return how many faces the files have."""
        count = 0
        for path in self.paths:
            with self._opened(path) as (file, known):
                count += known.faces(file)
        return count

    def left_out(self) -> tuple[int, list[str]]:
        """Return how many faces are left out of the files, and in words all that is."""
        faces, unread = 0, list[str]()
        for path in self.paths:
            with self._opened(path) as (file, known):
                here = known.faces(file)
                file.seek(0)
                words = [f"faces ({here:,})"] if here else []
                faces, unread = faces + here, [*unread, *words, *known.unread(file)]
        return faces, unread

    def _chunks(self, file: Any, known: Format, rows: int, attributes: bool) -> Iterator[PointCloud]:
        """Read an open file in chunks, or as a whole if that is the only way."""
        columns = self._columns_of(known)
        if known.whole or (columns is not None and not known.is_table):
            yield known.read(file, columns)
        else:
            more = {"span": self.span, "columns": columns}
            yield from known.chunks(file, rows, attributes, **{name: each for name, each in more.items() if each})

    def _in_one_system(self, cloud: PointCloud) -> PointCloud:
        """Return a cloud with the header of the first file, if its coordinate system counts for all files.

        A cloud whose attributes are to be read in another way keeps its own header, which says so.
        """
        if not self.assume_same_crs or cloud.header is None:
            return cloud
        first = self._header = self._header or cloud.header
        ours, own = first.conventions, cloud.header.conventions
        return cloud if any(ours.get(n) != own.get(n) for n in cloud.attributes) else replace(cloud, header=first)

    @contextmanager
    def _opened(self, path: Path) -> Iterator[tuple[Any, Format]]:
        """Open a file, decompressed, and find its format."""
        check_input(path)
        with naming(path), ExitStack() as stack, np.errstate(invalid="ignore"):  # of a signalling NaN
            if path not in self._copies and not is_plain(path):
                self._copies[path] = self._stack.enter_context(plain_input(path))
            file, name = self._copies.get(path) or stack.enter_context(plain_input(path))
            file.seek(0)
            yield file, format_of(file, name, self.format, self.query, self.if_needed)


def _size(file: Any) -> int:
    return os.fstat(file.fileno()).st_size
