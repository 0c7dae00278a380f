"""The method `gp` on points on disk: the steps of `gppcs.gp.local.algorithm`, part by part, each part with a halo.

The first stages, whose candidates are no more than those of a part, are chosen in memory. In each later stage, all
parts choose down to one score, as `gppcs.spatial.boxes.chosen_by_classes` says. At the end the points with the largest
scores of all stay. So the number of points in a part follows the density that the field asks for, and no seam shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.recfunctions import require_fields
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.gp.local.algorithm import (
    Candidates,
    Criterion,
    FieldScale,
    Ranking,
    choose_in_stages,
    features_of,
    local_field,
)
from gppcs.gp.local.candidates import (
    cell_edge,
    cells_for,
    count_isolated,
    gaps_of_isolated,
    largest_gap,
    nested_candidates,
    radius_of_plane,
    radius_of_sharpness,
    sample_size,
    sharpness_of,
    thinned,
    vanishes,
)
from gppcs.gp.local.detail import FIT_RADIUS, Detail, DetailNoise, residuals
from gppcs.gp.local.greedy import extend, next_step
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.placement import replacements
from gppcs.gp.local.settings import (
    CELL_POINTS,
    FIRST_STAGE,
    ISOLATION,
    MAX_CELLS,
    MAX_REFINEMENT,
    MIN_CANDIDATES,
    NOISY_CELL_POINTS,
    SAMPLED_PER_POINT,
    SHEET_VARIATION,
)
from gppcs.gp.local.sheets import has_thin_parts, runs_of, toward_other_sheet
from gppcs.spatial.boxes import MapParts, Part, chosen_by_classes
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import is_drawn
from gppcs.spatial.spacing import surface_area
from gppcs.spatial.stored import RECORD, Neighbourhood, Run, StoredPoints, write_at_once, write_run
from gppcs.surface.noise import FEWEST, NEIGHBOURS, SAMPLES, Noise, NoiseLayer, projections
from gppcs.surface.surface_variation import Features, features_in_radius

PART = 1 << 18  # Candidates of a part at most. With fewer, halos cost more than the parts themselves.
HALO = 6.0  # In target spacings. 3 give the same points as 24, but for one in a hundred (research/experiments.md).
FIXED = -1.0  # Stands for the gap of a point that is chosen from the start, and so is a candidate of every stage.
CHOSEN = np.dtype([*RECORD.descr, ("score", np.float64), ("deviation", np.float64)])


@dataclass(frozen=True)
class StoredStage:
    """A stage of the choice, as the tasks of its parts need it."""

    stored: StoredPoints  # All points; in the choice, the candidates of the last stage
    target: int  # Number of points that are chosen when the stage ends
    area: float  # Area of the surface
    candidate_density: float  # Number of candidate cells in a square whose side is the target spacing
    thinned: bool  # Whether candidates are one in each cell; otherwise they are all points
    noise: Noise  # Without a tree: each part has one of its own
    criterion: Criterion
    detail: DetailNoise | None  # Of the attributes that count beside the shape, if there are any, and more than noise
    has_thin_parts: bool = False  # Whether candidates have the normals of their sheets
    largest_gap: float = math.inf  # Candidates of the last stage that are farther from all others are outliers
    scale: FieldScale | None = None  # What the field of a part needs to know of all parts

    @property
    def spacing(self) -> float:
        """The target spacing."""
        return cell_edge(self.area, self.target)

    @property
    def edge(self) -> float:
        """The edge length of the cells."""
        return cell_edge(self.area, self.candidate_density * self.target)

    @property
    def diagonal(self) -> float:
        """The diagonal of a cell: a halo this wide holds all points of the cells of a part."""
        return math.sqrt(3.0) * self.edge

    @property
    def halo(self) -> float:
        """Width of the halo of a part."""
        return HALO * self.spacing

    @property
    def sampled(self) -> float:
        """The fraction of the different points that is in the sample on which noise and sharpness are measured."""
        return min(1.0, sample_size(self.target) / self.stored.n_places)

    def file(self, part: Part) -> Path:
        """Return the file of the candidates of a part and its halo."""
        return self.stored.folder / f"{self.target}-{part.first}.features"

    @property
    def measured(self) -> np.dtype[Any]:
        """The type of the records in that file."""
        features: list[Any] = [("inside", np.bool_), ("variation", np.float64), ("normal", np.float64, 3)]
        return np.dtype([*self.stored.kind.descr, *features])


def choose_stored(
    stored: StoredPoints,
    n_points: int,
    criterion: Criterion,
    candidate_density: float,
    timer: Timer,
    map_parts: MapParts,
    fixed: Ints,
    fixed_points: Floats,
) -> Ranking:
    """Choose `n_points` of points on disk, or all if fewer are different, behind those at the indices `fixed`.

    Shapes: fixed (m,), fixed_points (m, 3) without repeats.
    """
    candidate_density *= min(1.0 / stored.mean_weight, MAX_REFINEMENT)
    parts = stored.parts(2 * PART)
    chosen = np.zeros(len(fixed), dtype=CHOSEN)
    chosen["row"], chosen["place"] = fixed, fixed_points
    with timer("survey"):
        stage = _surveyed(stored, n_points, criterion, candidate_density, parts, map_parts)  # step 1
    with timer("candidates", len(stored)) as on_progress:
        stage = _with_candidates(stage, parts, map_parts, on_progress, chosen)  # step 2
        nested = [stage]
        in_memory = PART / (1.5 * stage.candidate_density)  # there are 1.5 times as many cells on slopes
        while nested[-1].target > max(FIRST_STAGE, len(fixed), in_memory):
            nested.append(_coarser(nested[-1], map_parts))
    chosen = _in_memory(nested.pop(), map_parts, timer, fixed)  # Eqs. (2) to (9)
    while nested:
        chosen = _in_parts(nested.pop(), map_parts, timer, chosen)
    with timer("placement", len(stored)) as on_progress:
        indices = _placed(replace(stage, stored=stored), parts, map_parts, on_progress, chosen, fixed)  # Eq. (10)
    return Ranking(indices, chosen["score"], chosen["deviation"], stage.noise.in_spacings)


def _surveyed(
    stored: StoredPoints,
    n_points: int,
    criterion: Criterion,
    candidate_density: float,
    parts: list[Part],
    map_parts: MapParts,
) -> StoredStage:
    """Return the last stage, still without candidates: area and noise are measured, the latter in some parts."""
    tree = KdTree.build(stored.sample)
    target = max(1, len(stored.sample) // SAMPLED_PER_POINT)
    alike = np.zeros(len(stored.sample), dtype=np.float32)
    of_sample = cells_for(candidate_density, len(stored.sample), target, criterion.density_power)
    area, _ = thinned(stored.sample, alike, target, surface_area(tree), of_sample)
    candidate_density = cells_for(candidate_density, stored.n_places, n_points, criterion.density_power)
    spacing, few = math.sqrt(area / n_points), _evenly(parts)
    noiseless = Noise(None, 0, False, 0.0, True, True, spacing)
    stage = StoredStage(stored, n_points, area, candidate_density, True, noiseless, criterion, None)
    if (within := int(np.pi * stage.sampled * stored.n_places / n_points)) >= FEWEST:
        fits = sorted({NEIGHBOURS, 2 * NEIGHBOURS, min(within, NEIGHBOURS), min(within, 2 * NEIGHBOURS)})
        measure = partial(_distances, stage, fits, -(-SAMPLES // len(few)))
        distances = np.concatenate(list(map_parts(measure, few)), axis=2)
        if distances.size:  # repeats may leave no sample
            layers = {k: NoiseLayer.from_distances(*of_fit) for k, of_fit in zip(fits, distances, strict=True)}
            stage = replace(stage, noise=Noise.from_layers(layers.__getitem__, within, spacing))
    if not stage.noise.thick:
        thin = np.concatenate(list(map_parts(partial(_thin_points, stage), few)))
        stage = replace(stage, has_thin_parts=has_thin_parts(thin))
    if "detail" in (stored.kind.names or ()):
        measured = np.concatenate(list(map_parts(partial(_residuals, stage), few)))
        detail = DetailNoise.from_residuals(*np.split(measured, 2, axis=1)) if len(measured) else None
        stage = replace(stage, detail=detail)
    return stage


def _evenly(parts: list[Part]) -> list[Part]:
    """Return sixteen parts at most in which noise and scale of a stage are measured."""
    return parts[:: -(-len(parts) // 16)]


def _distances(stage: StoredStage, fits: list[int], maximum: int, part: Part) -> Floats:
    """Return how far about `maximum` points of a part lie off quadrics, and the radii of their neighbourhoods."""
    near = stage.stored.near(part, 0.5 * HALO * stage.noise.spacing, fraction=stage.sampled)
    if not near.inside.any():
        return np.zeros((len(fits), 2, 0))
    tree = KdTree.build(near.points)
    inside = np.flatnonzero(near.inside[tree.order])
    points = KdTree.over(tree.points[:, inside[:: max(1, len(inside) // maximum)]])
    distances = []
    for count in fits:
        feet, fitted = projections(tree, points, count)
        distances.append([np.sqrt(((feet - points.points) ** 2).sum(axis=0)), fitted.radii])
    return np.array(distances)


def _thin_points(stage: StoredStage, part: Part) -> Floats:
    """Return the normals of the sheets, (n, 3), of some points of a part."""
    near = stage.stored.near(part, stage.noise.spacing, fraction=stage.sampled)
    if not near.inside.any():
        return np.empty((0, 3))
    runs = runs_of(KdTree.build(near.points[near.inside]))
    return toward_other_sheet(KdTree.build(near.points), runs, stage.noise.spacing, SHEET_VARIATION)


def _residuals(stage: StoredStage, part: Part) -> Floats:
    """Return what linear functions leave of the detail of a part's points, and the detail, (n, 2 k)."""
    radius = FIT_RADIUS * stage.edge
    near = stage.stored.near(part, radius, fraction=stage.sampled)
    tree = KdTree.build(near.points)
    values = near.records["detail"][tree.order].astype(np.float64)
    return np.column_stack([residuals(tree, values, radius), values])[near.inside[tree.order]]


