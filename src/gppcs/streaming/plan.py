"""Decide whether a cloud in files is simplified in memory, or beyond it with its points on disk."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from gppcs.amounts.guide import ChunkGuide
from gppcs.amounts.request import Request
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import metres_of
from gppcs.engine.memory import available_memory, size_of
from gppcs.engine.threads import number_of_threads
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Feature
from gppcs.spatial.stored import RECORD

READINGS = 2  # Of the files, if the points go to disk: one stores the points, the other takes the kept ones.
GUESS = 0.1  # Share of the points that are kept, if only the work tells their number.
PROGRAM = 180_000_000  # Bytes that the program itself takes, with its libraries and compiled kernels.
STORED = 90_000_000  # Bytes for the sample and for what is chosen in memory, if the points are on disk.
PART = 70_000_000  # Bytes for each part that is worked on at once.
KEPT = 120  # Bytes for each kept point, besides its attributes, which are held twice.
GROUPED, LABELLED = 50, 2  # Bytes for each point, if groups or quotas are asked for.
OUTLIERS = 130  # Bytes for each point, where outliers are looked for in memory.
VALUE = 8  # Bytes on disk for each point and attribute that the choice needs.
CANDIDATES = 3000  # Bytes on disk for each point to keep.
ROWS = 1 << 17  # Points of a chunk. It does not depend on the memory, nor do results.
SPAN = 1 << 22  # Points of a part of a file that one task reads.
TASKS = 10_000  # Parts of one large file, at most: many more would be much to do for a scheduler.


@dataclass(frozen=True)
class Plan:
    """How files are going to be simplified."""

    in_memory: bool  # all points at once; otherwise they are on disk
    points: int
    kept: int  # of the points
    exact: bool  # whether these numbers are
    memory: int  # bytes that the program is going to hold at most, about
    limit: int | None  # bytes that it may hold; None if the platform does not tell what is free
    disk: int = 0  # bytes of temporary files, about
    threads: int = 1  # parts that are worked on at once
    readings: int = 1  # of the files

    @property
    def way(self) -> str:
        """How, in words."""
        return "in memory" if self.in_memory else "with the points on disk"

    @property
    def rows(self) -> int:
        """Points of a chunk at most."""
        return ROWS

    @property
    def part(self) -> int:
        """Points of a part of a file that one task reads."""
        return max(SPAN, self.points // TASKS)


def plan(
    files: CloudFiles, request: Request, limit: int | None = None, whole: str | None = None, shared: bool = False
) -> Plan:
    """Decide how: `whole` is what takes all points at once, `shared` whether an executor works on parts."""
    limit = limit or (available_memory() or 0) // 2 or None
    _check_read_whole(files, limit)
    preview, method = files.preview, request.method
    counted = files.query is not None  # what a query leaves is counted by reading
    n, row = files.n_points, _bytes_of_row(preview)
    if files.query and not n:
        raise files.query.nothing_found()
    _check_asked(preview, request)
    kept = request.amount.known_count(n) or max(1, round(GUESS * n))
    search = OUTLIERS * n if request.drop_outliers else 0
    in_memory = PROGRAM + max(2 * row * n, row * n + 24 * n + max(search, method.memory(n, kept)))
    if (limit is None or in_memory <= limit) and not shared:
        return Plan(True, n, kept, files.is_counted, in_memory, limit, readings=1 + counted)
    if reason := _reason(files, request, whole):
        if shared:
            raise InputError(f"expected work that several workers can share, but {reason}")
        raise _too_little(f"{size_of(in_memory)} of memory for {n:,} points, as {reason}", limit or sys.maxsize)
    fixed = PROGRAM + STORED + (2 * row + KEPT) * kept
    fixed += GROUPED * n if request.group else LABELLED * n if request.quotas else 0
    threads = number_of_threads() if limit is None else min(number_of_threads(), max(1, (limit - fixed) // PART))
    on_disk = fixed + PART * threads
    if limit is not None and on_disk > limit:
        needed = on_disk if shared else min(on_disk, in_memory)
        raise _too_little(f"{size_of(needed)} of memory to choose {kept:,} of {n:,} points", limit, "keep fewer points")
    record = RECORD.itemsize + VALUE * len(_columns(preview, request))
    return Plan(
        False, n, kept, files.is_counted, on_disk, limit, record * n + CANDIDATES * kept, threads, READINGS + counted
    )


def _columns(preview: PointCloud, request: Request) -> dict[str, NDArray[Any]]:
    """Return the attributes that the choice needs, of the first points."""
    return ChunkGuide.of(request).columns(preview) if len(preview) else {}


def _too_little(expected: str, limit: int, instead: str = "do without") -> InputError:
    return InputError(f"expected at least {expected}, found {size_of(limit)}; raise memory, or {instead}")


def _check_read_whole(files: CloudFiles, limit: int | None) -> None:
    """Check before they are read that files that have to be read as a whole fit into memory."""
    name, size = files.at_once
    if name and limit is not None and PROGRAM + size > limit:
        raise _too_little(f"{size_of(PROGRAM + size)} of memory, as {name} files are read as a whole", limit)


def _check_asked(cloud: PointCloud, request: Request) -> None:
    """Check by the first points that the cloud has the attributes that are named, and the unit that lengths need."""
    if len(cloud):
        ChunkGuide.of(request).of_chunk(cloud)
    metres = metres_of(request.unit, cloud.header)
    for length in request.amount.lengths:
        if length is not None:
            length.in_cloud(1.0, metres)


def _bytes_of_row(cloud: PointCloud) -> int:
    """Return how many bytes a point of a cloud takes in memory, with its attributes."""
    return 24 + sum(
        values.dtype.itemsize * math.prod(values.shape[1:]) for values in cloud.attributes.values()
    )  # of lists, the references alone


def _reason(files: CloudFiles, request: Request, whole: str | None) -> str | None:
    """Return why a cloud has to be in memory as a whole, if it has to be."""
    if whole or request.whole:
        return f"{whole or request.whole} takes all points at once"
    if name := files.at_once[0]:
        return f"{name} files are read as a whole"
    needed = _columns(files.preview, request).values()
    if any(values.ndim > 1 or values.dtype.kind not in "biuf" for values in needed):
        return "detail that is not a number for each point takes all points at once"
    return (
        None if Feature.FILES in request.method.supports else f"method {request.method.name!r} takes all points at once"
    )
