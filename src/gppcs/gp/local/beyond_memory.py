"""The method `gp` on points on disk: the steps of `gppcs.gp.local.algorithm`, part by part, each part with a halo.

The stages whose candidates fit into memory are chosen there. In each later stage, all parts choose down to one score,
the *level*. A part chooses with its halo, as if nothing lay beyond, and keeps what it chose in itself: what lies beyond
the halo is too far away to matter. Parts that are farther apart than a halo choose at once; these are a class. The
classes follow one another in a fixed order. A part takes what earlier classes chose in its halo as given, and chooses
nothing more there. At the end the points with the largest scores of all stay, exactly as many as wanted. So the number
of points in a part follows the density that the field asks for, and no seam shows.
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

from gppcs.engine.stages import Stages
from gppcs.gp.local.algorithm import Criterion, Ranking, Scale, features_of, local_field, rank
from gppcs.gp.local.candidates import (
    ENOUGH,
    SMALLEST_AREA,
    TOO_MANY,
    Candidates,
    cell_edge,
    corrected_area,
    gaps_of_lone,
    largest_gap,
    nested_candidates,
    numbers_of_lone,
)
from gppcs.gp.local.greedy import FALL, SPARE, STEP, extend_down_to
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.survey import PER_POINT, sample_size, sharpness_within
from gppcs.gp.local.weighing import FINEST, Weighing
from gppcs.spatial.boxes import Each, Part, classes
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.row_sample import drawn
from gppcs.spatial.spacing import surface_area
from gppcs.spatial.stored import StoredPoints
from gppcs.surface.noise import FEWEST, NEIGHBOURS, SAMPLES, WIDEST, Layer, Noise, Observations, projections
from gppcs.surface.surface_variation import Features

PART = 1 << 18  # Points of a part at most. With fewer, halos cost more than the parts themselves.
IN_MEMORY = 20_000  # Points that are chosen in memory at most, with about 450 bytes for each of 12 candidates.
SURVEYED = 16  # Parts in which the noise and the scale of a stage are measured, at most.
HALO = 6.0  # In target spacings. 3 give the same points as 24, but for one in a hundred (docs/experiments.md).
NOISE_HALO = 3.0  # In target spacings of the last stage: the points of a fit lie within 1.2 of them.
DIAGONAL = math.sqrt(3.0)  # Of a cell, in edge lengths. A halo this wide holds all points of the cells of a part.
LOWER = 0.98  # The first level, in units of the last score of the stage before. Fields of all stages are much alike.
VARIATIONS = 4096  # Candidates of a part whose surface variation tells the scale of the field.
LOWEST = 1e-6  # Below this level, all candidates are chosen.
NO_POINTS = Ranking(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))


@dataclass(frozen=True)
class _Stage:
    """A stage of the choice, as the tasks of its parts need it.

    Attributes
    ----------
    stored : StoredPoints
    target : int
        Number of points that are chosen when the stage ends.
    area : float
        Area of the surface.
    density : float
        Number of candidate cells in a square whose side is the target spacing.
    thinned : bool
        Whether candidates are one in each cell; otherwise they are all points.
    noise : Noise
        Without a tree: each part has one of its own.
    criterion : Criterion
    power : float
        Of the weights.
    scale : Scale, optional
        What the field of a part needs to know of all parts.
    largest_gap : float
        Candidates that are farther from all others are outliers.
    """

    stored: StoredPoints
    target: int
    area: float
    density: float
    thinned: bool
    noise: Noise
    criterion: Criterion
    power: float = 1.0
    scale: Scale | None = None
    largest_gap: float = math.inf

    def candidates(self, count: int) -> Candidates:
        """Return so many candidates of a part."""
        return Candidates(self.target, np.arange(count), self.thinned, self.area)

    @property
    def spacing(self) -> float:
        """The target spacing."""
        return math.sqrt(self.area / self.target) or 1.0

    @property
    def halo(self) -> float:
        """Width of the halo of a part."""
        return HALO * self.spacing

    def file(self, part: Part) -> Path:
        """Return the file of the candidates of a part and its halo."""
        return self.stored.folder / f"{self.target}-{part.first}.npz"


class _Found(NamedTuple):
    """The candidates of a part and its halo; (n,) each, places and feet (n, 3). `feet` is empty without thick noise."""

    rows: NDArray[np.int64]
    places: NDArray[np.float64]
    inside: NDArray[np.bool_]
    sharpness: NDArray[np.float32]
    variances: NDArray[np.float64]
    feet: NDArray[np.float64]
    weights: NDArray[np.float64]

    @property
    def observations(self) -> Observations:
        """The observations at the candidates."""
        return Observations(self.feet if len(self.feet) else None, self.variances)

    def take(self, some: NDArray[np.int64] | NDArray[np.bool_]) -> _Found:
        """Return some of the candidates."""
        return _Found._make(values[some] if len(values) else values for values in self)


def choose_stored(
    stored: StoredPoints,
    n_points: int,
    criterion: Criterion,
    density: float,
    stages: Stages,
    each: Each,
    fixed: NDArray[np.int64],
    fixed_places: NDArray[np.float64],
) -> Ranking:
    """Choose `n_points` of points on disk; the rows `fixed` are chosen from the start.

    There may be fewer different places; then all of them are chosen.

    Shapes: fixed (m,), fixed_places (m, 3) without repeats.
    """
    density *= min(1.0 / stored.mean_weight, FINEST)
    parts = stored.parts(PART)
    with stages("survey"):
        tree = KdTree.build(stored.sample)
        area = corrected_area(stored.sample, max(1, len(stored.sample) // PER_POINT), surface_area(tree), density)
        noise = _noise(stored, n_points, area, parts, each)
    targets = [n_points]
    while targets[-1] > max(IN_MEMORY, len(fixed)):
        targets.append(-(-targets[-1] // 2))
    stage = _Stage(stored, targets[-1], area, density, True, noise, criterion)
    ranking, places, stage = _in_memory(stage, parts, each, stages, fixed, fixed_places)
    for target in targets[-2::-1]:
        stage = replace(stage, target=target, scale=None, thinned=True)
        ranking, places, stage = _in_parts(stage, parts, each, stages, ranking, places)
    level = noise.level / noise.spacing if noise.spacing > 0.0 else 0.0
    return ranking._replace(noise_in_spacings=level)


def _in_memory(
    stage: _Stage,
    parts: list[Part],
    each: Each,
    stages: Stages,
    fixed: NDArray[np.int64],
    fixed_places: NDArray[np.float64],
) -> tuple[Ranking, NDArray[np.float64], _Stage]:
    """Choose the points of the first stages in memory; return the ranking, its places, and the stage with its area."""
    asked = [_Asked(part, *_near(part, 0.0, fixed, fixed_places)) for part in parts]
    with stages("candidates", len(stage.stored)) as advanced:

        def found_at(stage: _Stage) -> tuple[int, list[_Found]]:
            found = []
            for candidates in each(partial(_inside, stage), asked):
                found.append(candidates)
                advanced(len(stage.stored) // len(parts))
            return sum(len(some.rows) for some in found), found

        stage, found = _fitting(stage, found_at)
        every = _Found._make(map(np.concatenate, zip(*found, strict=True)))
        every = every.take(np.argsort(every.rows))
        # The fixed points come first, in their order.
        back = np.argsort(fixed)
        first = np.empty_like(back)
        first[back] = np.searchsorted(every.rows, fixed[back])
        every = every.take(np.concatenate([first, np.delete(np.arange(len(every.rows)), first)]))
        target = min(stage.target, len(every.rows))
        candidates = nested_candidates(every.places, every.sharpness, target, stage.area, stage.density, len(fixed))
    weighing = Weighing(every.weights) if stage.stored.weighted else None
    observations = every.observations.take(candidates[-1].rows)
    ranking = rank(every.places, candidates, observations, stage.criterion, stages, len(fixed), weighing)
    stage = replace(stage, area=candidates[-1].area, power=weighing.power if weighing else 1.0)
    return ranking._replace(rows=every.rows[ranking.rows]), every.places[ranking.rows], stage


def _in_parts(
    stage: _Stage, parts: list[Part], each: Each, stages: Stages, ranking: Ranking, places: NDArray[np.float64]
) -> tuple[Ranking, NDArray[np.float64], _Stage]:
    """Choose the points of a further stage part by part; return the extended ranking, its places, and the stage."""
    with stages("features", len(stage.stored)) as advanced:

        def measured_at(stage: _Stage) -> tuple[int, list[_Look]]:
            asked = [_Asked(part, *_near(part, stage.halo, ranking.rows, places)) for part in parts]
            looks = []
            for look in each(partial(_measure, stage), asked):
                looks.append(look)
                advanced(len(stage.stored) // len(parts))
            return sum(look.candidates for look in looks), looks

        stage, looks = _fitting(stage, measured_at)
        stage = _scaled(stage, looks, parts, each)
    before, level = len(ranking.rows), LOWER * float(ranking.scores[-1]) if len(ranking.rows) else 1.0
    added, added_places = NO_POINTS, np.empty((0, 3))
    wanted = stage.target - before
    with stages("greedy selection", wanted) as advanced:
        while (count := len(added.rows)) < wanted:
            known = np.concatenate([ranking.rows, added.rows]), np.concatenate([places, added_places])
            for some_added, some_places in _round(stage, parts, each, level, *known):
                added = added.extended(some_added.rows, some_added.scores, some_added.deviations)
                added_places = np.concatenate([added_places, some_places])
            advanced(min(len(added.rows), wanted) - count)
            if level == 0.0:
                break
            fall = ((before + len(added.rows)) / (before + SPARE * wanted)) ** FALL
            level = level * max(STEP, fall) if level > LOWEST else 0.0
    for part in parts:
        stage.file(part).unlink(missing_ok=True)
    best = np.lexsort([added.rows, -added.scores])[:wanted]
    extended = ranking.extended(added.rows[best], added.scores[best], added.deviations[best])
    return extended, np.concatenate([places, added_places[best]]), stage


def _scaled(stage: _Stage, looks: list[_Look], parts: list[Part], each: Each) -> _Stage:
    """Return the stage with what its parts together tell: the scale of the field, and which candidates are outliers."""
    count, numbers = sum(look.candidates for look in looks), np.sum([look.lone for look in looks], axis=0)
    largest = largest_gap(numbers, count, stage.target, stage.spacing) if stage.thinned else math.inf
    scale = Scale.of(np.concatenate([look.variation for look in looks]), stage.criterion)
    stage = replace(stage, largest_gap=largest, scale=scale._replace(spacing=1.0))
    squares = np.concatenate(list(each(partial(_squared, stage), parts[:: -(-len(parts) // SURVEYED)])))
    return replace(stage, scale=scale._replace(spacing=math.sqrt(float(np.mean(squares)))))


class _Asked(NamedTuple):
    """A part, and what is chosen in it and its halo: rows, (m,), and places, (m, 3)."""

    part: Part
    rows: NDArray[np.int64]
    places: NDArray[np.float64]


def _near(
    part: Part, halo: float, rows: NDArray[np.int64], places: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the chosen points in a part and its halo."""
    near = ((places >= part.low - halo) & (places <= part.high + halo)).all(axis=1)
    return rows[near], places[near]