def _with_candidates(
    stage: StoredStage, parts: list[Part], map_parts: MapParts, on_progress: Callable[[int], None], fixed: NDArray[Any]
) -> StoredStage:
    """Return the last stage with its candidates in place of all points, and with an area that fits their number."""
    many, few = MAX_CELLS * stage.candidate_density * stage.target, MIN_CANDIDATES * stage.target
    tasks = [(part, part.near(fixed, 0.0)) for part in parts]
    kind = _kind(stage)

    def counted(stage: StoredStage) -> tuple[StoredPoints, Ints]:
        """Store the candidates; return them, and how many are isolated within each distance."""
        counts, isolated = np.zeros(len(stage.stored.boxes), dtype=np.int64), np.zeros(len(ISOLATION), dtype=np.int64)
        runs = []
        for (part, _), (run, of_part, of_isolated) in zip(
            tasks, map_parts(partial(_store_candidates, stage, kind), tasks), strict=True
        ):
            runs.append(run)
            counts += of_part
            isolated += of_isolated
            on_progress(stage.stored.count(part))
        return replace(stage.stored, counts=counts, runs=tuple(runs), kind=kind), isolated

    thin, isolated = counted(stage)
    while len(thin) > many:
        stage = replace(stage, area=2.0 * stage.area)
        thin, isolated = counted(stage)
    while len(thin) < few and len(stage.stored) > many and not vanishes(stage.area):
        before, stage = len(thin), replace(stage, area=stage.area / 4.0)
        thin, isolated = counted(stage)
        if len(thin) == before:  # there are no more different points
            break
    if len(thin) < few:
        stage = replace(stage, thinned=False)
        thin, isolated = counted(stage)
    largest = largest_gap(isolated, len(thin), stage.target, stage.spacing) if stage.thinned else math.inf
    return replace(stage, stored=thin, largest_gap=largest)


