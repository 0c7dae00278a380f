"""Writes the points of files that do not fit into memory to one COPC file.

They go to disk in parts: as they will be stored, but with their coordinates in files of their own. When all are there,
one scale is chosen, and the parts are joined to one file, which `write_octree` sorts in place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import COLOUR
from gppcs.engine.arrays import Floats
from gppcs.engine.memory import available_memory
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io import las
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.copc_writing import FORMAT, write_octree
from gppcs.io.format import shift_in_words
from gppcs.io.joining import JointColumns
from gppcs.io.las_header import LasHeader, multiples, scale_and_offset
from gppcs.io.streams import whole_output
from gppcs.streaming.plan import PROGRAM
from gppcs.streaming.scratch import scratch_folder

if TYPE_CHECKING:
    import laspy

PART = 1 << 22  # points of a part, which are in memory at once
KINDS = (".records", ".points")  # suffixes of the two files of a part


def write_beyond_memory(
    target: Path,
    files: CloudFiles,
    levels_by: str | None,
    drop: bool,
    memory: int | None,
    timer: Timer,
    force: bool,
    lossy: bool,
) -> tuple[int, list[str]] | None:
    """Write a COPC file of files; return the number of points and in words what it lacks. None if all fit in memory."""
    size = files.point_size * files.n_points
    limit = memory or (available_memory() or 0) // 2
    if not limit or PROGRAM + 3 * size <= limit:
        return None
    rng = None if levels_by == "order" else np.random.default_rng(0)
    with scratch_folder(None, 2 * size) as folder, whole_output(target, force) as file:
        parts = [folder / str(i) for i in range(-(-files.n_points // PART))]
        with timer("points to disk", files.n_points) as on_progress:
            header, changes = _store(target, files, parts, rng, drop, lossy, on_progress)
        with timer("levels and writing"):
            header, digits = _on_one_scale(target, parts, header, lossy)
            points = _joined(folder / "joined", parts, header.las, rng)
            write_octree(file, header.las, points, rng is not None)
    return len(points), [*changes, *digits]


def _store(
    target: Path,
    files: CloudFiles,
    parts: list[Path],
    rng: np.random.Generator | None,
    drop: bool,
    lossy: bool,
    on_progress: Callable[[int], None],
) -> tuple[LasHeader, list[str]]:
    """Store points in parts: neighbours in the order of the files, or random ones if there is a generator.

    Return their header, and in words what the file will not hold.
    """
    header, columns = None, JointColumns()
    changes, n_stored, n_invalid = dict[str, None](), 0, 0
    with ExitStack() as stack:
        opened = [[stack.enter_context(open(f"{part}{kind}", "wb")) for kind in KINDS] for part in parts]
        for chunk in files.chunks():
            cloud = chunk[chunk.is_finite()] if drop else chunk
            las.check_coordinates(cloud.points)
            columns.add(cloud)
            n_invalid += len(chunk) - len(cloud)
            on_progress(len(chunk))
            if not len(cloud):
                continue
            # All coordinates get one scale together, later.
            at_origin = replace(cloud, points=np.zeros_like(cloud.points), header=header or cloud.header)
            fit = FORMAT.fit(at_origin, target, lossy)
            if _are_rescaled(cloud, fit.cloud):
                raise InputError(
                    "expected intensities and colours as whole numbers of 16 bits, found others; "
                    "raise `memory`, or scale them"
                )
            if header is not None and fit.cloud.header != header:
                raise InputError(
                    "expected attributes of types that hold all their values in all files, found others; "
                    "raise `memory`, or convert the files to LAZ of one point format first"
                )
            assert isinstance(fit.cloud.header, LasHeader)
            header = fit.cloud.header
            changes |= dict.fromkeys([*fit.values, *fit.remarks])
            last = len(parts) - 1
            if rng is None:
                indices = np.minimum((n_stored + np.arange(len(cloud))) // PART, last)
            else:
                indices = rng.integers(len(parts), size=len(cloud))
            n_stored += len(cloud)
            order = np.argsort(indices, kind="stable")
            ends = np.searchsorted(indices[order], np.arange(len(parts)), side="right")
            for values, kind in ((las.records_of(fit.cloud, header.las), 0), (cloud.points, 1)):
                for i, piece in enumerate(np.split(values.take(order, axis=0), ends[:-1])):
                    piece.tofile(opened[i][kind])
    if header is None:
        raise InputError(f"{target}: expected points with finite coordinates, found none")
    invalid = [f"points with NaN or infinite coordinates ({n_invalid:,})"] if n_invalid else []
    return header.with_crs_of(columns.header), [*invalid, *changes]


def _are_rescaled(cloud: PointCloud, stored: PointCloud) -> bool:
    """Return whether intensities or colours are stored on a scale that depends on the points of a chunk."""
    for name, values in cloud.attributes.items():
        new = name if name in stored.attributes else FORMAT.renamed(name)
        if new not in ("intensity", *COLOUR) or new not in stored.attributes:
            continue
        if not np.array_equal(values, stored.attributes[new], equal_nan=values.dtype.kind == "f"):
            return True
    return False


def _on_one_scale(target: Path, parts: list[Path], header: LasHeader, lossy: bool) -> tuple[LasHeader, list[str]]:
    """Choose one scale for the coordinates of all parts; return the header with it, and in words what it rounds."""

    def points() -> Iterator[Floats]:
        return (np.fromfile(f"{part}{KINDS[1]}").reshape(-1, 3) for part in parts)

    def of_axis(axis: int) -> Iterator[Floats]:
        return (part[:, axis] for part in points())

    scaled = deepcopy(header.las)
    for i, (scale, offset) in enumerate(zip(header.las.scales, header.las.offsets, strict=True)):
        scaled.scales[i], scaled.offsets[i] = scale_and_offset(partial(of_axis, i), scale, offset)
    lower, upper, shift = np.full(3, np.inf), np.full(3, -np.inf), 0.0
    for part in points():
        if len(part):
            lower, upper = np.minimum(lower, part.min(axis=0)), np.maximum(upper, part.max(axis=0))
            shift = max(shift, np.abs(multiples(part, scaled.scales, scaled.offsets) - part).max())
    digits, tolerated = shift_in_words(shift, np.abs([lower, upper]).max(), float(np.linalg.norm(upper - lower)))
    if not tolerated:
        FORMAT.refuse(target, digits, lossy)
    return LasHeader(scaled), digits


def _joined(path: Path, parts: list[Path], header: laspy.LasHeader, rng: np.random.Generator | None) -> NDArray[Any]:
    """Join the parts to one file, in their order or each in random order, and return it as an array of points (n,)."""
    record = header.point_format.dtype()
    with open(path, "wb") as file:
        for part in parts:
            records = np.fromfile(f"{part}{KINDS[0]}", record)
            las.set_coordinates(records, np.fromfile(f"{part}{KINDS[1]}").reshape(-1, 3), header)
            (records if rng is None else records.take(rng.permutation(len(records)))).tofile(file)
    return np.memmap(path, record, mode="r+")
