"""One or several files as one cloud, read as a whole or in chunks, as often as needed."""

import hashlib
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.header import Header
from gppcs.engine.memory import available_memory, size_of
from gppcs.errors import FileFormatError, InputError, ParameterError, file_path, flag, shown, with_addresses
from gppcs.io.files import format_of, naming
from gppcs.io.format import Format, Reader, Span
from gppcs.io.joining import JointColumns, joined
from gppcs.io.query import Query
from gppcs.io.rows import BLOCK
from gppcs.io.streams import is_standard, plain_input
from gppcs.io.vpc import files_of


@dataclass
class _Opened:
    """An open file, decompressed."""

    file: Any
    format: Format
    reader: Reader
    close: Callable[[], None]
    cloud: PointCloud | None = None  # all points, if they are read at once, until `read` returns them
    is_lent: bool = False  # by the cloud of which this is a part, which closes it

    @property
    def size(self) -> int:
        """Its size in bytes."""
        return os.fstat(self.file.fileno()).st_size

    @property
    def is_copy(self) -> bool:
        """Whether it is a temporary file, which has no name."""
        return isinstance(self.file.name, int)

    def first(self) -> PointCloud:
        """Return the first points, or all, if they are read at once."""
        if self.reader.at_once:
            self.cloud = self.reader.read() if self.cloud is None else self.cloud
            return self.cloud
        chunks = self.reader.chunks(BLOCK)
        first = next(chunks)
        return first if len(first) else next(filter(len, chunks), first)

    def read(self) -> PointCloud:
        """Return all points, and keep none."""
        cloud, self.cloud = self.cloud, None
        return self.reader.read() if cloud is None else cloud

    def count(self, is_part: bool) -> tuple[int, bool]:
        """Return the number of points, or of the part that a query selects, and whether it is exact."""
        if is_part and not self.reader.at_once:
            return sum(map(len, self.reader.chunks(BLOCK))), True
        if self.reader.n_points is not None and not is_part:
            return self.reader.n_points, True
        if self.reader.at_once:
            return len(self.first()), True
        chunks = filter(len, self.reader.chunks(BLOCK))
        first = next(chunks, ())
        position = self.file.tell()
        if next(chunks, None) is None:
            return len(first), True
        return round(len(first) * self.size / max(1, position)), False


