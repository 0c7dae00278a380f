"""The method `gp` on points on disk: the steps of `gppcs.gp.local.algorithm`, part by part, each part with a halo.

The first stages, whose candidates are no more than those of a part, are chosen in memory. In each later stage, all
parts choose down to one score, the *level*. A part chooses with its halo, as if nothing lay beyond, and keeps what it
chose in itself: what lies beyond the halo is too far away to matter. Parts that are farther apart than a halo choose at
once; these are a class. The classes follow one another in a fixed order. A part takes what earlier classes chose in its
halo as given, and chooses nothing more there. At the end the points with the largest scores of all stay, exactly as
many as wanted. So the number of points in a part follows the density that the field asks for, and no seam shows.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.timer import Timer
from gppcs.gp.local.algorithm import Criterion, Ranking, Scale, features_of, local_field, rank
from gppcs.gp.local.candidates import (
    DISTANCES,
    ENOUGH,
    FIRST_STAGE,
    PER_POINT,
    SMALLEST_AREA,
    TOO_MANY,
    cell_edge,
    gaps_of_lone,
    largest_gap,
    nested_candidates,
    sample_size,
    sharpness_of,
    thinned,
)
from gppcs.gp.local.density import FINEST, WEIGHT_POWER
from gppcs.gp.local.detail import WITHIN, Detail, DetailNoise, residuals
from gppcs.gp.local.greedy import extend, next_step
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.placement import MOST, PROJECTED, exchanged
from gppcs.spatial.boxes import Each, Part, classes
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.kdtree import KdTree, surface_area
from gppcs.spatial.row_sample import drawn
from gppcs.spatial.stored import Neighbourhood, Run, StoredPoints, within, write_run
from gppcs.surface.noise import FEWEST, NEIGHBOURS, SAMPLES, Layer, Noise, Observations, projections
from gppcs.surface.surface_variation import Features

PART = 1 << 17  # Candidates of a part at most. With fewer, halos cost more than the parts themselves.
CELLS_ON_SLOPES = 1.5  # Occupied cells for each that a surface along the grid occupies.
SURVEYED = 16  # Parts in which the noise, and the scale and the level of a stage, are measured, at most.
HALO = 6.0  # In target spacings. 3 give the same points as 24, but for one in a hundred (research/experiments.md).
DIAGONAL = math.sqrt(3.0)  # Of a cell, in edge lengths. A halo this wide holds all points of the cells of a part.
FIXED = -1.0  # Stands for the gap of a point that is chosen from the start, and so is a candidate of every stage.
LOWEST = 1e-6  # Below this level, all candidates are chosen.
NOT_MEASURED = np.empty(0, dtype=np.float32)


@dataclass(frozen=True)
class _Stage:
    """A stage of the choice, as the tasks of its parts need it."""

    stored: StoredPoints  # All points; once they are found, the candidates of the last stage
    target: int  # Number of points that are chosen when the stage ends
    area: float  # Area of the surface
    density: float  # Number of candidate cells in a square whose side is the target spacing
    thinned: bool  # Whether candidates are one in each cell; otherwise they are all points
    noise: Noise  # Without a tree: each part has one of its own
    criterion: Criterion
    detail: DetailNoise | None  # Of the attributes that count beside the shape, if there are any, and more than noise
    largest_gap: float = math.inf  # Candidates of the last stage that are farther from all others are outliers
    scale: Scale | None = None  # What the field of a part needs to know of all parts

    @property
    def spacing(self) -> float:
        """The target spacing."""
        return cell_edge(self.area, self.target)

    @property
    def edge(self) -> float:
        """The edge length of the cells."""
        return cell_edge(self.area, self.density * self.target)

    @property
    def halo(self) -> float:
        """Width of the halo of a part."""
        return HALO * self.spacing

    def file(self, part: Part) -> Path:
        """Return the file of the candidates of a part and its halo."""
        return self.stored.folder / f"{self.target}-{part.first}.features"

    @property
    def measured(self) -> np.dtype[Any]:
        """The type of the records in that file."""
        features: list[Any] = [("inside", np.bool_), ("variation", np.float64), ("normal", np.float64, 3)]
        return np.dtype([*self.stored.kind.descr, *features])


class _Chosen(NamedTuple):
    """Chosen points, with what a `Ranking` tells of them."""

    rows: NDArray[np.int64]  # (n,)
    places: NDArray[np.float64]  # (n, 3)
    # (n,) each.
    scores: NDArray[np.float64]
    deviations: NDArray[np.float64]

    def and_those(self, further: _Chosen) -> _Chosen:
        """Return these points and further ones behind."""
        return _Chosen._make(map(np.concatenate, zip(self, further, strict=True)))


NO_POINTS = _Chosen(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty(0), np.empty(0))


class _Asked(NamedTuple):
    """A part, and what is chosen in it and its halo: rows, (m,), and places, (m, 3)."""

    part: Part
    rows: NDArray[np.int64]
    places: NDArray[np.float64]

    @classmethod
    def of(cls, part: Part, halo: float, rows: NDArray[np.int64], places: NDArray[np.float64]) -> _Asked:
        """Return a part with those of the chosen points that lie in it and its halo."""
        near = within(places, part.low - halo, part.high + halo)
        return cls(part, rows[near], places[near])


def choose_stored(
    stored: StoredPoints,
    n_points: int,
    criterion: Criterion,
    density: float,
    timer: Timer,
    each: Each,
    fixed: NDArray[np.int64],
    fixed_places: NDArray[np.float64],
) -> Ranking:
    """Choose `n_points` of points on disk; the rows `fixed` are chosen from the start.

    There may be fewer different places; then all of them are chosen. Shapes: fixed (m,), fixed_places (m, 3) without
    repeats.
    """
    density *= min(1.0 / stored.mean_weight, FINEST)
    parts = stored.parts(2 * PART)
    with timer("survey"):
        tree = KdTree.build(stored.sample)
        target, alike = max(1, len(stored.sample) // PER_POINT), np.zeros(len(stored.sample), dtype=np.float32)
        area, _ = thinned(stored.sample, alike, target, surface_area(tree), density)
        noise = _noise(stored, n_points, area, parts, each)
        detail = _noise_of_detail(stored, n_points, cell_edge(area, density * n_points), parts, each)
    stage = _Stage(stored, n_points, area, density, True, noise, criterion, detail)
    with timer("candidates", len(stored)) as advanced:
        stage = _with_candidates(stage, parts, each, advanced, fixed, fixed_places)
        nested = [stage]
        while nested[-1].target > max(FIRST_STAGE, len(fixed), PART / (CELLS_ON_SLOPES * density)):
            nested.append(_coarser(nested[-1], each))
    chosen = _in_memory(nested.pop(), each, timer, fixed)
    while nested:
        chosen = _in_parts(nested.pop(), each, timer, chosen)
    with timer("placement", len(stored)) as advanced:
        rows = _placed(replace(stage, stored=stored), parts, each, advanced, chosen, fixed)
    level = noise.level / noise.spacing if noise.spacing > 0.0 else 0.0
    return Ranking(rows, chosen.scores, chosen.deviations, level)


def _with_candidates(
    stage: _Stage,
    parts: list[Part],
    each: Each,
    advanced: Callable[[int], None],
    fixed: NDArray[np.int64],
    fixed_places: NDArray[np.float64],
) -> _Stage:
    """Return the last stage with its candidates in place of all points, and with an area that fits their number.

    The area is doubled or quartered. If even that leaves too few candidates, all points are candidates.
    """
    many, few = TOO_MANY * stage.density * stage.target, ENOUGH * stage.target
    asked = [_Asked.of(part, 0.0, fixed, fixed_places) for part in parts]
    kind = _kind(stage)

    def found(stage: _Stage) -> tuple[StoredPoints, NDArray[np.int64]]:
        counts, lone = np.zeros(len(stage.stored.boxes), dtype=np.int64), np.zeros(len(DISTANCES), dtype=np.int64)
        runs = []
        for one, (run, of_part, of_lone) in zip(
            asked, each(partial(_store_candidates, stage, kind), asked), strict=True
        ):
            runs.append(run)
            counts += of_part
            lone += of_lone
            advanced(int(stage.stored.counts[one.part.first : one.part.last].sum()))
        return replace(stage.stored, counts=counts, runs=tuple(runs), kind=kind), lone

    thin, lone = found(stage)
    while len(thin) > many:
        stage = replace(stage, area=2.0 * stage.area)
        thin, lone = found(stage)
    while len(thin) < few and len(stage.stored) > many and stage.area > SMALLEST_AREA:
        before, stage = len(thin), replace(stage, area=stage.area / 4.0)
        thin, lone = found(stage)
        if len(thin) == before:  # there are no more places
            break
    if len(thin) < few:
        stage = replace(stage, thinned=False)
        thin, lone = found(stage)
    largest = largest_gap(lone, len(thin), stage.target, stage.spacing) if stage.thinned else math.inf
    return replace(stage, stored=thin, largest_gap=largest)


def _kind(stage: _Stage) -> np.dtype[Any]:
    """Return the type of the records of candidates."""
    observed: list[Any] = [] if stage.noise.quiet else [("variance", np.float64)]
    observed += [("foot", np.float64, 3)] if stage.noise.thick and not stage.noise.quiet else []
    observed += [("rough", np.float32)] if stage.detail else []
    return np.dtype([*stage.stored.kind.descr, ("sharpness", np.float32), ("gap", np.float64), *observed])


def _store_candidates(
    stage: _Stage, kind: np.dtype[Any], asked: _Asked
) -> tuple[Run, NDArray[np.int64], NDArray[np.int64]]:
    """Store the candidates of a part for the last stage; return their numbers in each box, and those of lone ones."""
    stored, noise = stage.stored, stage.noise
    margin = DIAGONAL * stage.edge + DISTANCES[-1] * stage.spacing  # the points of a fit lie within 1.2 spacings
    near = stored.near(asked.part, margin, repeats=True)
    points = near.points
    some = np.flatnonzero(drawn(near.rows, sample_size(stage.target) / len(stored)))
    some = some[first_occurrences(points[some])]
    tree = KdTree.build(points[some]) if len(some) else None
    sharpness, rough = (np.zeros(len(points), dtype=np.float32) for _ in range(2))
    if noise.clean and tree:  # otherwise noisy points would look sharp
        sharpness[some] = sharpness_of(tree, stage.edge)
    if stage.detail and tree:
        some = some[tree.order]
        values = near.records["detail"][some].astype(np.float64)
        rough[some] = stage.detail.variation(residuals(tree, values, WITHIN * stage.edge))
        sharpness += rough
    kept = greatest_in_cells(points, stage.edge, sharpness) if stage.thinned else np.arange(len(points))
    gaps = gaps_of_lone(points[kept], stage.spacing) if stage.thinned else np.zeros(len(kept))
    own = near.inside[kept]
    kept, gaps = kept[own], gaps[own]
    lone = np.count_nonzero(gaps[:, None] > np.multiply(DISTANCES, stage.spacing), axis=0)
    fixed = np.flatnonzero(np.isin(near.rows, asked.rows))
    kept, gaps = np.concatenate([fixed, kept]), np.concatenate([np.full(len(fixed), FIXED), gaps])
    first = first_occurrences(points[kept])
    kept, gaps = kept[first], gaps[first]
    records = np.zeros(len(kept), dtype=kind)
    for name in stored.kind.names or ():
        records[name] = near.records[name][kept]
    records["sharpness"], records["gap"] = sharpness[kept], gaps
    if stage.detail:
        records["rough"] = rough[kept]
    if not noise.quiet:
        feet, records["variance"] = replace(noise, tree=tree).observe(points[kept])
        if feet is not None:
            records["foot"] = feet
    return *write_run(stored.folder, f"{asked.part.first}.candidates", stored.boxes, records), lone


def _candidates(stage: _Stage, width: float, part: Part) -> Neighbourhood:
    """Read the candidates of a part and its halo, without outliers."""
    near = stage.stored.near(part, width, repeats=True)
    return near.take(np.flatnonzero(near.records["gap"] <= stage.largest_gap))


def _coarser(stage: _Stage, each: Each) -> _Stage:
    """Return the stage with half as many points. Its candidates are among those of the finer stage, or all of these."""
    coarser = replace(stage, target=-(-stage.target // 2))
    runs, counts = zip(*each(partial(_thin, coarser), stage.stored.parts(PART)), strict=True)
    thin = replace(stage.stored, runs=runs, counts=np.sum(counts, axis=0))
    if len(thin) < ENOUGH * coarser.target:
        return replace(coarser, thinned=False)
    return replace(coarser, stored=thin, thinned=True)


def _thin(stage: _Stage, part: Part) -> tuple[Run, NDArray[np.int64]]:
    """Store one of the candidates of a finer stage for each cell, and those that are fixed."""
    near = _candidates(stage, DIAGONAL * stage.edge, part)
    kept = near.records["gap"] == FIXED
    kept[greatest_in_cells(near.points, stage.edge, np.ascontiguousarray(near.records["sharpness"]))] = True
    name = f"{stage.target}-{part.first}.candidates"
    return write_run(stage.stored.folder, name, stage.stored.boxes, near.records[kept & near.inside])


def _in_memory(stage: _Stage, each: Each, timer: Timer, fixed: NDArray[np.int64]) -> _Chosen:
    """Choose the points of the first stages in memory."""
    with timer("candidates"):
        found = [near.records for near in each(partial(_candidates, stage, 0.0), stage.stored.parts(PART))]
        records = np.concatenate(found)
        order = np.argsort(records["row"])
        # The fixed points come first, in their order.
        first = order[np.searchsorted(records["row"][order], fixed)]
        records = records[np.concatenate([first, np.setdiff1d(order, first, assume_unique=True)])]
        places = np.ascontiguousarray(records["place"])
        sharpness = np.ascontiguousarray(records["sharpness"])
        target = min(stage.target, len(records))
        candidates = nested_candidates(places, sharpness, target, stage.area, stage.density, len(fixed))
    weights = _weights(records)
    last = records[candidates[-1].rows]
    observations, detail = _observations(last), _detail(stage, last)
    ranking = rank(places, candidates, observations, stage.criterion, timer, len(fixed), weights, detail)
    rows = ranking.rows
    return _Chosen(records["row"][rows], places[rows], ranking.scores, ranking.deviations)


def _observations(records: NDArray[Any]) -> Observations:
    """Return the observations at candidates."""
    names = records.dtype.names or ()
    feet = np.ascontiguousarray(records["foot"]) if "foot" in names else None
    return Observations(feet, records["variance"] if "variance" in names else np.zeros(len(records)))


def _weights(records: NDArray[Any]) -> NDArray[np.float64] | None:
    """Return the weights of candidates, if they have any."""
    return records["weight"] if "weight" in (records.dtype.names or ()) else None


def _detail(stage: _Stage, records: NDArray[Any]) -> Detail | None:
    """Return the detail at candidates."""
    if stage.detail is None:
        return None
    return Detail.of(stage.detail, records["detail"], np.ascontiguousarray(records["rough"]))


def _in_parts(stage: _Stage, each: Each, timer: Timer, chosen: _Chosen) -> _Chosen:
    """Choose the points of a further stage part by part, behind those that are chosen."""
    wanted, parts = stage.target - len(chosen.rows), stage.stored.parts(PART)
    with timer("features", len(stage.stored)) as advanced:
        variation = []
        for part, of_part in zip(parts, each(partial(_measure, stage), parts), strict=True):
            variation.append(of_part)
            advanced(int(stage.stored.counts[part.first : part.last].sum()))
        stage = _scaled(stage, np.concatenate(variation, axis=1), parts, each)
    added = NO_POINTS
    with timer("greedy selection", wanted) as advanced:
        before, level = len(chosen.rows), float(chosen.scores[-1]) if len(chosen.rows) else 1.0
        while (count := len(added.rows)) < wanted:
            for of_part in _round(stage, parts, each, level, chosen.and_those(added)):
                added = added.and_those(of_part)
            advanced(min(len(added.rows), wanted) - count)
            if level == 0.0:
                break
            level = level * next_step(before + len(added.rows), before + wanted) if level > LOWEST else 0.0
    for part in parts:
        stage.file(part).unlink()
    best = np.lexsort([added.rows, -added.scores])[:wanted]
    return chosen.and_those(_Chosen._make(values[best] for values in added))


def _measure(stage: _Stage, part: Part) -> NDArray[np.float64]:
    """Keep the candidates of a part and its halo with their features in a file; return how rough some are."""
    near = _candidates(stage, stage.halo, part)
    tree, features = features_of(near.points, _observations(near.records).feet, stage.spacing, stage.thinned)
    near = near.take(tree.order)
    records = np.empty(len(near.records), stage.measured)
    for name in near.records.dtype.names or ():
        records[name] = near.records[name]
    records["inside"], records["variation"], records["normal"] = (
        near.inside,
        features.surface_variation,
        features.normals,
    )
    unfinished = stage.file(part).with_suffix(f".{uuid4().hex}")
    records.tofile(unfinished)
    os.replace(unfinished, stage.file(part))
    rough = records["rough"] if stage.detail else np.zeros(len(records))
    found = np.stack([features.surface_variation, rough])[:, near.inside]
    return found[:, :: max(1, found.shape[1] // SAMPLES)]


def _scaled(stage: _Stage, variation: NDArray[np.float64], parts: list[Part], each: Each) -> _Stage:
    """Return the stage with the scale of the field."""
    scale = Scale.of(variation[0], stage.criterion, variation[1])
    raw = replace(stage, scale=scale)
    squares = np.concatenate(list(each(partial(_squared, raw), _some(parts))))
    return replace(stage, scale=scale._replace(spacing=math.sqrt(float(np.mean(squares)))))


def _some(items: list[Any]) -> list[Any]:
    """Return the surveyed ones of many."""
    return items[:: -(-len(items) // SURVEYED)]


def _field(stage: _Stage, part: Part) -> tuple[Neighbourhood, LocalField]:
    """Return the candidates of a part and its halo in the order of a tree, and the field over them."""
    records = np.fromfile(stage.file(part), stage.measured)
    tree = KdTree.over(np.ascontiguousarray(records["place"].T) / stage.spacing)
    variation, normals = (np.ascontiguousarray(records[name]) for name in ("variation", "normal"))
    features = Features(variation, normals, np.zeros(0, dtype=np.int64))
    variances = _observations(records).variances / stage.spacing**2
    field = local_field(tree, features, variances, stage.criterion, _detail(stage, records), stage.scale)
    if (weights := _weights(records)) is not None:
        field = field._replace(spacings=field.spacings * weights ** (-0.5 * WEIGHT_POWER))
    return Neighbourhood(records, np.ascontiguousarray(records["inside"])), field


def _squared(stage: _Stage, part: Part) -> NDArray[np.float64]:
    """Return 1 / spacing^2 of the candidates of a part, before it is scaled."""
    near, field = _field(stage, part)
    return field.spacings[near.inside] ** -2.0


def _round(stage: _Stage, parts: list[Part], each: Each, level: float, chosen: _Chosen) -> Iterator[_Chosen]:
    """Yield what each part chooses down to a level, after what is chosen."""
    settled = np.zeros(len(stage.stored.boxes), dtype=np.bool_)
    for some in classes(parts, stage.halo):
        asked = [_Asked.of(part, stage.halo, chosen.rows, chosen.places) for part in some]
        for added in each(partial(_choose, stage, level, settled), asked):
            yield added
            chosen = chosen.and_those(added)
        settled = settled.copy()
        for part in some:
            settled[part.first : part.last] = True


def _choose(stage: _Stage, level: float, settled: NDArray[np.bool_], asked: _Asked) -> _Chosen:
    """Choose the candidates of a part with a score of at least `level`; nothing in boxes that are `settled`."""
    near, field = _field(stage, asked.part)
    chosen = np.isin(near.rows, asked.rows)
    some = np.flatnonzero(chosen | ~settled[stage.stored.boxes.box_of(near.points)])
    tree = KdTree.over(np.ascontiguousarray(field.positions[:, some]))
    field = LocalField(
        tree.points, np.ascontiguousarray(field.normals[:, some]), field.spacings[some], field.y[some],
        field.noise[some], np.ascontiguousarray(field.detail[:, some]), field.lengthscale, field.normal_weight,
    )  # fmt: skip
    criterion, before = stage.criterion, np.flatnonzero(chosen[some])
    most = len(some) - len(before)
    added, scores, deviations = extend(field, tree, before, most, criterion.neighbours, criterion.error_weight, level)
    near, own = near.take(some[added]), near.inside[some[added]]
    return _Chosen(near.rows[own], near.points[own], scores[own], deviations[own])


def _placed(
    stage: _Stage,
    parts: list[Part],
    each: Each,
    advanced: Callable[[int], None],
    chosen: _Chosen,
    fixed: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the rows of the chosen points once they are placed, part by part, as `gppcs.gp.local.placement` does."""
    new, order = chosen.rows.copy(), np.argsort(chosen.rows)
    asked = [_Asked.of(part, 0.5 * stage.halo, chosen.rows, chosen.places) for part in parts]
    for one, (old, other) in zip(asked, each(partial(_place, stage, fixed), asked), strict=True):
        new[order[np.searchsorted(chosen.rows[order], old)]] = other
        advanced(int(stage.stored.counts[one.part.first : one.part.last].sum()))
    return new


