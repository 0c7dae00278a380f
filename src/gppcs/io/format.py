"""The class `Format`: how one file format is recognised, read and written."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from io import BufferedReader
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.clouds.header import Header
from gppcs.errors import FileFormatError
from gppcs.io.joining import joined

LAST_DIGITS = 2.0  # Units in the last place of the largest coordinate: 41 times 0.01 differs so from 0.41.
LARGEST_SHIFT = 1e-6  # Of the diagonal, by which rounding may move a point without being asked to.
Span = tuple[int, int]  # the row of the first point of a part of a file, and the row behind its last


def without_attributes(cloud: PointCloud, names: Iterable[str]) -> tuple[PointCloud, list[str]]:
    """Return a cloud without some of its attributes, and these attributes and their types in words."""
    lost = set(names)
    kept = {name: values for name, values in cloud.attributes.items() if name not in lost}
    return replace(cloud, attributes=kept), [
        f"attribute {name} ({'text' if values.dtype.kind == 'U' else values.dtype})"
        for name, values in cloud.attributes.items()
        if name in lost
    ]


def keeping(cloud: PointCloud, held: Callable[[str, Column], object]) -> tuple[PointCloud, list[str]]:
    """Return a cloud with the attributes that a format holds, and the others in words."""
    return without_attributes(cloud, [name for name, values in cloud.attributes.items() if not held(name, values)])


def rounding(points: NDArray[np.float64], rounded: NDArray[np.float64]) -> tuple[list[str], bool]:
    """Return in words how far rounding moves points, (N, 3), if at all, and whether that is little enough to be let."""
    if np.array_equal(points, rounded):
        return [], True
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        points, rounded = points[finite], rounded[finite]
    with np.errstate(over="ignore", invalid="ignore"):
        shift = float(np.abs(rounded - points).max(initial=0.0))
        diagonal = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    return shift_in_words(shift, float(np.abs(points).max(initial=0.0)), diagonal)


def shift_in_words(shift: float, farthest: float, diagonal: float) -> tuple[list[str], bool]:
    """Return what `rounding` does, given the largest shift, the largest coordinate and the diagonal of the points."""
    with np.errstate(over="ignore", invalid="ignore"):
        counts = shift > LAST_DIGITS * np.spacing(farthest)
    words = [f"the last digits of coordinates (which move by at most {shift:.1g})"] if counts else []
    return words, shift <= LARGEST_SHIFT * diagonal


class Fit(NamedTuple):
    """What a format can hold of a cloud, and in words the values and the remarks that it cannot."""

    cloud: PointCloud
    values: list[str]
    remarks: list[str]


@dataclass(frozen=True)
class Format:
    """A file format: its names and the functions that recognise, read and write it."""

    name: str
    suffixes: tuple[str, ...]
    chunks: Callable[..., Iterator[PointCloud]]  # of a file, at most so many rows, and with attributes or without
    write: Callable[..., None] | None = None  # to a file, a cloud; of some formats also its faces
    recognises: Callable[[bytes, int], bool] = lambda head, size: False
    unread: Callable[[BufferedReader], list[str]] = lambda file: []
    fitted: Callable[[PointCloud], tuple[PointCloud, list[str]]] = lambda cloud: (cloud, [])
    remarks: Callable[[PointCloud], list[str]] = lambda cloud: []  # what else a file says otherwise than the cloud
    has_levels: bool = False  # `write` takes by what the levels are chosen
    has_text: bool = False  # `write` takes whether numbers are written as text
    faces: Callable[[BufferedReader], int] = lambda file: 0
    triangles: Callable[[BufferedReader], NDArray[np.int64]] | None = None
    is_table: bool = False  # `chunks` takes names of columns
    whole: bool = False  # `chunks` reads all of a file before it yields
    count: Callable[[BufferedReader], int] | None = None
    takes_query: bool = False
    spans: Callable[[BufferedReader, int], list[Span]] | None = None
    header: type[Header] | None = None
    named: Callable[[str], str] = str

    def read(self, file: BufferedReader, columns: Sequence[str] | None = None) -> PointCloud:
        """Read all points with their attributes; `columns` name the columns of a table."""
        if columns is not None and not self.is_table:
            raise FileFormatError(f"expected a text table, whose columns can be named, found {self.name}")
        return joined(self.chunks(file, sys.maxsize, True, **({"columns": columns} if columns else {})))

    def fit(self, cloud: PointCloud) -> Fit:
        """Tell what `write` can store of a cloud and what it cannot."""
        remarks: list[str] = []
        if (header := cloud.header) and not (self.header and isinstance(header, self.header)):
            cloud, remarks = replace(cloud, header=None), header.contents()
        remarks += self.remarks(cloud)
        fitted, values = self.fitted(cloud)
        if fitted.points is not cloud.points:
            digits, tolerated = rounding(cloud.points, fitted.points)
            (remarks if tolerated else values).extend(digits)
        names = [(name, self.named(name)) for name in fitted.attributes]
        remarks += [f"the name {name!a} (it becomes {named})" for name, named in names if named != name]
        return Fit(fitted, values, remarks)

    def has_suffix(self, suffix: str) -> bool:
        """Return whether a suffix names this format."""
        return "." + suffix.lower().removeprefix(".") in self.suffixes
