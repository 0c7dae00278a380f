"""A cloud that does not fit into memory: its survey, and a first choice that guides the tiles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gppcs.amounts.choice import task_of
from gppcs.amounts.constraints import Constraints, check_constraints, check_finite
from gppcs.amounts.options import Options
from gppcs.clouds.quantities import Scale, units_of
from gppcs.clouds.ranges import Details
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Selection
from gppcs.spatial.boxes import Boxes, Tile
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame
from gppcs.spatial.spacing import surface_area
from gppcs.streaming.graph import Engine
from gppcs.streaming.passes import outliers_in_tile
from gppcs.streaming.plan import Plan
from gppcs.streaming.rows import Rows
from gppcs.streaming.scratch import write_arrays
from gppcs.streaming.source import Part, Source, sorted_once
from gppcs.streaming.survey import Overview, read_all
from gppcs.streaming.tiles import Guide, Tiling

T = TypeVar("T")

TILE = 1 << 19  # Points of a tile at most, without its halo.
SAMPLED_PER_CHOSEN = 26  # Points of the sample for each point of the first choice, at least.
FIRST = 0.05  # Fraction of the kept points that all tiles keep from the first choice.
HALO = 6.0  # In target spacings.
MAX_RATIO = math.log(8.0)  # Of a density to that of the first choice, from the middle one: few points tell little.
PILOT, BLOCK = 1 << 19, 400  # Points of the pilot choice, about, and kept points of each of its blocks.
REREADINGS = 3  # Of files whose points lie near each other, rather than to sort them once.


@dataclass(frozen=True, eq=False)
class Survey:
    """A cloud whose points can be read by boxes, and what the first reading found out about it."""

    parts: list[Part]
    overview: Overview
    source: Source
    options: Options
    frame: Frame
    folder: Path
    run_on: Engine
    timer: Timer

    @classmethod
    def read(
        cls, files: CloudFiles, plan: Plan, options: Options, scratch: Path, folder: Path, run_on: Engine, timer: Timer
    ) -> Survey:
        """Read a cloud once or twice; check that it can be simplified as the options ask for.

        Tiles will be stored in `folder`, and what no later run needs, in `scratch`.
        """
        part = max(1 << 20, plan.points_in // 10_000)  # so that a scheduler has at most 10,000 tasks
        overview, parts = read_all(files.parts(part), plan.points_in, options, run_on, timer)
        check_finite(overview.count, overview.n_bad, overview.first_bad, options.invalid)
        check_constraints(options, int(overview.keep.sum()), overview.max_weight)
        frame = Frame.from_bounds(overview.lower, overview.upper, units_of(options.unit, overview.columns.header))
        boxes = Boxes.from_sample(overview.sample.points, overview.lower, overview.upper, overview.n_usable)
        source = Source(parts, boxes, overview.sample.take(np.arange(0)), np.empty(0, dtype=np.int64))
        survey = cls(parts, overview, source, options, frame, folder, run_on, timer)
        if files.has_copies or not survey.parts_lie_together():
            runs = sorted_once(parts, boxes, scratch, run_on, timer)
            survey = replace(survey, source=replace(source, pieces=runs))
        return survey.without_outliers() if options.drop_outliers else survey

    def parts_lie_together(self) -> bool:
        """Return whether tiles meet so few files that it is cheaper to read these than to sort all points."""
        tile_of_box = self.tiling(np.zeros(3)).tile_of_box
        met = [len(np.unique(tile_of_box[self.source.boxes.meeting(part.lower, part.upper)])) for part in self.parts]
        counts = [part.count or 0 for part in self.parts]
        return np.dot(met, counts) <= REREADINGS * self.overview.count

    @property
    def n_points(self) -> int:
        """Number of points among which is chosen."""
        return self.overview.count - self.overview.n_bad - len(self.source.excluded)

    @cached_property
    def scale(self) -> Scale:
        """What turns lengths of the options into those of the frame."""
        lower, upper = self.frame.local(np.array([self.overview.lower, self.overview.upper]))
        diagonal = float(np.linalg.norm(upper - lower))
        return Scale(diagonal, units_of(self.options.unit, self.overview.columns.header), self.frame.exponent)

    @cached_property
    def details(self) -> Details:
        """The attributes that count beside the shape."""
        return Details.from_cloud(self.overview.sample.attributes, self.options.details)

    @cached_property
    def area(self) -> float:
        """Area of the surface, in the frame."""
        return surface_area(KdTree.build(self.frame.local(self.overview.sample.points)))

    def run(
        self, stage: str, task: Callable[[int], T], tiling: Tiling, before: Sequence[Sequence[int]] = ()
    ) -> list[T]:
        """Do a task in each tile, after it is done in some others."""
        with self.timer(stage, len(tiling.tiles)) as on_progress:
            return self.run_on.run(task, range(len(tiling.tiles)), before, on_progress)

    def without_outliers(self) -> Survey:
        """Return the survey of all points but the outliers."""
        tiling = self.tiling(np.zeros(3))
        of_tiles = self.run("outliers", partial(outliers_in_tile, tiling), tiling)
        outliers = Rows.joined(rows for rows, _ in of_tiles)
        corners = np.array([corners for _, corners in of_tiles])
        stays = ~np.isin(self.overview.sample.indices, outliers.indices)
        overview = replace(
            self.overview,
            lower=corners[:, 0].min(axis=0),
            upper=corners[:, 1].max(axis=0),
            sample=self.overview.sample.only(stays),
            hashes=self.overview.hashes[stays],
            labels=self.overview.labels - np.bincount(outliers.labels, minlength=256),
            keep=self.overview.keep - np.bincount(outliers.labels[outliers.keep], minlength=256),
        )
        excluded = np.union1d(self.source.excluded, outliers.indices)
        return replace(self, overview=overview, source=replace(self.source, excluded=excluded))

    def tiling(self, halo: Floats, fraction: float = 1.0, **more: Any) -> Tiling:
        """Divide the cloud into tiles, of as many points that take part in the choice."""
        tiles = self.nodes(TILE / fraction)
        return Tiling(self.source, self.options, self.frame, tiles, halo, fraction, self.details, self.folder, **more)

    def nodes(self, n_points: float) -> list[Tile]:
        """Return the largest nodes of the tree of boxes with at most so many points, about."""
        counts = np.bincount(self.source.boxes.box_of(self.overview.sample.points), minlength=len(self.source.boxes))
        return self.source.boxes.tiles(counts * (self.overview.n_usable / len(self.overview.sample)), n_points)

    def tiling_for(self, n_points: int) -> tuple[Tiling, Mapping[str, float]]:
        """Return the tiles for a choice of a number of points besides those to keep, after a first choice in a sample.

        Returns the diagnostics of that, too.
        """
        sample = self.overview.sample
        holds_all = self.overview.n_places <= len(sample)
        n_chosen = n_points if holds_all else min(n_points, len(sample) // SAMPLED_PER_CHOSEN + 1)
        chosen, selection = self.choose(sample, n_chosen)
        mass = self._mass(chosen)
        if n_chosen < n_points and selection.scale is not None:
            finer, ratios = self._pilot(n_points, mass)
            mass *= ratios
            if finer.scale is not None:
                selection = replace(finer, scale=selection.scale.refined(finer.scale))
        halo = self.frame.lengths(np.full(3, HALO * math.sqrt(self.area / n_points)))
        fraction = min(1.0, self.options.algorithm.points_per_kept * n_points / self.overview.n_places)
        tiling = self.tiling(halo, fraction, n_points=n_points, scale=selection.scale)
        self.write_guide(tiling, chosen, mass, min(int(FIRST * n_points), len(chosen) // 2))
        return tiling, selection.diagnostics

    def choose(self, rows: Rows, n_points: int) -> tuple[Ints, Selection]:
        """Choose among rows in memory; return which ones, in the order of choice, and what the method returned."""
        constraints = Constraints(weights=rows.columns.get("weight"), columns=rows.attributes.attributes)
        points = self.frame.local(rows.points)
        task, indices, _ = task_of(points, self.options, constraints, self.details, self.timer)
        if n_points >= len(indices):
            return indices, Selection(np.arange(len(indices)), ranked=False)
        selection = self.options.algorithm(replace(task, n_points=max(1, n_points)))
        return indices[selection.indices], selection

    def _mass(self, chosen: Ints) -> Floats:
        """Return how many of the chosen points of the sample each of its points stands for, (n,)."""
        points = self.frame.local(self.overview.sample.points)
        nearest = KdTree.build(points[chosen]).nearest_of(points, 1)[0][:, 0]
        return 1.0 / np.bincount(nearest, minlength=len(chosen))[nearest]

    def _pilot(self, n_points: int, mass: Floats) -> tuple[Selection, Floats]:
        """Choose in blocks spread over the cloud, as densely as in the whole: a sample is too sparse for that.

        Returns also by which factor more points are chosen than by the choice in the sample where each of its points
        is, (n,), up to a common one: what is measured in the blocks, and a power of the density elsewhere.
        """
        fraction = min(1.0, SAMPLED_PER_CHOSEN * n_points / self.overview.n_places)
        blocks = self.nodes(BLOCK * self.overview.n_usable / n_points)
        n_drawn = math.ceil(len(blocks) * min(1.0, PILOT / (fraction * self.overview.n_usable)))
        drawn = np.sort(np.random.default_rng(0).permutation(len(blocks))[:n_drawn])
        block_of_box = np.repeat(np.arange(len(blocks)), [block.last - block.first for block in blocks])
        read = partial(self.source.read_piece, np.isin(block_of_box, drawn), fraction)
        rows = self.source.ordered(Rows.joined(self.run_on.run(read, self.source.pieces)))
        chosen, selection = self.choose(rows, round(len(rows) / (fraction * self.overview.n_places) * n_points))
        of_sample, of_chosen = (
            block_of_box[self.source.boxes.box_of(points)]
            for points in (self.overview.sample.points, rows.points[chosen])
        )
        size, expected, actual = (
            np.bincount(of_point, weights, len(blocks)).clip(1e-3)
            for of_point, weights in ((of_sample, None), (of_sample, mass), (of_chosen, None))
        )
        density, ratio = np.log(expected / size), np.log(actual / expected)
        if n_drawn > 2:
            ratio[:] = np.poly1d(np.polyfit(density[drawn], ratio[drawn], 1, w=np.sqrt(expected[drawn])))(density)
        ratio[drawn] = np.log(actual[drawn] / expected[drawn])
        middle = float(np.median(ratio))
        return selection, np.exp(np.clip(ratio - middle, -MAX_RATIO, MAX_RATIO))[of_sample]

    def write_guide(self, tiling: Tiling, chosen: Ints, mass: Floats, n_first: int) -> None:
        """Write what tiles need to know of the choice in the sample."""
        from gppcs.surface.normals import estimate_normals

        sample = self.overview.sample
        normals = estimate_normals(self.frame.local(sample.points)) if self.options.normals else None
        mass = np.where(sample.keep, 0.0, mass)  # where all points stay, none is added
        mass /= mass.sum() or 1.0
        guide = Guide(sample.points, mass, sample.points[chosen], sample.indices[chosen[:n_first]], normals)
        write_arrays(tiling.guide_file, vars(guide))
