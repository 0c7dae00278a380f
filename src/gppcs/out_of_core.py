"""Simplify files that are larger than memory, in passes over them, to the same points as in memory."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.engine.ahead import compiled_ahead
from gppcs.engine.memory import available_memory
from gppcs.engine.stages import Stages
from gppcs.errors import InputError, ParameterError, file_path, flag, shown
from gppcs.io.cloud_files import ROWS, CloudFiles, Head, JointColumns
from gppcs.methods import DEFAULT, Method
from gppcs.simplification import (
    Result,
    check_scores,
    check_usable,
    choose,
    number_to_keep,
    resolved,
    simplify,
    with_scores,
)
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.scaling import Frame, bounds

PASSES = 4  # Bounds, a sample, candidates, and the kept points. One or two more if the area is far off.
PROGRAM = 250_000_000  # Bytes that the program itself takes, with its libraries and compiled kernels.
COPIES = 4  # A chunk is held so often at once: as it is in the file, as it is, shifted and scaled, and hashed.
FEWEST_ROWS = 1 << 16  # Points of a chunk, however little memory there is.
ROWS_PER_KEPT = 40  # Points of a chunk for each point kept: some for each cell, so that most are dropped at once.

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


@dataclass(frozen=True)
class Plan:
    """How files are going to be simplified.

    Attributes
    ----------
    points, kept : int
        About how many points there are, and how many of them are kept.
    passes : int
        How often the files are read; 1 stands for a choice in memory.
    memory : int
        About how many bytes of memory the program is going to hold at most.
    limit : int or None
        How many it may hold; None if the platform does not tell what is free.
    rows : int
        Points of a chunk at most.
    """

    points: int
    kept: int
    passes: int
    memory: int
    limit: int | None
    rows: int

    @property
    def in_memory(self) -> bool:
        """Whether all points are going to be in memory at once."""
        return self.passes == 1


def simplify_files(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    ratio: float | None = None,
    n_points: int | None = None,
    method: str | Method = DEFAULT,
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    normals: bool = False,
    scores: bool = False,
    memory: int | str | None = None,
    stages: Stages | None = None,
) -> Result:
    """Choose exactly M points of a cloud in files, which may be larger than memory.

    If the cloud fits into the memory allowed, it is read and simplified as by `gppcs.simplify`. Otherwise the method
    `gp` reads the files several times, in chunks, and holds a sample of the points, candidates and the kept points
    alone. It chooses the same points, to the last bit of `indices`, however the points are divided into files and
    chunks. The other methods need all points in memory.

    Parameters
    ----------
    paths : path, or sequence of paths
        One file or several, in any format that `gppcs.read` reads. Several files are one cloud: its points are those of
        the first, then those of the second and so on. They must have the same attributes.
    ratio, n_points, method, seed, invalid, normals, scores, stages
        As for `gppcs.simplify`. Normals need all points in memory.
    memory : int or str, optional
        How much memory the process may hold: bytes, or a text such as "4GB" or "512 MiB". By default, half of what is
        free.

    Returns
    -------
    Result
        As of `gppcs.simplify` for the whole cloud.

    Raises
    ------
    FileFormatError
        If a file is damaged, its format is unknown, or the files do not fit each other.
    InputError
        As for `gppcs.simplify`, and if the work would take more memory than allowed.
    ParameterError
        As for `gppcs.simplify`, and if `memory` is no number of bytes.
    OSError
        If a file does not exist or cannot be read.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=20_000)
    >>> gppcs.write("east.ply", cloud.take(range(12_000)))
    >>> gppcs.write("west.ply", cloud.take(range(12_000, 20_000)))
    >>> result = gppcs.simplify_files(["east.ply", "west.ply"], n_points=500, memory="2GB")
    >>> (result.indices == gppcs.simplify(cloud, n_points=500).indices).all()
    np.True_
    """
    if isinstance(paths, str | os.PathLike):
        paths = [paths]
    if not isinstance(paths, Sequence) or not paths:
        raise ParameterError(f"expected a file or a list of files, found {shown(paths)}")
    stages, normals, scores = Stages.of(stages), flag("normals", normals), flag("scores", scores)
    options: dict[str, Any] = {"ratio": ratio, "n_points": n_points, "invalid": invalid, "scores": scores}
    with CloudFiles([file_path(path) for path in paths]) as files:
        chosen, limit = resolved(method, seed), None if memory is None else bytes_of(memory)
        made = plan(files, chosen, ratio, n_points, limit, "normals" if normals else None)
        if made.in_memory:
            with stages("reading"):
                cloud = files.read()
            return simplify(cloud, method=chosen, normals=normals, stages=stages, **options)
        return simplify_in_passes(files, made, chosen, stages=stages, **options)[0]


def bytes_of(memory: int | str) -> int:
    """Return a number of bytes that is written with a unit.

    Parameters
    ----------
    memory : int or str
        Bytes, or a text such as "4GB", "1.5 GB" or "512MiB".

    Returns
    -------
    int

    Raises
    ------
    ParameterError
        If it is neither, or not above 0.
    """
    text = str(memory) if isinstance(memory, int | str) and not isinstance(memory, bool) else ""
    found = re.fullmatch(r"\s*(\d+|\d*\.\d+)\s*([kmgt]i?)?b?\s*", text, re.IGNORECASE | re.ASCII)
    size = round(Decimal(found[1]) * _UNITS[(found[2] or "").lower()]) if found else 0  # floats could overflow
    if size <= 0:
        raise ParameterError(f"expected an amount of memory such as 4GB or 512MB, found {shown(memory)}")
    return size


def size_of(memory: int) -> str:
    """Return a number of bytes as messages show it.

    Parameters
    ----------
    memory : int

    Returns
    -------
    str
    """
    if memory < 1e9:
        return f"{math.ceil(memory / 1e6)} MB"
    return f"{memory / 1e9:.2g} GB" if memory < 1e10 else f"{memory / 1e9:,.0f} GB"


def plan(
    files: CloudFiles,
    method: Method,
    ratio: float | None,
    n_points: int | None,
    limit: int | None = None,
    whole: str | None = None,
) -> Plan:
    """Decide whether a cloud is simplified in memory or in passes.

    Parameters
    ----------
    files : CloudFiles
    method : Method
    ratio, n_points
        As for `gppcs.simplify`.
    limit : int, optional
        Bytes of memory that the process may hold; by default half of what is free.
    whole : str, optional
        What needs all points in memory besides the method, as messages name it.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If it would take more memory than allowed.
    FileFormatError, OSError, ParameterError
        As for `simplify_files`.
    """
    free = available_memory()
    limit = limit or (free // 2 if free else None)
    head = files.head()
    n, row = head.points, _bytes_of_row(head.cloud)
    kept = number_to_keep(n, ratio, n_points) if n else 0
    in_memory = PROGRAM + max(2 * row * n, row * n + 24 * n + method.memory(n, kept))
    if limit is None or in_memory <= limit:
        return Plan(n, kept, 1, in_memory, limit, ROWS)
    needed = None if whole or head.whole else method.memory_in_passes(n, kept)
    if needed is None:
        raise _too_large(head, method, whole, in_memory, limit)
    needed += PROGRAM + 2 * row * kept
    rows = min(n, max(ROWS, ROWS_PER_KEPT * kept), max(FEWEST_ROWS, (limit - needed) // (COPIES * row)))
    needed += COPIES * row * rows
    if needed > limit:
        found = (
            f"expected at least {size_of(needed)} of memory to choose {kept:,} of about {n:,} points in passes "
            f"over the files, found {size_of(limit)}"
        )
        raise InputError(
            f"{found}; raise memory=, or keep fewer points", command=f"{found}; raise --memory, or keep fewer points"
        )
    return Plan(n, kept, PASSES, needed, limit, rows)


def expected_seconds(files: CloudFiles, plan: Plan, method: Method) -> float | None:
    """Return about how long a plan takes. To find how fast the files are read, this reads one chunk.

    Parameters
    ----------
    files : CloudFiles
    plan : Plan
        Made for them.
    method : Method

    Returns
    -------
    float or None
        None if it is not known of the method.
    """
    read = plan.passes * plan.points
    choosing = method.seconds(read, plan.kept)
    begin = perf_counter()
    some = next(files.chunks(plan.in_memory, plan.rows), ())
    reading = (perf_counter() - begin) / max(1, len(some))
    return None if choosing is None else choosing + read * reading


def _bytes_of_row(cloud: PointCloud) -> int:
    """Return how many bytes a point of a cloud takes in memory, with its attributes."""
    return 24 + sum(
        values.dtype.itemsize * math.prod(values.shape[1:]) for values in cloud.attributes.values()
    )  # of lists, the references alone


def _too_large(head: Head, method: Method, whole: str | None, needed: int, limit: int) -> InputError:
    """Return the error for a cloud that has to be in memory as a whole but would take too much of it."""
    if whole:
        reason = f"{whole} takes all points at once"
    elif head.whole:
        reason = f"{head.whole} files are read as a whole"
    else:
        reason = f"method {method.name!r} takes all points at once"
    found = (
        f"expected at least {size_of(needed)} of memory, as {reason} and there are about {head.points:,}, "
        f"found {size_of(limit)}"
    )
    return InputError(f"{found}; raise memory=, or do without", command=f"{found}; raise --memory, or do without")


def simplify_in_passes(
    files: CloudFiles,
    plan: Plan,
    method: Method,
    ratio: float | None,
    n_points: int | None,
    invalid: str,
    scores: bool,
    stages: Stages,
) -> tuple[Result, int]:
    """Choose exactly M points of a cloud without ever holding all of it.

    Parameters
    ----------
    files : CloudFiles
    plan : Plan
        Made for them.
    method : Method
    ratio, n_points, invalid, scores
        As for `simplify_files`.
    stages : Stages
        Times "bounds", the stages of the method, and "kept points". A step of a pass is a point.

    Returns
    -------
    result : Result
    n : int
        The number of points in the files.

    Raises
    ------
    FileFormatError, InputError, OSError, ParameterError
        As for `simplify_files`.
    """
    with stages("bounds", plan.points) as advanced:
        seen = _Overview()
        for cloud in files.chunks(True, plan.rows):
            check_scores(scores, method, cloud)
            seen.add(cloud)
            advanced(len(cloud))
    check_usable(seen.count, seen.bad, seen.first_bad, invalid)
    count = number_to_keep(seen.count - seen.bad, ratio, n_points)
    frame = Frame.around(seen.low, seen.high)

    def chunks() -> Iterator[NDArray[np.float64]]:
        for part in _finite_parts(files, plan.rows, seen.count, attributes=False):
            yield frame.local(part.cloud.points)

    with compiled_ahead(method.name):
        selection = choose(ChunkedPoints(seen.count - seen.bad, chunks), count, method, stages)
    with stages("kept points", seen.count - seen.bad) as advanced:
        order = np.argsort(selection.indices)
        indices: list[NDArray[np.int64]] = []
        clouds: list[PointCloud] = []
        finite = 0
        for part in _finite_parts(files, plan.rows, seen.count, attributes=True):
            begin, end = np.searchsorted(selection.indices, [finite, finite + len(part.cloud)], sorter=order)
            taken = selection.indices[order[begin:end]] - finite
            indices.append(part.rows[taken])
            clouds.append(part.cloud.take(taken))
            finite += len(part.cloud)
            advanced(len(part.cloud))
        back = np.empty_like(order)
        back[order] = np.arange(count)
        kept = seen.columns.joined(clouds).take(back)
    if scores:
        kept = with_scores(kept, method, selection)
    return Result(np.concatenate(indices)[back], kept, method, stages.seconds, selection.diagnostics), seen.count


class _Overview:
    """What the first pass finds: the bounds of the finite points, and how many others there are."""

    def __init__(self) -> None:
        self.count = self.bad = self.first_bad = 0
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.columns = JointColumns()

    def add(self, cloud: PointCloud) -> None:
        self.columns.add(cloud)
        low, high = bounds(cloud.points)
        if not np.isfinite([low, high]).all():
            bad = cloud.non_finite()
            self.first_bad = self.first_bad if self.bad else self.count + int(bad[0])
            self.bad += len(bad)
            finite = np.delete(cloud.points, bad, axis=0)
            low, high = bounds(finite) if len(finite) else (self.low, self.high)
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.count += len(cloud)


class _Part(NamedTuple):
    """The finite points of a chunk, and their rows in the whole cloud."""

    cloud: PointCloud
    rows: NDArray[np.int64]


def _finite_parts(files: CloudFiles, rows: int, count: int, attributes: bool) -> Iterator[_Part]:
    """Yield the finite points of all chunks; raise an error if there are not as many points as in the first pass."""
    first = 0
    for cloud in files.chunks(attributes, rows):
        here = np.arange(first, first + len(cloud))
        first += len(cloud)
        if not np.isfinite(bounds(cloud.points)).all():
            finite = cloud.finite_rows()
            cloud, here = cloud.take(finite), here[finite]
        if len(cloud):
            yield _Part(cloud, here)
    if first != count:
        raise InputError(
            f"expected {count:,} points again, found {first:,}: the files have changed meanwhile; start anew"
        )
