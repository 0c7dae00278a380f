"""Decide whether a cloud in files is simplified in memory, or tile by tile."""

import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.constraints import Constraints, required_columns
from gppcs.amounts.options import Options
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import units_of
from gppcs.engine.memory import available_memory, size_of
from gppcs.engine.threads import number_of_threads
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Feature

PROGRAM = 180_000_000  # Bytes that the program itself takes, with its libraries and compiled kernels.
PER_TILE, FIRST_CHOICE = 170_000_000, 160_000_000  # Of a tile that is worked on, and of the sample.
CHUNK = 1 << 17  # Points of a chunk that is read. It does not depend on the memory, nor do results.


@dataclass(frozen=True)
class Plan:
    """How a cloud in files is going to be simplified. Sizes are estimates in bytes."""

    in_memory: bool  # all points at once; otherwise tile by tile
    points_in: int
    points_out: int
    is_counted: bool  # whether these numbers are exact
    memory: int  # that the process holds at most
    memory_limit: int | None  # None if the platform does not tell what is free
    disk: int = 0  # for temporary files
    threads: int = 1  # tiles that are worked on at once
    readings: int = 1  # of the files


def make_plan(files: CloudFiles, options: Options, needs_memory: str | None = None, to_files: bool = False) -> Plan:
    """Decide how to simplify a cloud; `needs_memory` names what else takes all points at once, if anything."""
    if options.workers is not None and files.reads_standard_input:
        raise InputError("expected files that workers can read, found standard input; name a file, or omit `workers`")
    limit = options.memory_limit or (available_memory() or 0) // 2 or None
    size = files.at_once[1]
    if size and limit is not None and PROGRAM + size > limit:  # before it is read
        raise _too_little(f"{size_of(PROGRAM + size)} of memory, as the files are unpacked as a whole", limit)
    preview, n = files.preview, files.n_points
    if files.query and not n:
        raise files.query.nothing_found()
    _check_preview(preview, options)
    n_kept = options.count(n) or max(1, round(0.1 * n))  # a guess, where only the work tells
    outliers = 130 * n if options.drop_outliers else 0
    row = files.point_size
    memory = PROGRAM + max(2 * row * n, row * n + 24 * n + max(outliers, options.algorithm.memory(n, n_kept)))
    readings = 2 if files.query else 1  # the first one counts the points that a query leaves
    in_memory = Plan(True, n, n_kept, files.is_counted, memory, limit, readings=readings)
    if limit is None or memory <= limit:
        return in_memory
    if reason := needs_memory or _reason(files, options):
        expected = f"{size_of(memory)} of memory for {n:,} points, as {reason} takes all points at once"
        raise _too_little(expected, limit)
    row_kept = 0 if to_files else 2 * row + 120  # of the result, whose points are held twice with their attributes
    return _plan_on_disk(in_memory, options, row_kept, len(_columns(preview, options)))


def _plan_on_disk(in_memory: Plan, options: Options, row_kept: int, n_columns: int) -> Plan:
    """Return the plan to go tile by tile, given that in memory and the bytes of a kept point."""
    n, n_kept, limit = in_memory.points_in, in_memory.points_out, in_memory.memory_limit
    fixed = PROGRAM + row_kept * n_kept
    threads = number_of_threads()
    if limit is not None:
        threads = min(threads, max(1, (limit - fixed) // PER_TILE))
    memory = fixed + max(PER_TILE * threads, FIRST_CHOICE)
    if limit is not None and memory > limit:
        needed = memory if options.workers is not None else min(memory, in_memory.memory)
        expected = f"{size_of(needed)} of memory to choose {n_kept:,} of {n:,} points"
        raise _too_little(expected, limit, "keep fewer points")
    disk = (32 + 8 * n_columns) * n + 120 * n_kept
    readings = in_memory.readings + 2  # for the survey, the tiles or their files, and the kept points
    return replace(in_memory, in_memory=False, memory=memory, disk=disk, threads=threads, readings=readings)


def _columns(preview: PointCloud, options: Options) -> dict[str, NDArray[Any]]:
    """Return the attributes that the choice needs, of the first points."""
    return required_columns(preview, options) if len(preview) else {}


def _too_little(expected: str, limit: int | None, remedy: str = "do without") -> InputError:
    return InputError(
        f"expected at least {expected}, found {size_of(limit or sys.maxsize)}; raise `memory`, or {remedy}"
    )


def _check_preview(preview: PointCloud, options: Options) -> None:
    """Check by the first points that the cloud has the attributes that are named, and the unit that lengths need."""
    if len(preview):
        keep, weight = (value if isinstance(value, str) else None for value in (options.keep, options.weight))
        named = replace(options, keep=keep, weight=weight)  # without arrays, which describe all points
        finite = preview[preview.is_finite()]
        Constraints.from_cloud(finite, np.arange(len(finite)), named)
    units = units_of(options.unit, preview.header)
    for length in options.lengths.values():
        length.in_cloud(1.0, units)
    if options.max_error:
        options.max_error.length.in_cloud(1.0, units)


def _reason(files: CloudFiles, options: Options) -> str | None:
    """Return what of the files or the method takes all points at once, if anything does."""
    preview, format_name = files.preview, files.at_once[0]
    if format_name:
        return f"the format {format_name}"
    if any(values.ndim > 1 or values.dtype.kind not in "biuf" for values in _columns(preview, options).values()):
        return "detail that is not a number for each point"
    goes_by_tiles = Feature.KEEP in options.algorithm.supports or options.algorithm.by_cells
    return None if goes_by_tiles else f"method {options.algorithm.name!r}"
