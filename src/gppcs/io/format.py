"""The class `Format`, how one file format is recognised, opened and written, and `Reader`, an open file."""

import os
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from io import BufferedReader
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.clouds.header import Header
from gppcs.errors import OutputError
from gppcs.io.columns import check_name, column_name
from gppcs.io.joining import joined

Span = tuple[int, int]  # the index of the first point of a part of a file, and the index behind its last


@dataclass
class Reader:
    """An open file, whose header has been read.

    `chunks(n)` yields all points in one or more clouds of at most n points. It can be called again, once the last call
    is done. If there are `spans(n)`, parts of about n points that can be read by themselves, it takes one as `span`.
    """

    chunks: Callable[..., Iterator[PointCloud]]
    n_points: int | None = None  # None if only reading tells
    at_once: bool = False  # `chunks` holds all points in memory before it yields
    n_faces: int = 0
    skipped: list[str] = field(default_factory=list)  # in words what of the file, besides faces, is not read
    spans: Callable[[int], list[Span]] = lambda n: []
    triangles: Callable[[], NDArray[np.int64]] | None = None  # the faces, of a mesh format
    bounds: NDArray[np.float64] | None = None  # corners (2, 3) of the bounding box, if the header tells them
    memory: int = 0  # bytes that are unpacked at once, as the file says

    def read(self) -> PointCloud:
        """Read all points."""
        return joined(self.chunks(sys.maxsize))


def read_at_once(
    file: BufferedReader, read: Callable[[BufferedReader], tuple[PointCloud, list[str]]], memory: int = 0
) -> Reader:
    """Return a reader of a file of which `read` returns all points, and in words what it skips."""

    def chunks(n: int) -> Iterator[PointCloud]:
        file.seek(0)
        cloud, reader.skipped[:] = read(file)
        yield cloud

    reader = Reader(chunks, at_once=True, memory=memory)
    return reader


class Fit(NamedTuple):
    """A cloud as a format holds it, and in words the values that this loses, and what else changes."""

    cloud: PointCloud
    values: list[str]
    remarks: list[str]


@dataclass(frozen=True)
class Format:
    """A file format: its names and the functions that recognise, open and write it."""

    name: str
    suffixes: tuple[str, ...]
    open: Callable[..., Reader]  # a file at its start
    write: Callable[..., None] | None = None  # to a file, a cloud that `stored` has returned
    recognises: Callable[[bytes, int], bool] = lambda start, size: False  # the first bytes of a file, and its size
    stored: Callable[[PointCloud], PointCloud] = lambda cloud: cloud  # a cloud as `write` stores it
    options: frozenset[str] = frozenset()  # of `open`: columns, query; of `write`: the others
    renamed: Callable[[str], str] = column_name  # the name that an attribute may get in `stored`

    def fit(self, cloud: PointCloud, path: str | os.PathLike[str] = "", lossy: bool = True) -> Fit:
        """Compare a cloud with what `write` can store of it. Lost values are an error for a file, unless `lossy`."""
        stored = self.stored(cloud)
        values, remarks = list[str](), list[str]()
        if cloud.header:
            same = stored.header if type(stored.header) is type(cloud.header) else None
            kept = same.contents() if same else []
            remarks += [item for item in cloud.header.contents() if item not in kept]
        for name, column in cloud.attributes.items():
            new = name if name in stored.attributes else self.renamed(name)
            if new in stored.attributes:
                if new != name:
                    remarks.append(f"the name {name!a} (it becomes {new})")
                found, are_degrees = stored.attributes[new], (name, new) == ("scan_angle_rank", "scan_angle")
                # LAS holds one number for each point without a second axis.
                column = column if column is found else column.reshape(found.shape)
                is_same = column is found or np.array_equal(column, found, equal_nan=column.dtype.kind == "f")
                if not (is_same or are_degrees):
                    limits, is_exact = _scaling(column, found)
                    (remarks if is_exact else values).append(
                        f"the {'scale' if is_exact else 'exact values'} of attribute {name}{limits}"
                    )
            elif part := next((part for part in (name, new) if f"{part}_0" in stored.attributes), None):
                remarks.append(f"attribute {name} under one name (its numbers become {part}_0, {part}_1 and so on)")
            else:
                values.append(f"attribute {name} ({'text' if column.dtype.kind == 'U' else column.dtype})")
        digits, tolerated = _rounding(cloud.points, stored.points)
        (remarks if tolerated else values).extend(digits)
        self.refuse(path, values, lossy)
        return Fit(stored, values, remarks)

    def refuse(self, path: str | os.PathLike[str], values: list[str], lossy: bool) -> None:
        """Raise an error if this format cannot hold some values, in words, of a file, unless `lossy`."""
        if values and not lossy:
            raise OutputError(
                f"{path}: expected a format that holds all of the cloud, but {self.name} cannot hold: "
                f"{', '.join(values)}; choose another format, or leave this out with `lossy=True`"
            )

    def ranked(self) -> Self:
        """Return the format for points in the order of importance: the first ones go to its coarse levels, if any."""
        if "levels_by" not in self.options or self.write is None:
            return self
        return replace(self, write=partial(self.write, levels_by="order"))

    def has_suffix(self, name: str) -> bool:
        """Return whether a suffix, or the end of the name of a file, names this format."""
        return f".{name.lower().removeprefix('.')}".endswith(self.suffixes)


