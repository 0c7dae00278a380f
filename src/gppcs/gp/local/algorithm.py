"""The method `gp`: `choose` runs the steps of research/local-field.md in their order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.gp.local.candidates import RANDOM_BITS, Stage, cells_for, nested_candidates, sample, survey
from gppcs.gp.local.denoising import Denoised, denoised
from gppcs.gp.local.density import ROUNDING, density_of, graded, refinement, roundness_of
from gppcs.gp.local.detail import Detail
from gppcs.gp.local.greedy import extend
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.placement import place
from gppcs.gp.local.placement.cells import Fits
from gppcs.gp.local.scale import FieldScale, Scale
from gppcs.gp.local.settings import (
    DENSITY_POWER,
    GRADATION,
    NOISY_CELL_POINTS,
    NORMAL_WEIGHT,
    NUGGET,
    WEIGHT_POWER,
)
from gppcs.gp.local.sheets import normals_of_sheets
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import point_hashes
from gppcs.surface.noise import Noise
from gppcs.surface.quadrics import Quadrics
from gppcs.surface.surface_variation import Features, features_in_radius, features_of_nearest


def choose(
    points: Floats,
    n_points: int,
    criterion: Criterion,
    candidate_density: float,
    timer: Timer,
    fixed: int = 0,
    weights: Floats | None = None,
    attributes: NDArray[np.float32] | None = None,
    settled: Flags | None = None,
    scale: Scale | None = None,
) -> Ranking:
    """Choose `n_points` of a cloud, the most important first, so that every prefix is a simplification of its size.

    The first `fixed` points are chosen from the start. `candidate_density` is the number of candidate cells in a square
    whose side is the target spacing; weights multiply the density of the chosen points; attributes count beside the
    shape. `settled` points only show where the surface is; `scale` is that of a cloud of which these are a part.
    Shapes: points (N, 3) without repeats, weights (N,) above 0, attributes (N, k), settled (N,).
    """
    candidate_density *= 1.0 if weights is None else refinement(weights)
    candidate_density = cells_for(candidate_density, len(points), n_points, criterion.density_power)
    surveyed = survey(points, n_points, candidate_density, timer, attributes, scale)  # step 1
    noise, detail = surveyed.noise, surveyed.detail
    with timer("candidates"):
        stages = nested_candidates(
            points, surveyed.ranks, n_points, surveyed.area, candidate_density, fixed, scale and scale.largest_gap
        )  # step 2
    sheets, last = None, stages[-1]
    if not noise.thick:
        with timer("features"):
            sheets = normals_of_sheets(surveyed.tree, points[last.indices], last.spacing)
    tree = normals = None
    if len(surveyed.tree.order) == len(points):
        tree, normals = surveyed.tree, surveyed.normals
    del surveyed  # of a sample, nothing is needed any more
    fitted = None
    if tree is not None and noise.tree is not None and NOISY_CELL_POINTS * n_points >= len(points):
        with timer("noise"):
            fitted = noise.fitted(tree)  # once around all points, as the placement needs them, too
    with timer("noise"):
        at_candidates = None if tree is None or fitted is None else fitted.take(tree.positions()[last.indices])
        # Step 5, Eq. (7).
        candidates = Candidates.observed(last.indices, points, noise, weights, detail, sheets, at_candidates)
    # Steps 3 to 6 and 8, Eqs. (2) to (9).
    ranking = choose_in_stages(points, candidates, stages, criterion, timer, fixed, settled, scale)
    area, largest_gap = last.area, last.largest_gap
    del candidates, stages, last  # as large as what the placement needs
    with timer("placement"):
        values = None if detail is None else detail.values
        # Step 7, Eqs. (10) and (20).
        fits = None if tree is None else Fits(tree, fitted, normals)
        indices = place(points, ranking.indices, fixed, area, noise, values, fits)
    measured = Scale(replace(noise, tree=None), largest_gap, ranking.stages)
    return ranking._replace(indices=indices, noise_in_spacings=noise.in_spacings, scale=scale or measured)


def choose_in_stages(
    points: Floats,
    candidates: Candidates,
    stages: list[Stage],
    criterion: Criterion,
    timer: Timer,
    fixed: int,
    settled: Flags | None = None,
    scale: Scale | None = None,
) -> Ranking:
    """Choose among points, (N, 3), in all stages, each of which ends with about twice as many as the one before."""
    ranking = Ranking.of_fixed(fixed)
    for stage in stages:
        with timer("features"):
            tree, field, measured = field_of(
                points, candidates, stage, criterion, scale
            )  # steps 3 and 4, Eqs. (2) to (6)
        with timer("greedy selection", stage.target - len(ranking.indices)) as on_progress:
            # Steps 5 and 6: the posterior, Eq. (8), and the greedy choice, Eq. (9).
            ranking = choose_in_stage(ranking, field, tree, stage, criterion, on_progress, settled)
        ranking = ranking._replace(stages=(measured, *ranking.stages))
        del tree, field  # as large as those of the next stage
    return ranking


def choose_denoised(
    points: Floats,
    n_points: int,
    criterion: Criterion,
    candidate_density: float,
    timer: Timer,
    weights: Floats | None = None,
    attributes: NDArray[np.float32] | None = None,
) -> Ranking:
    """Choose as `choose` does among denoised points: all, or those of a sample of a large cloud."""
    from gppcs.surface.inducing import inducing_points  # only here, as SciPy's linear algebra is slow to load

    indices = sample(point_hashes(points, bits=RANDOM_BITS), n_points)
    with timer("denoising"):
        tree = KdTree.build(points[indices])
        indices, observed = indices[tree.order], np.ascontiguousarray(tree.points.T)
        surface = denoised(tree.in_own_order(), n_points)  # Eqs. (11) to (13)
        trusted = np.flatnonzero(surface.trusted)
    candidates = trusted if len(trusted) > n_points else np.arange(len(observed))
    indices = indices[candidates]
    weights = None if weights is None else weights[indices]
    attributes = None if attributes is None else attributes[indices]
    ranking = choose(surface.points[candidates], n_points, criterion, candidate_density, timer, 0, weights, attributes)
    chosen = surface.take(candidates[ranking.indices])
    with timer("denoising"):
        moved = inducing_points(chosen.points, observed, surface.points)  # Eqs. (14) to (16)
    return ranking._replace(indices=indices[ranking.indices], surface=chosen._replace(points=moved))


@dataclass(frozen=True)
class Criterion:
    """The weights of the selection."""

    density_power: float  # p: points per area go as the roughness to this power; lower for flat faces with edges
    normal_weight: float  # beta: distance of normals at a right angle, in spacings; lower then, and with thin parts
    error_weight: float  # w: weight of the error |mu - y| in the score; that of the uncertainty is 1
    lengthscale: float  # kappa: of the Matérn kernel, in desired spacings
    neighbours: int  # K: the number of chosen points on which a posterior is conditioned

    @classmethod
    def from_feature_weight(cls, feature_weight: float, lengthscale: float, neighbours: int) -> Criterion:
        """Return the weights: at 0.5, the default, the error has none; at 1 that of the paper."""
        error_weight = max(0.0, 2.0 * feature_weight - 1.0) ** 2
        return cls(
            DENSITY_POWER * feature_weight, NORMAL_WEIGHT * feature_weight, error_weight, lengthscale, neighbours
        )

    def with_thin_parts(self, fraction: float) -> Criterion:
        """Return the weights for a cloud with this fraction of its candidates beside another sheet."""
        return replace(self, normal_weight=self.normal_weight * (1.0 - fraction))


class Candidates(NamedTuple):
    """What the field needs to know of n candidates."""

    indices: Ints  # (n,), ascending: indices in the cloud
    feet: Floats | None  # (n, 3), where features are measured: as `Noise.observe` returns them
    variances: Floats  # (n,): of each observation, in the squared unit of the points; 0 without noise
    weights: Floats | None  # (n,)
    detail: Detail | None
    sheets: Floats | None = None  # (n, 3), as `normals_of_sheets` returns them

    @classmethod
    def observed(
        cls,
        indices: Ints,
        points: Floats,
        noise: Noise,
        weights: Floats | None,
        detail: Detail | None,
        sheets: Floats | None,
        fitted: Quadrics | None,
    ) -> Candidates:
        """Return those with some indices, (n,), of a cloud. Shapes: points (N, 3), weights (N,)."""
        feet, variances = noise.observe(points[indices], fitted)
        weights = None if weights is None else weights[indices]
        detail = None if detail is None else detail.take(indices)
        return cls(indices, feet, variances, weights, detail, sheets)

    @property
    def beside_sheets(self) -> Flags:
        """Whether each has another sheet near it, (n,)."""
        if self.sheets is None:
            return np.zeros(len(self.indices), dtype=np.bool_)
        return np.asarray(self.sheets.any(axis=1), dtype=np.bool_)

    def take(self, positions: Ints) -> Candidates:
        """Return some of them."""
        feet = None if self.feet is None else self.feet[positions]
        weights = None if self.weights is None else self.weights[positions]
        detail = None if self.detail is None else self.detail.take(positions)
        sheets = None if self.sheets is None else self.sheets[positions]
        return Candidates(self.indices[positions], feet, self.variances[positions], weights, detail, sheets)


class Ranking(NamedTuple):
    """The M chosen points, in the order of choice."""

    indices: Ints  # (M,)
    # When the points were chosen; 0 for fixed points. Scores rise at the start of a stage, whose field is finer.
    scores: Floats  # (M,)
    deviations: Floats  # (M,), posterior standard deviations, in units of the prior's
    noise_in_spacings: float = 0.0  # Standard deviation of the noise, in target spacings
    surface: Denoised | None = None  # Where the chosen points go, if they are denoised
    stages: tuple[FieldScale, ...] = ()  # What was measured of the candidates of each stage, the finest first
    scale: Scale | None = None

    @classmethod
    def of_fixed(cls, count: int) -> Ranking:
        """Return the first points of a cloud."""
        return cls(np.arange(count), np.zeros(count), np.zeros(count))


def choose_in_stage(
    ranking: Ranking,
    field: LocalField,
    tree: KdTree,
    stage: Stage,
    criterion: Criterion,
    on_progress: Callable[[int], None],
    settled: Flags | None = None,
) -> Ranking:
    """Return the ranking with the points of one more stage, each of the largest score (Eqs. (8) and (9)).

    The field is over the candidates of the stage, in the order of the tree.
    """
    indices = stage.indices[tree.order]
    is_chosen = np.zeros(stage.indices[-1] + 1, dtype=np.bool_)
    is_chosen[ranking.indices] = True
    chosen = np.flatnonzero(is_chosen[indices])
    n_added = stage.target - len(ranking.indices)
    added, scores, deviations = extend(
        field,
        tree,
        chosen,
        n_added,
        criterion.neighbours,
        criterion.error_weight,
        on_progress=on_progress,
        settled=None if settled is None else np.flatnonzero(settled[indices]),
    )
    return ranking._replace(
        indices=np.concatenate([ranking.indices, indices[added]]),
        scores=np.concatenate([ranking.scores, scores]),
        deviations=np.concatenate([ranking.deviations, deviations]),
    )


def field_of(
    points: Floats, candidates: Candidates, stage: Stage, criterion: Criterion, scale: Scale | None
) -> tuple[KdTree, LocalField, FieldScale]:
    """Return the tree over a stage's candidates, in units of the target spacing, and the field in tree order.

    Shapes: points (N, 3), of which the candidates are some.
    """
    tree = KdTree.build(points[stage.indices] / stage.spacing) if stage.tree is None else stage.tree
    if len(stage.indices) < len(candidates.indices):
        candidates = candidates.take(np.searchsorted(candidates.indices, stage.indices)[tree.order])
    else:
        candidates = candidates.take(tree.order)
    features = features_of(tree, candidates, stage.spacing, stage.thinned)
    criterion = criterion.with_thin_parts(float(np.mean(candidates.beside_sheets)))
    variances = candidates.variances / stage.spacing**2
    detail, weights = candidates.detail, candidates.weights
    return tree, *local_field(tree, features, variances, criterion, detail, weights, stage.spacing, scale)


def features_of(tree: KdTree, candidates: Candidates, spacing: float, thinned: bool) -> Features:
    """Return the features of candidates, all in the order of their tree, in units of the target spacing (Eq. (2))."""
    on_surface = tree.in_own_order()
    if candidates.feet is not None:
        on_surface = KdTree.over(candidates.feet.T / spacing)
    # Where candidates are not thinned, a ball could hold any number of them.
    features = features_in_radius(on_surface, 1.0) if thinned else features_of_nearest(on_surface, 16)
    if candidates.sheets is not None:
        thin = candidates.beside_sheets
        features.normals[thin] = candidates.sheets[thin]
    return features


def local_field(
    tree: KdTree,
    features: Features,
    variances: Floats,
    criterion: Criterion,
    detail: Detail | None = None,
    weights: Floats | None = None,
    spacing: float = 1.0,
    scale: Scale | None = None,
) -> tuple[LocalField, FieldScale]:
    """Return the field over candidates, all in the order of their tree, in units of the target spacing (Eqs. (3)-(6)).

    Returns also what is measured of all candidates, or what the scale of a whole cloud says of them. The weights come
    after the gradation, so that the density jumps where they do. Shapes: variances (n,), of the observations, in units
    of the prior's, weights (n,).
    """
    variation = features.surface_variation
    known = None if scale is None else scale.at(spacing)
    roundness = known.roundness if known else roundness_of(np.sqrt(variation))
    roughness = np.sqrt(variation if detail is None else variation + detail.variation)
    density = density_of(roughness, criterion.density_power * roundness)
    mean_density = known.density if known else float(np.mean(density))
    spacings = graded(tree, np.sqrt(mean_density / density), GRADATION)
    if weights is not None:
        spacings *= weights ** (-0.5 * WEIGHT_POWER)
    factor = known.factor if known else float(np.sqrt(np.mean(spacings**-2.0)))
    spacings *= factor
    mean, deviation = (known.mean, known.deviation) if known else (float(np.mean(variation)), float(np.std(variation)))
    y = np.zeros(len(variances))
    if criterion.error_weight > 0.0 and deviation > ROUNDING:  # otherwise nothing depends on it
        y = (variation - mean) / deviation
    field = LocalField(
        positions=tree.points,
        normals=np.ascontiguousarray(features.normals.T),
        spacings=spacings,
        y=y,
        noise=NUGGET + variances,
        detail=np.empty((0, len(variances))) if detail is None else detail.distances,
        lengthscale=criterion.lengthscale,
        normal_weight=criterion.normal_weight * roundness,
    )
    return field, FieldScale(spacing, mean, deviation, roundness, mean_density, factor)