def _kind(stage: StoredStage) -> np.dtype[Any]:
    """Return the type of the records of candidates."""
    observed: list[Any] = [] if stage.noise.is_negligible else [("variance", np.float64)]
    observed += [("foot", np.float64, 3)] if stage.noise.thick and not stage.noise.is_negligible else []
    observed += [("rough", np.float32)] if stage.detail else []
    observed += [("sheet", np.float64, 3)] if stage.has_thin_parts else []
    return np.dtype([*stage.stored.kind.descr, ("sharpness", np.float32), ("gap", np.float64), *observed])


def _store_candidates(
    stage: StoredStage, kind: np.dtype[Any], task: tuple[Part, NDArray[Any]]
) -> tuple[Run, Ints, Ints]:
    """Store the candidates of a part for the last stage; return their counts by box, and those of isolated ones."""
    part, chosen = task
    margin = stage.diagonal + ISOLATION[-1] * stage.spacing  # the points of a fit lie within 1.2 spacings
    near = stage.stored.near(part, margin, repeats=True)
    points = near.points
    tree, sharpness, rough = _sharpness(stage, near, points)
    kept = greatest_in_cells(points, stage.edge, sharpness) if stage.thinned else np.arange(len(points))
    gaps = gaps_of_isolated(KdTree.build(points[kept]), stage.spacing) if stage.thinned else np.zeros(len(kept))
    kept, gaps = kept[near.inside[kept]], gaps[near.inside[kept]]
    isolated = count_isolated(gaps, stage.spacing)
    fixed = np.flatnonzero(np.isin(near.indices, chosen["row"]))
    kept, gaps = np.concatenate([fixed, kept]), np.concatenate([np.full(len(fixed), FIXED), gaps])
    first = first_occurrences(points[kept])
    kept, gaps = kept[first], gaps[first]
    records = require_fields(near.records.take(kept), kind)
    records["sharpness"], records["gap"] = sharpness[kept], gaps
    if stage.detail:
        records["rough"] = rough[kept]
    if stage.has_thin_parts and tree:
        records["sheet"] = toward_other_sheet(tree, KdTree.build(points[kept]), stage.spacing)
    if not stage.noise.is_negligible:
        feet, records["variance"] = replace(stage.noise, tree=tree).observe(points[kept])
        if feet is not None:
            records["foot"] = feet
    return *write_run(stage.stored.folder, f"{part.first}.candidates", stage.stored.boxes, records), isolated