def _place(stage: _Stage, fixed: NDArray[np.int64], asked: _Asked) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the chosen rows of a part that give their places to others, and those others."""
    stored, noise, part, halo = stage.stored, stage.noise, asked.part, 0.5 * stage.halo
    of_place = stored.boxes.box_of(asked.places)
    stays = (of_place < part.first) | (of_place >= part.last) | np.isin(asked.rows, fixed)
    near = stored.near(part, halo)
    if stays.all():
        return asked.rows[:0], asked.rows[:0]
    if not noise.quiet:
        some = drawn(near.rows, sample_size(stage.target) / len(stored))
        noise = replace(noise, tree=KdTree.build(near.points[some]))
    share = min(1.0, (MOST if noise.quiet else PROJECTED) * stage.target / len(stored))
    old = detail = None
    if stage.detail:
        alike = KdTree.build(near.points).nearest_of(asked.places, 1)[0][:, 0]  # repeats are not there
        detail = Detail.of(stage.detail, near.records["detail"], NOT_MEASURED).values
        old = detail[alike]
    few = np.flatnonzero(drawn(near.rows, share))
    near, detail = near.take(few), detail if detail is None else detail[few]
    area = stage.area / (share * len(stored))
    new = exchanged(asked.places, stays, near.points, area, noise, old, detail, farthest=0.5 * halo)
    moved = np.flatnonzero(new >= 0)
    return asked.rows[moved], near.rows[new[moved]]


def _noise(stored: StoredPoints, n_points: int, area: float, parts: list[Part], each: Each) -> Noise:
    """Measure the noise as `Noise.measure` does, in some parts."""
    share, spacing = min(1.0, sample_size(n_points) / len(stored)), math.sqrt(area / n_points)
    count = int(np.pi * share * len(stored) / n_points)
    if count < FEWEST:
        return Noise(None, count, False, 0.0, True, True, spacing)
    fits = sorted({NEIGHBOURS, 2 * NEIGHBOURS, min(count, NEIGHBOURS), min(count, 2 * NEIGHBOURS)})
    some = _some(parts)
    measure = partial(_distances, stored, share, 0.5 * HALO * spacing, fits, -(-SAMPLES // len(some)))
    found = np.concatenate(list(each(measure, some)), axis=2)
    layers = {k: Layer.of(*of_fit) for k, of_fit in zip(fits, found, strict=True)}
    return Noise.from_layers(layers.__getitem__, count, spacing)


def _noise_of_detail(
    stored: StoredPoints, n_points: int, edge: float, parts: list[Part], each: Each
) -> DetailNoise | None:
    """Measure what is noise of the attributes that count beside the shape, in some parts."""
    if "detail" not in (stored.kind.names or ()):
        return None
    measure = partial(_residuals, stored, min(1.0, sample_size(n_points) / len(stored)), WITHIN * edge)
    found = np.concatenate(list(each(measure, _some(parts))))
    return DetailNoise.of(found[:, 0], found[:, 1:]) if len(found) else None


def _residuals(stored: StoredPoints, share: float, radius: float, part: Part) -> NDArray[np.float64]:
    """Return what linear functions leave of the detail of a part's points, and the detail, (n, 1 + k)."""
    near = stored.near(part, radius)
    near = near.take(np.flatnonzero(drawn(near.rows, share)))
    tree = KdTree.build(near.points)
    values = near.records["detail"][tree.order].astype(np.float64)
    return np.column_stack([residuals(tree, values, radius), values])[near.inside[tree.order]]


def _distances(
    stored: StoredPoints, share: float, halo: float, fits: list[int], most: int, part: Part
) -> NDArray[np.float64]:
    """Return how far about `most` points of a part lie off quadrics, and the radii of their neighbourhoods.

    Shapes: returns (numbers of neighbours, 2, points).
    """
    near = stored.near(part, halo)
    near = near.take(np.flatnonzero(drawn(near.rows, share)))
    if not near.inside.any():
        return np.zeros((len(fits), 2, 0))
    tree = KdTree.build(near.points)
    inside = np.flatnonzero(near.inside[tree.order])
    places = KdTree.over(np.ascontiguousarray(tree.points[:, inside[:: max(1, len(inside) // most)]]))
    found = []
    for count in fits:
        feet, fitted = projections(tree, places, count)
        found.append([np.sqrt(((feet - places.points) ** 2).sum(axis=0)), fitted.reaches])
    return np.array(found)
