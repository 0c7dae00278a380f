"""The class `Format`: how one file format is recognised, read and written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from io import BufferedReader
from typing import BinaryIO, NamedTuple

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.header import Header

Span = tuple[int, int]  # the row of the first point of a part of a file, and the row behind its last


def _never(head: bytes, size: int) -> bool:
    return False


def _nothing(file: BufferedReader) -> list[str]:
    return []


def without_attributes(cloud: PointCloud, names: Iterable[str]) -> tuple[PointCloud, list[str]]:
    """Return a cloud without some of its attributes, and these attributes and their types in words."""
    lost = set(names)
    kept = {name: values for name, values in cloud.attributes.items() if name not in lost}
    return replace(cloud, attributes=kept), [
        f"attribute {name} ({'text' if values.dtype.kind == 'U' else values.dtype})"
        for name, values in cloud.attributes.items()
        if name in lost
    ]


def without_foreign_header(cloud: PointCloud, own: type[Header] | None) -> tuple[PointCloud, list[str]]:
    """Return a cloud without the header of another format, and in words what that says."""
    if cloud.header is None or (own and isinstance(cloud.header, own)):
        return cloud, []
    return replace(cloud, header=None), cloud.header.contents()


def _all(cloud: PointCloud) -> tuple[PointCloud, list[str]]:
    return cloud, []


class Fit(NamedTuple):
    """What a format can hold of a cloud, and in words the values and the remarks that it cannot."""

    cloud: PointCloud
    values: list[str]
    remarks: list[str]


def _none(file: BufferedReader) -> int:
    return 0


@dataclass(frozen=True)
class Format:
    """A file format: its names and the functions that recognise, read and write it.

    Parameters
    ----------
    name : str
        The name in messages.
    suffixes : tuple of str
        Suffixes of file names, in lower case, with the dot.
    read : callable(file) -> PointCloud
        Reads a binary file from its start. It raises FileFormatError or InputError, without the name of the file, if
        the content is not as expected.
    write : callable(file, cloud), optional
        Writes a cloud that `fitted` has returned to a binary file. It raises OutputError if the format cannot store it.
        None if gppcs does not write the format.
    write_encoded : callable(file, cloud, ascii=bool), optional
        Writes as `write` does, but as text if `ascii` is true, else as binary data. None if the format has not both.
    recognises : callable(head, size) -> bool, optional
        Whether a file is of this format, given its first 1024 bytes and its size in bytes. By default False, for
        formats without a signature.
    unread : callable(file) -> list of str, optional
        Returns in words what `read` leaves out of a binary file, besides faces. By default nothing.
    header : type, optional
        The class of the headers that `write` stores; by default it stores none.
    named : callable(name) -> str, optional
        Returns the name under which `write` stores an attribute; by default its own.
    fitted : callable(cloud) -> (PointCloud, list of str), optional
        Returns the part of a cloud that `write` can store, and in words the values that it cannot. By default, all. The
        cloud has no header but one of the format's own.
    faces : callable(file) -> int, optional
        Returns the number of faces in a binary file that `read` can read. By default 0, for formats without faces.
    read_named : callable(file, names) -> PointCloud, optional
        Reads a table as `read` does, with these names of its columns. None if files of the format are no tables.
    chunks : callable(file, rows, attributes) -> iterator of PointCloud, optional
        Reads what `read` does, from the start of the file, in clouds of at most `rows` points, of which none is empty
        unless it is the only one. Without `attributes`, these are left out. A layout that has to be read as a whole
        comes as one cloud. None if the format always has to be read as a whole.
    count : callable(file) -> int, optional
        Returns how many points a file has, as its header says. By default, the size of the file tells about how many.
    takes_query : bool
        Whether `read` and `chunks` take `query=`, a `Query` or None, and read no more than they must for it.
    spans : callable(file, rows) -> list of (int, int), optional
        Divides the points of a file into parts of at least `rows` points. Given one of them as `span=`, `chunks` reads
        that part alone. None if files can only be read from their start.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[..., PointCloud]
    write: Callable[[BinaryIO, PointCloud], None] | None = None
    recognises: Callable[[bytes, int], bool] = _never
    unread: Callable[[BufferedReader], list[str]] = _nothing
    fitted: Callable[[PointCloud], tuple[PointCloud, list[str]]] = _all
    faces: Callable[[BufferedReader], int] = _none
    write_encoded: Callable[..., None] | None = None
    read_named: Callable[[BufferedReader, list[str]], PointCloud] | None = None
    chunks: Callable[..., Iterator[PointCloud]] | None = None
    count: Callable[[BufferedReader], int] | None = None
    takes_query: bool = False
    spans: Callable[[BufferedReader, int], list[Span]] | None = None
    header: type[Header] | None = None
    named: Callable[[str], str] = str

    def fit(self, cloud: PointCloud) -> Fit:
        """Tell what `write` can store of a cloud and what it cannot."""
        cloud, remarks = without_foreign_header(cloud, self.header)
        fitted, values = self.fitted(cloud)
        names = [(name, self.named(name)) for name in fitted.attributes]
        remarks += [f"the name {name!a} (it becomes {named})" for name, named in names if named != name]
        return Fit(fitted, values, remarks)

    def has_suffix(self, suffix: str) -> bool:
        """Return whether a suffix names this format.

        Parameters
        ----------
        suffix : str
            In letters of any case, with or without the dot.

        Returns
        -------
        bool
        """
        return "." + suffix.lower().removeprefix(".") in self.suffixes
