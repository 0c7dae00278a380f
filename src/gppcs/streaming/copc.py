"""Write the points of files that do not fit into memory to one COPC file.

They are stored once, as they are going to stand in the file. How many lie in each cell of a grid tells the levels. Then
blocks of points are sorted by nodes, and each node is put together from its pieces in the blocks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.request import Request
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import InputError
from gppcs.io import copc_writing as copc
from gppcs.io import las
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.copc_writing import Cube, Node, Octree
from gppcs.io.files import refuse_losses
from gppcs.io.las_header import LasHeader
from gppcs.io.streams import whole_output
from gppcs.streaming.files import Work, run
from gppcs.streaming.plan import Plan
from gppcs.streaming.scratch import scratch_folder

BLOCK = 1 << 20  # Points that are sorted at once.
GRID = 7  # Level whose cells are counted: two million.
SPREAD = 4.0  # Standard deviations by which a node, of points taken at random, may be larger than expected.
NEVER = 255  # Stands for the level of a cell that takes no more than its share of points on any level.
RANK, POINT = "rank", "point"


@dataclass
class _Stored:
    """All points on disk as they are going to be written, with their places in the ranking."""

    path: Path
    header: LasHeader
    layout: las.Layout
    counts: dict[str, Any]  # what the header is going to say of them
    gps_time: NDArray[np.float64]  # (2,)
    lost: list[str]  # what the file does not hold, in words
    records: NDArray[Any]  # (n,), the points of the first chunk
    dropped: int = 0  # points that are not finite, and so are left out

    @property
    def kind(self) -> np.dtype[Any]:
        """The type of a record on disk."""
        return np.dtype([(RANK, "<i4"), (POINT, self.layout.record)])

    def followed_by(self, chunk: _Stored) -> _Stored:
        """Return what is known with another chunk, which has to be stored in the same way."""
        if chunk.layout.record != self.layout.record or chunk.header.block != self.header.block:
            found = "expected the same attributes in all files, and coordinates in steps of one scale, found others; "
            hint = "or convert the files to LAZ of one scale and offset first"
            raise InputError(f"{found}raise memory=, {hint}", command=f"{found}raise --memory, {hint}")
        known, new = self.counts, chunk.counts
        if new["count"]:
            known["bounds"][:, 0] = np.maximum(known["bounds"][:, 0], new["bounds"][:, 0])
            known["bounds"][:, 1] = np.minimum(known["bounds"][:, 1], new["bounds"][:, 1])
        counts = {**known, "count": known["count"] + new["count"], "returns": known["returns"] + new["returns"]}
        span = np.array([min(self.gps_time[0], chunk.gps_time[0]), max(self.gps_time[1], chunk.gps_time[1])])
        return replace(self, counts=counts, gps_time=span)

    def blocks(self) -> Iterator[NDArray[Any]]:
        """Yield the records."""
        with open(self.path, "rb") as file:
            while len(block := np.fromfile(file, self.kind, BLOCK)):
                yield block

    def places(self, records: NDArray[Any]) -> NDArray[np.float64]:
        """Return the coordinates of some records."""
        fields = self.header.fields()
        return las.coordinates_of(records[POINT], fields["scales"][0], fields["offsets"][0])


class Levels(NamedTuple):
    """How points are divided among levels."""

    of_ranked: NDArray[np.uint8]  # (k,), of each point that is ranked
    ends: list[float]  # shares of the other points on each level and those above
    closing: NDArray[np.uint8]  # (cells,), the level on which each cell of the grid takes all points left in it


def write_beyond_memory(
    target: Path, files: CloudFiles, levels_by: str | None, drop: bool, work: Work, force: bool, lossy: bool
) -> list[str] | None:
    """Write a COPC file of files, and return in words what it does not hold; None if they fit into memory."""
    request = Request.of(
        n_points=copc.ranked_of(files.head().points), method=levels_by or copc.ORDERS[0],
        invalid="drop" if drop else "error",
    )  # fmt: skip
    planned = work.planned(files, request)
    if planned.in_memory:
        return None
    unread = files.left_out()[1]
    dropped, lost = _write(target, files, planned, request, work, force, lossy)
    invalid = [f"points with NaN or infinite coordinates ({dropped:,})"] if dropped else []
    return [*unread, *invalid, *lost]


def _write(
    target: Path, files: CloudFiles, planned: Plan, request: Request, work: Work, force: bool, lossy: bool
) -> tuple[int, list[str]]:
    """Write a COPC file, and return how many points were not finite, and in words what the file does not hold."""
    head = files.head().cloud
    row = las.layout_to_write(copc.FORMAT.fit(head.take(head.finite_rows())).cloud).record.itemsize + 4
    ranking = run(files, request, work, planned).result.indices
    with scratch_folder(work.scratch, planned.points * row) as folder, whole_output(target, force) as file:
        with work.timer("points to disk", planned.points) as advanced:
            stored = _stored(target, files, folder / "points.raw", ranking, request.invalid == "drop", lossy, advanced)
        with work.timer("levels"):
            high, low = stored.counts["bounds"].T
            cube = Cube.around(low, high, stored.header.fields()["scales"][0])
            codes, others, root = _counted(stored, cube, len(ranking))
            levels = levels_of_counts(codes, others)
            pieces = _sorted_by_nodes(stored, cube, levels)
        with work.timer("writing", planned.points) as advanced:
            keys = np.unique(pieces[:, 0])
            nodes = [Node(int(key >> 48), int(key & (1 << 48) - 1)) for key in keys]
            octree = Octree(cube, copc.spacing_of(root, cube), stored.gps_time)
            with open(stored.path, "rb") as scratch:
                records = _nodes(scratch, stored.layout.record, pieces, advanced)
                copc.write_octree(file, stored.header, stored.layout, stored.counts, octree, nodes, records)
    return stored.dropped, stored.lost


def _stored(
    target: Path, files: CloudFiles, path: Path, ranking: NDArray[np.int64], drop: bool, lossy: bool, advanced: Any
) -> _Stored:
    """Store all points in a file."""
    order = np.argsort(ranking)
    rows, begin, stored = ranking[order], 0, None
    with open(path, "wb") as file:
        for cloud in files.chunks(True):
            some = slice(*np.searchsorted(rows, [begin, begin + len(cloud)]))
            ranks = np.full(len(cloud), -1, np.int32)
            ranks[rows[some] - begin] = order[some]
            begin += len(cloud)
            usable = cloud.finite_rows() if drop else np.arange(len(cloud))
            chunk = _chunk(target, path, stored, cloud.take(usable), lossy)
            stored = chunk if stored is None else stored.followed_by(chunk)
            stored.dropped += len(cloud) - len(usable)
            records = np.empty(len(usable), stored.kind)
            records[RANK], records[POINT] = ranks[usable], chunk.records
            records.tofile(file)
            advanced(len(cloud))
    assert stored is not None
    return stored


def _chunk(target: Path, path: Path, stored: _Stored | None, cloud: PointCloud, lossy: bool) -> _Stored:
    """Return what is known of a chunk, which follows others."""
    fit = copc.FORMAT.fit(cloud if stored is None else replace(cloud, header=stored.header))
    if not lossy:
        refuse_losses(target, copc.FORMAT.name, fit.values)
    cloud, layout = fit.cloud, las.layout_to_write(fit.cloud)
    times = np.asarray(cloud.attributes.get("gps_time", np.zeros(1)), np.float64)
    span = np.array([times.min(initial=np.inf), times.max(initial=-np.inf)])
    return _Stored(
        path, las.header_of(cloud), layout, las.counts_of(cloud), span, [*fit.values, *fit.remarks],
        las.records_of(cloud, layout),
    )  # fmt: skip


def _counted(
    stored: _Stored, cube: Cube, ranked: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the cells of the ranked points in their order, the number of the others in each, and the first places."""
    codes, others = np.empty(ranked, np.int64), np.zeros(8**GRID, np.int64)
    root = np.empty((min(ranked, copc.ROOT), 3))
    for block in stored.blocks():
        places, rank = stored.places(block), block[RANK]
        cells = cube.codes(places) >> 3 * (copc.DEEPEST - GRID)
        others += np.bincount(cells[rank < 0], minlength=len(others))
        codes[rank[rank >= 0]] = cells[rank >= 0]
        first = (rank >= 0) & (rank < len(root))
        root[rank[first]] = places[first]
    return codes, others, root