def _fitting(stage: _Stage, found_at: Callable[[_Stage], tuple[int, Any]]) -> tuple[_Stage, Any]:
    """Return the stage with an area that fits the number of occupied cells, and what is found with it.

    The area is doubled or quartered. If even that leaves too few candidates, all points are candidates.
    """
    many, few = TOO_MANY * stage.density * stage.target, ENOUGH * stage.target
    count, found = found_at(stage)
    while count > many:
        stage = replace(stage, area=2.0 * stage.area)
        count, found = found_at(stage)
    while count < few and len(stage.stored) > many and stage.area > SMALLEST_AREA:
        before, stage = count, replace(stage, area=stage.area / 4.0)
        count, found = found_at(stage)
        if count == before:  # there are no more places
            break
    if count < few:
        stage = replace(stage, thinned=False)
        count, found = found_at(stage)
    return stage, found


def _candidates(stage: _Stage, halo: float, asked: _Asked) -> _Found:
    """Find the candidates of a part and its halo. What is chosen is among them, in front and in its order."""
    stored, edge, m = stage.stored, cell_edge(stage.area, stage.density * stage.target), len(asked.rows)
    margin = max(DIAGONAL * edge, 0.0 if stage.noise.quiet else NOISE_HALO * stage.noise.spacing)
    near = stored.near(asked.part, halo + margin)
    some = np.flatnonzero(drawn(near.rows, sample_size(stage.target) / len(stored)))
    tree = KdTree.build(near.points[some]) if len(some) else None
    sharpness = np.zeros(len(near.rows), dtype=np.float32)
    if stage.noise.clean and tree:  # otherwise noisy points would look sharp
        sharpness[some] = sharpness_within(tree, edge)
    kept = greatest_in_cells(near.points, edge, sharpness) if stage.thinned else np.arange(len(near.rows))
    low, high = asked.part.low - halo, asked.part.high + halo
    kept = kept[near.inside[kept] | ((near.points[kept] >= low) & (near.points[kept] <= high)).all(axis=1)]
    box = stored.boxes.box_of(asked.places)
    places = np.concatenate([asked.places, near.points[kept]])
    weights = np.empty(0)
    if near.weights is not None:
        at = dict(zip(near.rows.tolist(), near.weights.tolist(), strict=True))
        weights = np.array([*(at.get(row, 1.0) for row in asked.rows.tolist()), *near.weights[kept].tolist()])
    feet, variances = replace(stage.noise, tree=None if stage.noise.quiet else tree).observe(places)
    found = _Found(
        np.concatenate([asked.rows, near.rows[kept]]),
        places,
        np.concatenate([(box >= asked.part.first) & (box < asked.part.last), near.inside[kept]]),
        np.concatenate([np.zeros(m, dtype=np.float32), sharpness[kept]]),
        variances,
        np.empty((0, 3)) if feet is None else feet,
        weights,
    )
    return found.take(first_occurrences(places))