def _sharpness(
    stage: StoredStage, near: Neighbourhood, points: Floats
) -> tuple[KdTree | None, NDArray[np.float32], NDArray[np.float32]]:
    """Return the tree over a sample of points, (n, 3), and the sharpness and the variation of the detail, (n,) each."""
    drawn = np.flatnonzero(is_drawn(near.indices, stage.sampled))
    drawn = drawn[first_occurrences(points[drawn])]
    tree = KdTree.build(points[drawn]) if len(drawn) else None
    sharpness, rough = np.zeros((2, len(points)), dtype=np.float32)
    if stage.noise.is_below_threshold and tree:  # otherwise noisy points would look sharp
        plane = radius_of_plane(stage.area / (stage.sampled * stage.stored.n_places))
        radius = radius_of_sharpness(stage.edge, plane)
        sharpness[drawn] = sharpness_of(features_in_radius(tree, radius).surface_variation)
    if stage.detail and tree:
        drawn = drawn[tree.order]
        values = near.records["detail"][drawn].astype(np.float64)
        rough[drawn] = stage.detail.variation(residuals(tree, values, FIT_RADIUS * stage.edge))
        sharpness += rough
    return tree, sharpness, rough


def _near(stage: StoredStage, width: float, part: Part) -> Neighbourhood:
    """Read the candidates of a part and its halo, without outliers."""
    near = stage.stored.near(part, width, repeats=True)
    return near.take(np.flatnonzero(near.records["gap"] <= stage.largest_gap))


