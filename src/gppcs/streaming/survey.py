"""The first reading of a cloud: it counts, and draws a sample in which a first choice is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.constraints import mask_of, weights_of
from gppcs.amounts.options import Options
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.joining import JointColumns
from gppcs.spatial.samples import HASHES, point_hashes
from gppcs.spatial.scaling import bounds
from gppcs.streaming.graph import Engine
from gppcs.streaming.rows import Rows
from gppcs.streaming.source import Part

SAMPLED = 1 << 18  # Points of the sample at most.
DRAWN = 4.0  # Points that parts draw at first, for each of these, as some lie at the same place.


@dataclass
class Overview:
    """What the first reading finds out about a cloud, or about a part of it. Overviews of parts are merged."""

    count: int = 0  # of points
    n_bad: int = 0  # of points that are not finite
    first_bad: int = 0  # index of the first of these
    lower: Floats = field(default_factory=lambda: np.full(3, np.inf))  # (3,), of the points that may be kept
    upper: Floats = field(default_factory=lambda: np.full(3, -np.inf))
    columns: JointColumns = field(default_factory=JointColumns)
    max_weight: float = 0.0
    # (256,) each, by quota: number of the points that may be kept, and of those to keep.
    labels: Ints = field(default_factory=lambda: np.zeros(256, dtype=np.int64))
    keep: Ints = field(default_factory=lambda: np.zeros(256, dtype=np.int64))
    # Points of different places, all whose hashes are below a limit.
    sample: Rows = field(default_factory=lambda: Rows(np.empty(0, np.int64), np.empty((0, 3)), {}))
    hashes: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, dtype=np.uint64))
    limit: float = HASHES

    @property
    def n_usable(self) -> int:
        """Number of points that may be kept."""
        return int(self.labels.sum())

    @property
    def n_places(self) -> int:
        """How many of these are different: about, by their hashes, if not all are sampled (Bar-Yossef et al. 2002)."""
        estimate = round(len(self.hashes) * HASHES / self.limit)
        return self.n_usable if self.limit < HASHES and estimate > 0.75 * self.n_usable else estimate

    def add(self, other: Overview) -> None:
        """Add the overview of the next points."""
        if other.n_bad and not self.n_bad:
            self.first_bad = self.count + other.first_bad
        self.columns.merge(other.columns)
        self.lower, self.upper = np.minimum(self.lower, other.lower), np.maximum(self.upper, other.upper)
        self.max_weight = max(self.max_weight, other.max_weight)
        self.labels, self.keep = self.labels + other.labels, self.keep + other.keep
        self.limit = min(self.limit, other.limit)
        is_drawn = other.hashes < self.limit
        drawn = replace(other.sample, indices=other.sample.indices + self.count).only(is_drawn)
        hashes, first = np.unique(np.concatenate([self.hashes, other.hashes[is_drawn]]), return_index=True)
        if len(hashes) > SAMPLED:
            self.limit = min(self.limit, float(hashes[SAMPLED]))
        number = np.searchsorted(hashes, self.limit)
        self.hashes, self.sample = hashes[:number], Rows.joined([self.sample, drawn]).take(first[:number])
        self.count, self.n_bad = self.count + other.count, self.n_bad + other.n_bad


def read_all(
    sources: Sequence[CloudFiles], n_points: int, options: Options, run_on: Engine, timer: Timer
) -> tuple[Overview, list[Part]]:
    """Read all of about so many points once; return what is learnt of the cloud, and of its parts."""
    parts = _parts(sources, options, run_on)
    with timer("reading", len(parts)) as on_progress:
        limit = HASHES * min(1.0, DRAWN * SAMPLED / max(1, n_points))
        overviews = run_on.run(partial(_read, limit), parts, on_progress=on_progress)
    overview, measured = Overview(), []
    for part, of_part in zip(parts, overviews, strict=True):
        box = {"lower": of_part.lower, "upper": of_part.upper}
        measured.append(replace(part, first=overview.count, count=of_part.count, **box))
        overview.add(of_part)
    return overview, measured


def _parts(sources: Sequence[CloudFiles], options: Options, run_on: Engine) -> list[Part]:
    """Return the parts of a cloud, each with its entries of the arrays among the options."""
    parts = [Part(files, options) for files in sources]
    if isinstance(options.keep, str | None) and isinstance(options.weight, str | None):
        return parts
    ends = np.cumsum(run_on.run(_count, parts)).tolist()
    if not isinstance(options.keep, str | None):
        options = replace(options, keep=mask_of(options.keep, ends[-1]))
    if not isinstance(options.weight, str | None):
        options = replace(options, weight=weights_of(options.weight, ends[-1]))
    whole = Part(sources[0], options)
    return [
        replace(part, options=whole.of_chunk(first, end - first))
        for part, first, end in zip(parts, [0, *ends], ends, strict=False)
    ]


def _count(part: Part) -> int:
    return sum(len(cloud) for _, cloud in part.clouds())


def _read(limit: float, part: Part) -> Overview:
    """Read a part, count its points, and draw among those whose hashes are below a limit."""
    overview = Overview(limit=limit)
    for first, cloud in part.clouds():
        rows = Rows.from_cloud(cloud, 0, part.of_chunk(first, len(cloud)))
        of_chunk = Overview(count=len(cloud))
        of_chunk.columns.add(cloud)
        is_finite = cloud.is_finite()
        if not is_finite.all():
            of_chunk.n_bad, of_chunk.first_bad = int((~is_finite).sum()), int(np.argmin(is_finite))
        of_chunk.lower, of_chunk.upper = bounds(rows.points)
        of_chunk.max_weight = float(rows.column("weight").max(initial=0.0))
        of_chunk.labels = np.bincount(rows.labels, minlength=256)
        of_chunk.keep = np.bincount(rows.labels[rows.keep], minlength=256)
        of_chunk.sample, of_chunk.hashes = rows, point_hashes(rows.points, size=1.0)
        overview.add(of_chunk)
    return overview