def begins(pattern: bytes) -> Callable[[bytes, int], bool]:
    """Return a function that recognises files by a regular expression for their first bytes; a dot is any byte."""
    compiled = re.compile(pattern, re.DOTALL)
    return lambda start, size: compiled.match(start) is not None


def keeping(
    cloud: PointCloud,
    holds: Callable[[str, Column], object],
    header: type[Header] | None = None,
    plain_names: bool = False,
) -> PointCloud:
    """Return a cloud with the attributes that a format holds, and with its header if that is of a type.

    With `plain_names`, the names of attributes get underscores in place of whitespace, separators and quotes.
    """
    kept: dict[str, Column] = {}
    for name, values in cloud.attributes.items():
        if holds(name, values):
            new = column_name(name) if plain_names else name
            check_name(new, kept)
            kept[new] = values
    return replace(cloud, attributes=kept, header=cloud.header if header and isinstance(cloud.header, header) else None)


def _scaling(values: Column, stored: Column) -> tuple[str, bool]:
    """Return in words which numbers the least and the largest become, and whether this is an exact change of depth."""
    if not len(values) or values.dtype.kind not in "iuf" or stored.dtype.kind not in "iu":
        return "", False
    (lower, upper), (first, last) = (
        (float(np.fmin.reduce(part)), float(np.fmax.reduce(part))) for part in (values, stored)
    )
    factor = min((255.0, 257.0, 65535.0), key=lambda factor: abs(factor * upper - last))
    is_exact = bool((np.abs(factor * values - stored) <= 4e-6 * factor).all())
    return f" ({lower:g} to {upper:g} become {first:g} to {last:g})", is_exact


def _rounding(points: NDArray[np.float64], rounded: NDArray[np.float64]) -> tuple[list[str], bool]:
    """Return in words how far rounding moves points, (N, 3), if at all, and whether that is little enough to be let."""
    if points is rounded or np.array_equal(points, rounded, equal_nan=True):
        return [], True
    finite = np.isfinite(points).all(axis=1)
    points, rounded = points[finite], rounded[finite]
    with np.errstate(over="ignore", invalid="ignore"):
        shift = float(np.abs(rounded - points).max(initial=0.0))
        diagonal = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    return shift_in_words(shift, float(np.abs(points).max(initial=0.0)), diagonal)


def shift_in_words(shift: float, farthest: float, diagonal: float) -> tuple[list[str], bool]:
    """Return what `rounding` does, given the largest shift, the largest coordinate and the diagonal of the points."""
    # 41 times 0.01 differs from 0.41 by two units in the last place.
    is_seen = shift > 2.0 * np.spacing(farthest)
    message = f"the last digits of coordinates (which move by at most {shift:.1g})"
    return [message] if is_seen else [], shift <= 1e-6 * diagonal