def _coarser(stage: StoredStage, map_parts: MapParts) -> StoredStage:
    """Return the stage with half as many points. Its candidates are among those of the finer stage, or all of these."""
    coarser = replace(stage, target=-(-stage.target // 2))
    runs, counts = zip(*map_parts(partial(_thin, coarser), stage.stored.parts(PART)), strict=True)
    thin = replace(stage.stored, runs=runs, counts=np.sum(counts, axis=0))
    if len(thin) < MIN_CANDIDATES * coarser.target:
        return replace(coarser, thinned=False)
    return replace(coarser, stored=thin, thinned=True)


def _thin(stage: StoredStage, part: Part) -> tuple[Run, Ints]:
    """Store one of the candidates of a finer stage for each cell, and those that are fixed."""
    near = _near(stage, stage.diagonal, part)
    kept = near.records["gap"] == FIXED
    kept[greatest_in_cells(near.points, stage.edge, np.ascontiguousarray(near.records["sharpness"]))] = True
    name = f"{stage.target}-{part.first}.candidates"
    return write_run(stage.stored.folder, name, stage.stored.boxes, near.records.compress(kept & near.inside))


def _in_memory(stage: StoredStage, map_parts: MapParts, timer: Timer, fixed: Ints) -> NDArray[Any]:
    """Choose the points of the first stages in memory."""
    with timer("candidates"):
        records = np.concatenate(
            [near.records for near in map_parts(partial(_near, stage, 0.0), stage.stored.parts(PART))]
        )
        order = np.argsort(records["row"])
        # The fixed points come first, in their order.
        first = order[np.searchsorted(records["row"][order], fixed)]
        records = records.take(np.concatenate([first, np.setdiff1d(order, first, assume_unique=True)]))
        points, sharpness = np.ascontiguousarray(records["place"]), np.ascontiguousarray(records["sharpness"])
        target = min(stage.target, len(records))
        stages = nested_candidates(points, sharpness, target, stage.area, stage.candidate_density, len(fixed))
    candidates = _candidates(stage, stages[-1].indices, records.take(stages[-1].indices))
    ranking = choose_in_stages(points, candidates, stages, stage.criterion, timer, len(fixed))
    return _chosen(records.take(ranking.indices), ranking.scores, ranking.deviations)


def _candidates(stage: StoredStage, indices: Ints, records: NDArray[Any]) -> Candidates:
    """Return what the field needs to know of the candidates in some records, (n,)."""
    names, n = records.dtype.names or (), len(records)
    feet = np.ascontiguousarray(records["foot"]) if "foot" in names else None
    variances = records["variance"] if "variance" in names else np.zeros(n)
    weights = records["weight"] if "weight" in names else None
    detail = None
    if stage.detail is not None:
        detail = Detail(stage.detail.without(records["detail"]), np.ascontiguousarray(records["rough"]))
    sheets = records["sheet"] if "sheet" in names else None
    return Candidates(indices, feet, variances, weights, detail, sheets)


def _chosen(records: NDArray[Any], scores: Floats, deviations: Floats) -> NDArray[Any]:
    """Return the records of chosen points, with score and deviation, (n,) each."""
    chosen = require_fields(records, CHOSEN)
    chosen["score"], chosen["deviation"] = scores, deviations
    return chosen


def _in_parts(stage: StoredStage, map_parts: MapParts, timer: Timer, chosen: NDArray[Any]) -> NDArray[Any]:
    """Choose the points of a further stage part by part, behind those that are chosen."""
    before, parts = len(chosen), stage.stored.parts(PART)
    with timer("features", len(stage.stored)) as on_progress:
        measured = []
        for part, of_part in zip(parts, map_parts(partial(_measure, stage), parts), strict=True):
            measured.append(of_part)
            on_progress(stage.stored.count(part))
        stage = _scaled(stage, np.concatenate(measured, axis=1), parts, map_parts)
    with timer("greedy selection", stage.target - before) as on_progress:
        threshold = float(chosen["score"][-1]) if before else 1.0
        while (count := len(chosen)) < stage.target:
            choose = partial(_choose, stage, threshold)
            chosen = chosen_by_classes(stage.stored.boxes, parts, stage.halo, map_parts, choose, chosen)
            on_progress(min(len(chosen), stage.target) - count)
            if threshold == 0.0:
                break
            threshold = threshold * next_step(len(chosen), stage.target) if threshold > 1e-6 else 0.0
    for part in parts:
        stage.file(part).unlink()
    chosen, added = chosen[:before], chosen[before:]
    best = np.lexsort([added["row"], -added["score"]])[: stage.target - before]
    return np.concatenate([chosen, added[best]])


def _measure(stage: StoredStage, part: Part) -> Floats:
    """Keep the candidates of a part and its halo with their features in a file; return how rough and thin some are."""
    near = _near(stage, stage.halo, part)
    tree = KdTree.build(near.points / stage.spacing)
    near = near.take(tree.order)
    candidates = _candidates(stage, near.indices, near.records)
    features = features_of(tree, candidates, stage.spacing, stage.thinned)
    records = require_fields(near.records, stage.measured)
    records["inside"] = near.inside
    records["variation"], records["normal"] = features.surface_variation, features.normals
    write_at_once(stage.file(part), [records])
    rough = records["rough"] if stage.detail else np.zeros(len(records))
    measured = np.stack([features.surface_variation, rough, candidates.beside_sheets])[:, near.inside]
    return measured[:, :: max(1, measured.shape[1] // SAMPLES)]


def _scaled(stage: StoredStage, measured: Floats, parts: list[Part], map_parts: MapParts) -> StoredStage:
    """Return the stage with the scale of the field, by what `_measure` returns of all parts."""
    variation, rough, beside_sheets = measured
    stage = replace(stage, criterion=stage.criterion.with_thin_parts(float(np.mean(beside_sheets))))
    scale = FieldScale.from_variation(variation, stage.criterion, rough)
    raw = replace(stage, scale=scale)
    squares = np.concatenate(list(map_parts(partial(_densities, raw), _evenly(parts))))
    return replace(stage, scale=scale._replace(spacing=math.sqrt(float(np.mean(squares)))))


def _field(stage: StoredStage, part: Part) -> tuple[Neighbourhood, LocalField]:
    """Return the candidates of a part and its halo in the order of a tree, and the field over them."""
    records = np.fromfile(stage.file(part), stage.measured)
    tree = KdTree.over(records["place"].T / stage.spacing)
    variation, normals = (np.ascontiguousarray(records[name]) for name in ("variation", "normal"))
    features = Features(variation, normals, np.zeros(0, dtype=np.int64))
    candidates = _candidates(stage, records["row"], records)
    variances = candidates.variances / stage.spacing**2
    field = local_field(tree, features, variances, stage.criterion, candidates.detail, candidates.weights, stage.scale)
    return Neighbourhood(records, np.ascontiguousarray(records["inside"])), field


def _densities(stage: StoredStage, part: Part) -> Floats:
    """Return 1 / spacing^2 of the candidates of a part, before it is scaled."""
    near, field = _field(stage, part)
    return field.spacings[near.inside] ** -2.0


def _choose(stage: StoredStage, threshold: float, settled: Flags, task: tuple[Part, NDArray[Any]]) -> NDArray[Any]:
    """Choose the candidates of a part with a score of at least a threshold; nothing in boxes that are `settled`."""
    near, field = _field(stage, task[0])
    chosen = np.isin(near.indices, task[1]["row"])
    kept = np.flatnonzero(chosen | ~settled[stage.stored.boxes.box_of(near.points)])
    tree = KdTree.over(field.positions[:, kept])
    field = LocalField(
        tree.points, np.ascontiguousarray(field.normals[:, kept]), field.spacings[kept], field.y[kept],
        field.noise[kept], np.ascontiguousarray(field.detail[:, kept]), field.lengthscale, field.normal_weight,
    )  # fmt: skip
    criterion, before = stage.criterion, np.flatnonzero(chosen[kept])
    added, scores, deviations = extend(
        field, tree, before, len(kept) - len(before), criterion.neighbours, criterion.error_weight, threshold
    )
    near = near.take(kept[added])
    return _chosen(near.records, scores, deviations)[near.inside]


def _placed(
    stage: StoredStage,
    parts: Sequence[Part],
    map_parts: MapParts,
    on_progress: Callable[[int], None],
    chosen: NDArray[Any],
    fixed: Ints,
) -> Ints:
    """Return the indices of the chosen points once they are placed, part by part, as `placement.place` does."""
    indices = chosen["row"].copy()
    order = np.argsort(indices)
    tasks = [(part, part.near(chosen, 0.5 * stage.halo)) for part in parts]
    for (part, _), (old, new) in zip(tasks, map_parts(partial(_exchange, stage, fixed), tasks), strict=True):
        indices[order[np.searchsorted(chosen["row"][order], old)]] = new
        on_progress(stage.stored.count(part))
    return indices


def _exchange(stage: StoredStage, fixed: Ints, task: tuple[Part, NDArray[Any]]) -> tuple[Ints, Ints]:
    """Return the chosen points of a part that are exchanged, and those for which they are."""
    (part, chosen), noise, halo = task, stage.noise, 0.5 * stage.halo
    old, vertices = chosen["row"], np.ascontiguousarray(chosen["place"])
    of_vertex = stage.stored.boxes.box_of(vertices)
    stays = (of_vertex < part.first) | (of_vertex >= part.last) | np.isin(old, fixed)
    if stays.all():
        return old[:0], old[:0]
    cell_points = CELL_POINTS if noise.is_negligible else NOISY_CELL_POINTS
    fraction = min(1.0, cell_points * stage.target / stage.stored.n_places)
    sampled = 1.0 if stage.detail else fraction if noise.is_negligible else max(fraction, stage.sampled)
    near = stage.stored.near(part, halo, fraction=sampled)
    if not noise.is_negligible:
        noise = replace(noise, tree=KdTree.build(near.points[is_drawn(near.indices, stage.sampled)]))
    vertex_attributes = detail = None
    if stage.detail:
        alike = KdTree.build(near.points).nearest_of(vertices, 1)[0][:, 0]  # repeats are not there
        detail = stage.detail.without(near.records["detail"])
        vertex_attributes = detail[alike]
    drawn = np.flatnonzero(is_drawn(near.indices, fraction))
    near, detail = near.take(drawn), detail if detail is None else detail[drawn]
    if not len(drawn):
        return old[:0], old[:0]
    area = stage.area / (fraction * stage.stored.n_places)
    cells = KdTree.build(near.points)
    new = replacements(vertices, stays, cells, area, noise, vertex_attributes, detail, farthest=0.5 * halo)
    moved = np.flatnonzero(new >= 0)
    return old[moved], near.indices[new[moved]]