def _inside(stage: _Stage, asked: _Asked) -> _Found:
    """Find the candidates of a part alone."""
    found = _candidates(stage, 0.0, asked)
    return found.take(found.inside)


class _Look(NamedTuple):
    """What a part tells of a stage: its number of candidates, how many are lone, and some surface variations."""

    candidates: int
    lone: NDArray[np.int64]
    variation: NDArray[np.float64]


def _measure(stage: _Stage, asked: _Asked) -> _Look:
    """Find the candidates of a part and its halo with their features, and keep them in a file."""
    found = _candidates(stage, stage.halo, asked)
    tree, features = features_of(found.places, found.observations, stage.candidates(len(found.rows)))
    gaps = gaps_of_lone(found.places, stage.spacing) if stage.thinned else np.zeros(len(found.rows))
    gaps[: len(asked.rows)] = 0.0
    found, order = found.take(tree.order), np.empty_like(tree.order)
    order[tree.order] = np.arange(len(tree.order))
    unfinished = stage.file(asked.part).with_suffix(f".{uuid4().hex}.npz")
    np.savez(
        unfinished, **found._asdict(), gaps=gaps[tree.order], variation=features.surface_variation,
        normals=features.normals, chosen=order[: len(asked.rows)],
    )  # fmt: skip
    os.replace(unfinished, stage.file(asked.part))
    inside = np.flatnonzero(found.inside)
    some = inside[:: max(1, len(inside) // VARIATIONS)]
    return _Look(
        len(inside), numbers_of_lone(gaps[tree.order][inside], stage.spacing), features.surface_variation[some]
    )


def _field(stage: _Stage, part: Part) -> tuple[_Found, LocalField, NDArray[np.float64]]:
    """Return the candidates of a part and its halo in the order of a tree, the field over them, and their gaps."""
    with np.load(stage.file(part)) as file:
        found = _Found._make(file[name] for name in _Found._fields)
        gaps, variation, normals = file["gaps"], file["variation"], file["normals"]
    tree = KdTree.over(np.ascontiguousarray(found.places.T) / stage.spacing)
    features = Features(variation, normals, np.zeros(0, dtype=np.int64))
    field = local_field(tree, features, found.variances / stage.spacing**2, stage.criterion, stage.scale)
    if stage.stored.weighted:
        field = field._replace(spacings=field.spacings * found.weights ** (-0.5 * stage.power))
    return found, field, gaps


def _squared(stage: _Stage, part: Part) -> NDArray[np.float64]:
    """Return 1 / spacing^2 of the candidates of a part, before it is scaled."""
    found, field, _ = _field(stage, part)
    return field.spacings[found.inside] ** -2.0


def _choose(
    stage: _Stage, level: float, settled: NDArray[np.bool_], asked: _Asked
) -> tuple[Ranking, NDArray[np.float64]]:
    """Choose the candidates of a part with a score of at least `level`; nothing in boxes that are `settled`."""
    found, field, gaps = _field(stage, asked.part)
    chosen = np.isin(found.rows, asked.rows)
    open_ = chosen | (~settled[stage.stored.boxes.box_of(found.places)] & (gaps <= stage.largest_gap))
    some = np.flatnonzero(open_)
    tree = KdTree.over(np.ascontiguousarray(field.positions[:, some]))
    field = LocalField(
        tree.points, np.ascontiguousarray(field.normals[:, some]), field.spacings[some], field.y[some],
        field.noise[some], field.lengthscale, field.normal_weight,
    )  # fmt: skip
    before = np.flatnonzero(chosen[some])
    criterion = stage.criterion
    added, scores, deviations = extend_down_to(level, field, tree, before, criterion.neighbours, criterion.error_weight)
    own = found.inside[some[added]]
    rows = some[added[own]]
    return Ranking(found.rows[rows], scores[own], deviations[own]), found.places[rows]


def _round(
    stage: _Stage, parts: list[Part], each: Each, level: float, rows: NDArray[np.int64], places: NDArray[np.float64]
) -> Iterator[tuple[Ranking, NDArray[np.float64]]]:
    """Yield what each part chooses down to a level, after what is chosen."""
    settled = np.zeros(len(stage.stored.boxes), dtype=np.bool_)
    for some in classes(parts, stage.halo):
        asked = [_Asked(part, *_near(part, stage.halo, rows, places)) for part in some]
        for added, added_places in each(partial(_choose, stage, level, settled), asked):
            yield added, added_places
            rows, places = np.concatenate([rows, added.rows]), np.concatenate([places, added_places])
        settled = settled.copy()
        for part in some:
            settled[part.first : part.last] = True


def _noise(stored: StoredPoints, n_points: int, area: float, parts: list[Part], each: Each) -> Noise:
    """Measure the noise as `Noise.measure` does, in some parts."""
    share, spacing = min(1.0, sample_size(n_points) / len(stored)), math.sqrt(area / n_points)
    within = int(np.pi * share * len(stored) / n_points)
    if within < FEWEST:
        return Noise(None, within, False, 0.0, False, spacing)
    fits = sorted({*(NEIGHBOURS << i for i in range((WIDEST // NEIGHBOURS).bit_length())), min(within, WIDEST)})
    some = parts[:: -(-len(parts) // SURVEYED)]
    measure = partial(_distances, stored, share, NOISE_HALO * spacing, fits, -(-SAMPLES // len(some)))
    found = np.concatenate(list(each(measure, some)), axis=2)
    layers = {k: Layer.of(*of_fit) for k, of_fit in zip(fits, found, strict=True)}
    return Noise.from_layers(layers.__getitem__, within, spacing)


def _distances(
    stored: StoredPoints, share: float, halo: float, fits: list[int], most: int, part: Part
) -> NDArray[np.float64]:
    """Return how far about `most` points of a part lie off quadrics, and the radii of their neighbourhoods.

    Shapes: returns (numbers of neighbours, 2, points).
    """
    near = stored.near(part, halo)
    some = np.flatnonzero(drawn(near.rows, share))
    if not len(some):
        return np.zeros((len(fits), 2, 0))
    tree = KdTree.build(near.points[some])
    inside = np.flatnonzero(near.inside[some][tree.order])
    places = KdTree.over(np.ascontiguousarray(tree.points[:, inside[:: max(1, len(inside) // most)]]))
    found = []
    for count in fits:
        feet, radii = projections(tree, places, count)
        found.append([np.sqrt(((feet.points - places.points) ** 2).sum(axis=0)), radii])
    return np.array(found)