def levels_of_counts(codes: NDArray[np.int64], others: NDArray[np.int64]) -> Levels:
    """Divide points among levels as `copc_writing.levels_of` does, where the others are only counted.

    Shapes: codes (k,), in the order of the ranking, others (cells,).
    """
    most = copc.MOST - SPREAD * np.sqrt(copc.MOST)
    levels = Levels(np.zeros(len(codes), np.uint8), [], np.full(len(others), NEVER, np.uint8))
    left, still, level, done, share = np.arange(len(codes)), others.astype(np.float64), 0, 0.0, 0.0
    while True:
        size = 8 ** min(level, GRID)
        cells = codes[left] // (len(others) // size)
        of_others = still.reshape(size, -1).sum(axis=1)
        counts = np.bincount(cells, minlength=size) + of_others
        if counts.max() <= most or level > GRID:
            levels.of_ranked[left] = level
            levels.ends.append(1.0)
            return levels
        wanted = int((copc.ROOT << copc.GROWTH * level) - done)
        first = cells[:wanted]
        full = np.flatnonzero(np.bincount(first) > most)
        taken = min((int(np.flatnonzero(first == cell)[int(most)]) for cell in full), default=len(first))
        part = 0.0
        if taken == len(left):
            room = (most - np.bincount(first, minlength=size))[of_others > 0] / of_others[of_others > 0]
            part = min((wanted - taken) / of_others.sum(), room.min())
        closed = (counts <= most) & (done + wanted > len(codes))
        now = (np.arange(len(left)) < taken) | closed[cells]
        levels.of_ranked[left[now]] = level
        left = left[~now]
        cells_closed = np.repeat(closed, len(others) // size)
        levels.closing[cells_closed & (levels.closing == NEVER)] = level
        before = still.sum()
        still *= 1 - part
        still[cells_closed] = 0.0
        share += part * (1 - share)
        levels.ends.append(share)
        done += np.count_nonzero(now) + before - still.sum()
        level += 1


def _sorted_by_nodes(stored: _Stored, cube: Cube, levels: Levels) -> NDArray[np.int64]:
    """Sort each block by nodes, in place and without ranks, and return the pieces: node, first point, number of points.

    Shapes: returns (pieces, 3).
    """
    pieces, position = [], 0
    with open(stored.path, "r+b") as file:
        for number, block in enumerate(stored.blocks()):
            codes, rank = cube.codes(stored.places(block)), block[RANK]
            chance = np.random.default_rng(number).random(len(block))
            level = np.searchsorted(levels.ends, chance, side="right")
            level = np.minimum(level, levels.closing[codes >> 3 * (copc.DEEPEST - GRID)])
            level[rank >= 0] = levels.of_ranked[rank[rank >= 0]]
            keys = level << 48 | codes >> 3 * (copc.DEEPEST - level)
            order = np.argsort(keys, kind="stable")
            found, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
            pieces.append(np.column_stack([found, position + starts, counts]))
            # Before what is still to be read, whose records are longer.
            file.seek(position * stored.layout.record.itemsize)
            file.write(np.ascontiguousarray(block[POINT][order]).tobytes())
            position += len(block)
    return np.concatenate(pieces)


def _nodes(file: BinaryIO, record: np.dtype[Any], pieces: NDArray[np.int64], advanced: Any) -> Iterator[NDArray[Any]]:
    """Yield the points of each node, in the order of the nodes."""
    pieces = pieces[np.argsort(pieces[:, 0], kind="stable")]
    for node in np.split(pieces, np.flatnonzero(np.diff(pieces[:, 0])) + 1):
        found = np.empty(node[:, 2].sum(), record)
        begin = 0
        for _, start, count in node.tolist():
            file.seek(start * record.itemsize)
            found[begin : begin + count] = np.frombuffer(file.read(count * record.itemsize), record)
            begin += count
        advanced(len(found))
        yield found
