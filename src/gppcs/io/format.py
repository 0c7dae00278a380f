"""The class `Format`: how one file format is recognised, read and written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import BufferedReader
from typing import BinaryIO

from gppcs.clouds.cloud import PointCloud


def _never(head: bytes, size: int) -> bool:
    return False


def _nothing(file: BufferedReader) -> list[str]:
    return []


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
        Reads a binary file from its start. It raises FileFormatError, without the name of the file, if the content is
        not as expected.
    write : callable(file, cloud), optional
        Writes a cloud to a binary file. It raises OutputError if the format cannot store this cloud. None if gppcs
        does not write the format.
    recognises : callable(head, size) -> bool, optional
        Whether a file is of this format, given its first 1024 bytes and its size in bytes. By default False, for
        formats without a signature.
    unread : callable(file) -> list of str, optional
        Returns in words what `read` leaves out of a binary file. By default nothing.
    holds_attributes : bool
        Whether `write` stores attributes. If not, it leaves them out.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[BufferedReader], PointCloud]
    write: Callable[[BinaryIO, PointCloud], None] | None = None
    recognises: Callable[[bytes, int], bool] = _never
    unread: Callable[[BufferedReader], list[str]] = _nothing
    holds_attributes: bool = True