class CloudFiles:
    """Open one or several files as one cloud: its points are theirs, in the order of the files.

    All functions that take a cloud take it: `gppcs.simplify`, also beyond memory, `gppcs.write`, which converts,
    `gppcs.info`, `gppcs.evaluate` and others. Each file is opened, and its header read, when it is first needed.
    Compressed files and standard input are copied to temporary files. The `with` statement closes and removes these.
    Standard input, and an open file in which one cannot seek, can be read only once.

    Parameters
    ----------
    paths : str, path or binary file, or a sequence of these
        The files, their addresses on a server such as https:// or s3:// (with the extra `remote`; of COPC files, only
        what `inside` and `resolution` ask for is fetched), or open files. A gzip file is decompressed; `-` is standard
        input. A virtual point cloud (.vpc) stands for the files that it lists. Several files must have the same
        attributes.
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
        Whether all files get the coordinate system of the first one. Otherwise, files with different coordinate systems
        are an error.
    if_needed : bool
        Whether `format` and `columns` are for the files that need them. Otherwise, a file of another format is an
        error.

    Raises
    ------
    ParameterError
        If an argument is not as above. Errors of the files are raised where these are read, as by `gppcs.read`.

    Examples
    --------
    >>> gppcs.write("scan.csv", gppcs.PointCloud([[0, 0, 0], [1, 2, 3]], {"intensity": [7, 9]}))
    >>> source = gppcs.open("scan.csv", only="intensity > 8")
    >>> source.read()
    PointCloud(1 points, each with intensity)
    >>> gppcs.info(source).maximum
    (1.0, 2.0, 3.0)
    """

    def __init__(
        self,
        paths: str | os.PathLike[str] | BinaryIO | Sequence[str | os.PathLike[str] | BinaryIO],
        format: str | None = None,  # noqa: A002  # as NumPy and pandas say
        columns: Sequence[str] | None = None,
        inside: Sequence[Any] | str | os.PathLike[str] | None = None,
        only: str | None = None,
        resolution: float | None = None,
        assume_same_crs: bool = False,
        if_needed: bool = False,
    ) -> None:
        self._opened: dict[Path, _Opened] = {}
        if isinstance(paths, CloudFiles):
            raise ParameterError(
                "expected names of files, or open files, found a CloudFiles; say all when it is opened"
            )
        self._entered = 0  # how many `with` statements are at work
        self.query = Query.from_options(inside, only, resolution)
        self._format, self._if_needed = format, if_needed
        self._columns = None if columns is None else _checked_columns(columns)
        self._assume_same_crs = flag("assume_same_crs", assume_same_crs)
        self._streams: dict[Path, BinaryIO] = {}  # open files, by the names that they get
        listed: Sequence[Any] = paths if isinstance(paths, list | tuple) else [paths]
        self.paths = [file for path in listed for file in self._files_of(path)]
        if not self.paths:
            raise ParameterError("expected one file or several, found none")
        self._span: Span | None = None  # the part of a single file that is read
        self._header: Header | None = None  # of the first file with a coordinate system

    def _files_of(self, path: str | os.PathLike[str] | BinaryIO) -> list[Path]:
        """Return the files that a path stands for, or a name for an open file."""
        if isinstance(path, str | os.PathLike) or not hasattr(path, "read"):
            return files_of(file_path(path))
        name = Path(f"open file {len(self._streams) + 1}")
        self._streams[name] = path
        return [name]

    def __enter__(self) -> Self:
        self._entered += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._entered -= 1
        if not self._entered:
            self.__del__()

    def __del__(self) -> None:
        for path, opened in list(self._opened.items()):
            if not opened.is_lent:
                del self._opened[path]
                opened.close()

    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in vars(self).items() if name not in ("preview", "_counts")}
        return {**state, "_opened": {}, "_streams": {}, "_entered": 0}

    def __repr__(self) -> str:
        return f"CloudFiles({', '.join(with_addresses(str(path)) for path in self.paths)})"

    @property
    def described(self) -> str:
        """What decides which points of the files are read: of the query, a digest."""
        query = hashlib.sha256(repr(self.query).encode()).hexdigest()  # which has all corners of polygons
        return repr((self._format, self._columns, query, self._assume_same_crs))

    @cached_property
    def preview(self) -> PointCloud:
        """Up to 65,536 of the first points, with attributes and header."""
        for path in self.paths:
            with self._reading(path) as opened:
                cloud = opened.first()
            if len(cloud):
                break
        return cloud[:BLOCK] if len(cloud) > BLOCK else cloud

    @property
    def n_points(self) -> int:
        """The number of points in all files; an estimate if `is_counted` is False."""
        return sum(count for count, _ in self._counts)

    @property
    def is_counted(self) -> bool:
        """Whether the number of points is exact."""
        return all(is_exact for _, is_exact in self._counts)

    @cached_property
    def _counts(self) -> list[tuple[int, bool]]:
        """The number of points of each file, and whether it is exact."""
        counts = []
        for path in self.paths:
            with self._reading(path) as opened:
                counts.append(opened.count(self.query is not None))
        return counts

    @property
    def at_once(self) -> tuple[str | None, int]:
        """The name of a format, if any, whose points are all in memory before some are read; and the bytes at once."""
        name, size = None, 0
        for opened in map(self._open, self.paths):
            n, memory = opened.reader.n_points, opened.reader.memory
            if opened.reader.at_once:
                name = opened.format.name
                size += max(memory, opened.size if n is None else 24 * n)
            size = max(size, memory)
        return name, size

    @property
    def point_size(self) -> int:
        """The bytes that a point takes in memory, with its attributes; of lists, the references alone."""
        columns = self.preview.attributes.values()
        return 24 + sum(values.dtype.itemsize * math.prod(values.shape[1:]) for values in columns)

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """The corners of the bounding box, (2, 3), if the header of the only file tells them."""
        return self._open(self.paths[0]).reader.bounds if len(self.paths) == 1 else None

    @property
    def reads_standard_input(self) -> bool:
        """Whether one of the files is standard input or an open file, which no other process can read."""
        return bool(self._streams) or any(map(is_standard, self.paths))

    @property
    def has_copies(self) -> bool:
        """Whether one of the files is copied to a temporary file before it is read."""
        return any(opened.is_copy for opened in map(self._open, self.paths))

    @property
    def n_faces(self) -> int:
        """The number of faces, which are no points."""
        return sum(opened.reader.n_faces for opened in map(self._open, self.paths))

    def skipped(self) -> list[str]:
        """Return in words what of the files, besides faces, is not read."""
        return [text for opened in map(self._open, self.paths) for text in opened.reader.skipped]

    def formats(self) -> list[Format]:
        """Return the format of each file."""
        return [opened.format for opened in map(self._open, self.paths)]

    def read(self) -> PointCloud:
        """Read all points with their attributes; NaN and infinite coordinates are kept."""
        with self:
            return joined(self.read_each())

    @property
    def cloud(self) -> PointCloud:
        """All points, read anew: functions that take a cloud take this one of an object."""
        return self.read()

    def read_each(self) -> list[PointCloud]:
        """Read the points of each file, after checking that they fit each other."""
        n = sum(opened.reader.n_points or 0 for opened in map(self._open, self.paths))
        if n > 1 << 22 and self.query is None:
            _check_free(self.point_size * n)
        clouds, columns = list[PointCloud](), JointColumns()
        for path in self.paths:
            with self._reading(path) as opened:
                clouds.append(self._in_one_system(opened.read()))
                columns.add(clouds[-1])
        return clouds

    def chunks(self, n: int = 1 << 20) -> Iterator[PointCloud]:
        """Read all points once, at most n at once unless a file is read at once."""
        for path in self.paths:
            with self._reading(path) as opened:
                span = {"span": self._span} if self._span else {}
                for cloud in opened.reader.chunks(n, **span):
                    if len(cloud):
                        yield self._in_one_system(cloud)

    def parts(self, n: int) -> list[Self]:
        """Return each file, or parts of about n points of a file, by itself."""
        parts = []
        header = self.preview.header if self._assume_same_crs else None
        header = header if header and header.crs else None
        for path in self.paths:
            with self._reading(path) as opened:
                spans = [] if opened.is_copy else opened.reader.spans(n)
            for span in spans if len(spans) > 1 else [None]:
                part = copy(self)
                part.paths, part._span, part._header = [path], span, header
                if opened.is_copy:
                    part._opened[path] = replace(opened, is_lent=True)
                parts.append(part)
        return parts

    def _in_one_system(self, cloud: PointCloud) -> PointCloud:
        """Return a cloud with the first header of a coordinate system, if that counts for all files.

        A cloud whose attributes are to be read in another way keeps its own header, which says so.
        """
        if not self._assume_same_crs or cloud.header is None:
            return cloud
        if self._header is None and cloud.header.crs is None:
            return cloud
        first = self._header = self._header or cloud.header
        ours, theirs = first.conventions, cloud.header.conventions
        return cloud if any(ours.get(n) != theirs.get(n) for n in cloud.attributes) else replace(cloud, header=first)

    @contextmanager
    def _reading(self, path: Path) -> Iterator[_Opened]:
        """Yield an open file; errors in the block name it."""
        with np.errstate(invalid="ignore"):
            opened = self._open(path)
            with naming(path):
                yield opened

    def _open(self, path: Path) -> _Opened:
        """Open a file and read its header, unless it is open."""
        if path not in self._opened or self._opened[path].file.closed:  # by the cloud that has lent it
            again = [path for path in self._opened if not (path in self._streams or is_standard(path))]
            if len(again) >= 64:  # a process may not open many more, and copies fill the disk
                self._opened.pop(again[0]).close()
            with naming(path), ExitStack() as stack, np.errstate(invalid="ignore"):  # of a signalling NaN
                file = stack.enter_context(plain_input(path, self._streams.get(path)))
                file_format = format_of(file, path, self._format, self._if_needed)
                reader = file_format.open(file, **self._options(file_format))
                _check_free(reader.memory)
                reader = self.query.restricted(file_format, reader) if self.query else reader
                self._opened[path] = _Opened(file, file_format, reader, stack.pop_all().close)
        return self._opened[path]

    def _options(self, file_format: Format) -> dict[str, Any]:
        """Return what `open` of a format takes of the query and the names of columns."""
        if self._columns is not None and not self._if_needed and "columns" not in file_format.options:
            raise FileFormatError(f"expected a text table, whose columns can be named, found {file_format.name}")
        options = {"query": self.query, "columns": self._columns}
        return {name: value for name, value in options.items() if name in file_format.options and value is not None}


open = CloudFiles  # noqa: A001  # how users call it: `gppcs.open(paths, only="classification == 2")`


def _check_free(size: int) -> None:
    """Check that there is memory for some bytes."""
    if size and (free := available_memory()) is not None and size > free:
        raise InputError(
            f"expected {size_of(size)} of free memory to unpack the points, found {size_of(free)}; read a part with "
            "`inside` or `only`, or use a machine with more memory"
        )


def _checked_columns(columns: Sequence[str]) -> list[str]:
    """Return names of columns after checking that they are different and that x, y and z are among them."""
    names = [] if isinstance(columns, str) or not isinstance(columns, Sequence) else list(columns)
    are_names = all(isinstance(name, str) and name for name in names)
    if not are_names or not {"x", "y", "z"} <= set(names) or len(set(names)) < len(names):
        raise ParameterError(
            "expected different names of columns with x, y and z, such as x, y, z, red, green, blue, found "
            f"{shown(columns)}"
        )
    return names
