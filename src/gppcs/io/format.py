"""What a file format is to this package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import BufferedReader
from typing import BinaryIO

from gppcs.clouds.cloud import PointCloud


def _never(head: bytes, size: int) -> bool:
    return False


@dataclass(frozen=True)
class Format:
    """A file format: its names, and how to recognise, read and write it.

    Parameters
    ----------
    name : str
        What messages call it.
    suffixes : tuple of str
        Suffixes of file names, in lower case, with the dot.
    read : function of an open file
        Returns the cloud. Raises FileFormatError, without the file's name, if the content is not as expected.
    write : function of an open file and a cloud, optional
        Missing if the format cannot hold points. Raises OutputError if it cannot hold this cloud.
    recognises : function of the first 1024 bytes and the file's size in bytes, optional
        Tells whether the content is of this format; formats without a mark of their own leave it out.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[BufferedReader], PointCloud]
    write: Callable[[BinaryIO, PointCloud], None] | None = None
    recognises: Callable[[bytes, int], bool] = _never
