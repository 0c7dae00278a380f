"""Decide whether a cloud in files is simplified in memory, in passes over the files, or tile by tile."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from enum import Enum
from time import perf_counter
from typing import NamedTuple

from gppcs.clouds.cloud import PointCloud
from gppcs.engine.memory import available_memory
from gppcs.errors import InputError
from gppcs.io.cloud_files import ROWS, CloudFiles, Head
from gppcs.methods import Method
from gppcs.simplification import number_to_keep
from gppcs.spatial.gaps import AT_ONCE
from gppcs.streaming.sizes import size_of
from gppcs.surface.outliers.tiles import IN_MEMORY, ON_DISK, memory_of_outliers

PASSES = 4  # Bounds, a sample, candidates, and the kept points. One or two more if the area is far off.
PASSES_OF_WEIGHTS = 2  # More: one finds their mean, the other those of the candidates.
PASSES_OF_GAPS = 3  # More: the places of the kept points, those in gaps, and the largest gap that is left.
GAPS = 200  # Bytes of memory for each point in a gap, with a tree over these.
# More: a sample, the places of a ranking, and four judgements. Each other ranking takes three, or five with weights.
PASSES_OF_ACCURACY = 6
DISTANCES = 1  # Byte of memory for each point, where its distance from a surface is measured: the largest are held.
PASSES_OF_OUTLIERS = 3  # More: bounds, a sample, and all points. One more for those that are not finite, or for a list.
SECONDS_OF_OUTLIERS = 8e-6  # To look at a point on two cores.
OUTLIERS = 0.02  # At most about this share of the points are outliers.
PROGRAM = 250_000_000  # Bytes that the program itself takes, with its libraries and compiled kernels.
COPIES = 4  # A chunk is held so often at once: as it is in the file, as it is, shifted and scaled, and hashed.
FEWEST_ROWS = 1 << 16  # Points of a chunk, however little memory there is.
PART = (
    1 << 22
)  # Points of a part of a file, where many are kept: the scheduler holds what a task returns to the client.
TASKS = 10_000  # Tasks of a pass over one large file: many more would be much to do for the scheduler.
ROWS_PER_KEPT = 40  # Points of a chunk for each point kept: some for each cell, so that most are dropped at once.


class Way(Enum):
    """How a cloud is simplified."""

    MEMORY = "in memory"
    PASSES = "in passes over the files"
    TILES = "in tiles on disk"


class Besides(NamedTuple):
    """What is asked for besides a number of points.

    Attributes
    ----------
    keep, weights, gaps, accuracy, outliers : bool
        Whether some points are kept whatever happens, points have weights, gaps are filled, the accuracy of the first
        points of rankings is measured, and outliers are left out.
    """

    keep: bool = False
    weights: bool = False
    gaps: bool = False
    accuracy: bool = False
    outliers: bool = False

    @property
    def passes(self) -> int:
        """How many more passes this takes, at least."""
        more = PASSES_OF_WEIGHTS * self.weights + PASSES_OF_GAPS * self.gaps + PASSES_OF_ACCURACY * self.accuracy
        return more + PASSES_OF_OUTLIERS * self.outliers

    @property
    def tiled(self) -> bool:
        """Whether it is possible in tiles."""
        return not (self.keep or self.weights or self.accuracy)


NOTHING = Besides()


@dataclass(frozen=True)
class Plan:
    """How files are going to be simplified.

    Attributes
    ----------
    way : Way
    points, kept : int
        About how many points there are, and how many of them are kept.
    memory : int
        About how many bytes of memory the program is going to hold at most.
    limit : int or None
        How many it may hold; None if the platform does not tell what is free.
    rows : int
        Points of a chunk at most.
    disk : int
        About how many bytes of disk space temporary files are going to take.
    besides : Besides
        What is asked for besides a number of points.
    """

    way: Way
    points: int
    kept: int
    memory: int
    limit: int | None
    rows: int
    disk: int = 0
    besides: Besides = NOTHING

    @property
    def in_memory(self) -> bool:
        """Whether all points are going to be in memory at once."""
        return self.way is Way.MEMORY

    @property
    def part(self) -> int:
        """Points of a part of a file, which is one task of a pass. The limit of memory makes no difference."""
        wanted = ROWS if self.way is Way.TILES else ROWS_PER_KEPT * self.kept
        return max(ROWS, min(wanted, PART), self.points // TASKS)

    @property
    def passes(self) -> int:
        """How often the files are read, at least."""
        return 1 if self.in_memory else PASSES + self.besides.passes


def default_limit() -> int | None:
    """Return how many bytes of memory the process may hold if users do not say it: half of what is free now.

    Returns
    -------
    int or None
        None if the platform does not tell what is free.
    """
    free = available_memory()
    return free // 2 if free else None


def plan(
    files: CloudFiles,
    method: Method,
    ratio: float | None,
    n_points: int | None,
    limit: int | None = None,
    whole: str | None = None,
    shared: bool = False,
    besides: Besides = NOTHING,
) -> Plan:
    """Decide whether a cloud is simplified in memory, in passes, or in tiles.

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
    shared : bool
        Whether workers are to share the work. They cannot if all points have to be in memory.
    besides : Besides
        What is asked for besides a number of points. Not all of it is possible in tiles.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If it would take more memory than allowed, workers cannot share it, or no point is in the box.
    FileFormatError, OSError, ParameterError
        As for `simplify_files`.
    """
    limit = limit or default_limit()
    head = files.head()
    n, row = head.points, _bytes_of_row(head.cloud)
    if files.query and not n:
        raise files.query.nothing_found()
    kept = number_to_keep(n, ratio, n_points) if n else 0
    more = method.memory_of_weights(n, kept) if besides.weights else 0
    more += GAPS * min(n, AT_ONCE) if besides.gaps else 0
    more += DISTANCES * n if besides.accuracy else 0
    search = IN_MEMORY * n if besides.outliers else 0
    in_memory = PROGRAM + max(2 * row * n, row * n + 24 * n + max(search, method.memory(n, kept) + more))
    if (limit is None or in_memory <= limit) and not shared:
        return Plan(Way.MEMORY, n, kept, in_memory, limit, ROWS, besides=besides)
    chunked = not (whole or head.whole)
    passes = method.memory_in_passes(n, kept) if chunked else None
    tiles = method.memory_in_tiles(n, kept) if chunked and besides.tiled else None
    needed = [] if shared else [in_memory]
    limit = limit or sys.maxsize
    search = memory_of_outliers(n) if besides.outliers else 0
    held = round(OUTLIERS * n) * (8 + 2 * row) if besides.outliers else 0
    for way, takes in ((Way.PASSES, passes), (Way.TILES, tiles)):
        if takes is not None:
            fixed = PROGRAM + held + max(search, takes + more + 2 * row * kept)
            rows = min(n, max(ROWS, ROWS_PER_KEPT * kept), max(FEWEST_ROWS, (limit - fixed) // (COPIES * row)))
            needed.append(fixed + COPIES * row * rows)
            if needed[-1] <= limit:
                disk = method.disk_in_tiles(n, kept) if way is Way.TILES else 0
                disk = max(disk, ON_DISK * n if besides.outliers else 0)
                return Plan(way, n, kept, needed[-1], limit, rows, disk, besides)
    if passes is None and tiles is None:
        if shared:
            raise InputError(f"expected work that several workers can share, but {_reason(head, method, whole)}")
        raise _too_large(head, method, whole, in_memory, limit)
    aim = "look for this tolerance" if besides.accuracy else f"choose {kept:,} of about {n:,} points"
    found = f"expected at least {size_of(min(needed))} of memory to {aim}, found {size_of(limit)}"
    fewer = "" if besides.accuracy else ", or keep fewer points"
    raise InputError(f"{found}; raise memory={fewer}", command=f"{found}; raise --memory{fewer}")


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
    looking = SECONDS_OF_OUTLIERS * plan.points if plan.besides.outliers else 0.0
    begin = perf_counter()
    some = next(files.chunks(plan.in_memory, plan.rows), ())
    reading = (perf_counter() - begin) / max(1, len(some))
    return None if choosing is None else choosing + looking + read * reading


def _bytes_of_row(cloud: PointCloud) -> int:
    """Return how many bytes a point of a cloud takes in memory, with its attributes."""
    return 24 + sum(
        values.dtype.itemsize * math.prod(values.shape[1:]) for values in cloud.attributes.values()
    )  # of lists, the references alone


def _too_large(head: Head, method: Method, whole: str | None, needed: int, limit: int) -> InputError:
    """Return the error for a cloud that has to be in memory as a whole but would take too much of it."""
    found = (
        f"expected at least {size_of(needed)} of memory, as {_reason(head, method, whole)} and there are about "
        f"{head.points:,}, found {size_of(limit)}"
    )
    return InputError(f"{found}; raise memory=, or do without", command=f"{found}; raise --memory, or do without")


def _reason(head: Head, method: Method, whole: str | None) -> str:
    """Return why a cloud has to be in memory as a whole."""
    if whole:
        return f"{whole} takes all points at once"
    if head.whole:
        return f"{head.whole} files are read as a whole"
    return f"method {method.name!r} takes all points at once"
