"""The method `gp`: `choose` runs the steps of research/local-field.md in their order."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.timer import Timer
from gppcs.gp.local.candidates import RANDOM_BITS, Measured, Ranks, Stage, cells_for, nested_candidates, sample, survey
from gppcs.gp.local.denoising import Denoised, denoised
from gppcs.gp.local.density import VARIATION_ROUNDING, density_of, graded, mean_and_variance, refinement, roundness_of
from gppcs.gp.local.detail import Detail
from gppcs.gp.local.greedy import extend
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.placement import place
from gppcs.gp.local.scale import FieldScale, Scale
from gppcs.gp.local.settings import DENSITY_POWER, GRADATION, NOISY_CELL_POINTS, NORMAL_WEIGHT, NUGGET, WEIGHT_POWER
from gppcs.gp.local.sheets import normal_factor_of, sheet_factors_of, sheets_of
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import short_hashes
from gppcs.surface.surface_variation import Features, features_in_radius, features_of_nearest

S = TypeVar("S", bound=np.generic)

# Distance from points that finished tiles add later, in desired spacings, at which none is chosen: with 0.35, pairs at
# borders are up to twice as often close; with 0.8, mean errors are 1 % larger.
CLEARANCE = 0.5


def _taken(column: NDArray[S] | None, indices: Ints) -> NDArray[S] | None:
    """Return some entries of a column, if there is one."""
    return None if column is None else column.take(indices, axis=0)


class Problem(NamedTuple):
    """The points of a cloud, and how many of them are to be chosen."""

    points: Floats  # (N, 3), without repeats
    n_points: int
    fixed: int = 0  # The first so many points are chosen already, those that are settled first, in their order
    weights: Floats | None = None  # (N,), above 0: factors of the density of the chosen points
    attributes: NDArray[np.float32] | None = None  # (N, k), which count beside the shape
    # (N,), points that only show where the surface is. Fixed ones that are not may be exchanged for points near them.
    settled: Flags | None = None
    scale: Scale | None = None  # Of the cloud of which the points are a part
    # (N,), by which samples are drawn, if the points were moved: their last digits depend on the processor.
    hashes: Ranks | None = None

    def candidate_density(self, criterion: Criterion) -> float:
        """Return how many candidate cells a square has whose side is the target spacing."""
        if self.scale is not None:
            return self.scale.candidate_density
        density = criterion.candidate_density * (1.0 if self.weights is None else refinement(self.weights))
        return cells_for(density, len(self.points), self.n_points, criterion.density_power)

    @property
    def finished(self) -> int:
        """Number of fixed points, the first, that are settled."""
        return 0 if self.settled is None else int(np.count_nonzero(self.settled[: self.fixed]))

    def later(self, target: int) -> slice:
        """Return the points of finished tiles that do not count yet in a stage, as in the whole they come after it."""
        return slice(math.ceil(self.finished * target / self.n_points), self.finished)

    def n_after(self, target: int) -> int:
        """Return how many points are chosen when a stage ends, with all of finished tiles."""
        fraction = 1.0 - self.finished / self.n_points
        return self.finished + math.ceil(fraction * target)

    def moved(self, points: Floats, indices: Ints) -> Problem:
        """Return the problem for some of the points, (n,), at other positions, (n, 3)."""
        return self._replace(
            points=points,
            hashes=short_hashes(self.points.take(indices, axis=0), RANDOM_BITS),
            weights=_taken(self.weights, indices),
            attributes=_taken(self.attributes, indices),
            settled=_taken(self.settled, indices),
        )


def choose(problem: Problem, criterion: Criterion, timer: Timer) -> Ranking:
    """Choose points of a cloud, the most important first: every prefix is a simplification of its size."""
    ranking, measured = _choose_candidates(problem, criterion, timer)  # steps 1 to 6, and 8
    with timer("placement"):
        indices = place(
            problem.points, ranking.indices, problem.fixed if problem.settled is None else problem.finished, measured
        )  # step 7, Eqs. (10) and (20)
    return ranking._replace(indices=indices)


def _choose_candidates(problem: Problem, criterion: Criterion, timer: Timer) -> tuple[Ranking, Measured]:
    """Choose among candidates, and return what is measured around all points."""
    density = problem.candidate_density(criterion)
    candidates, stages, measured = _survey(problem, density, timer)  # steps 1, 2, and 5, Eq. (7)
    ranking = choose_in_stages(problem, candidates, stages, criterion, timer)  # steps 3 to 6, and 8, Eqs. (2) to (9)
    noise = measured.noise
    scale = problem.scale or Scale(replace(noise, tree=None), density, stages[-1].largest_gap, ranking.stages)
    return ranking._replace(noise_in_spacings=noise.in_spacings, scale=scale), measured


def _survey(problem: Problem, density: float, timer: Timer) -> tuple[Candidates, list[Stage], Measured]:
    """Measure a cloud, and return the candidates of the last stage, as they are observed, and all stages."""
    points, n_points, fixed, weights, attributes, _, scale, hashes = problem
    measured = survey(points, n_points, density, timer, attributes, scale, hashes)
    area, noise, ranks, detail, tree, *_ = measured
    assert tree is not None
    with timer("candidates"):
        stages = nested_candidates(
            points, ranks, n_points, area, density, fixed, scale and scale.largest_gap, problem.finished
        )
    indices = stages[-1].indices
    positions, sheets = points.take(indices, axis=0), None
    if not noise.thick:
        with timer("features"):
            is_thin = None if scale is None else scale.stages[0].normal_factor < 1.0
            sheets = sheets_of(tree, positions, stages[-1].spacing, is_thin)
    measured = measured._replace(area=stages[-1].area)
    with timer("noise"):
        quadrics = None
        if len(tree.order) < len(points):
            measured = measured._replace(tree=None)  # the placement draws a sample of its own
        elif not noise.is_negligible and NOISY_CELL_POINTS * n_points >= len(points):  # the placement needs the same
            fitted = noise.fitted(tree)
            measured, quadrics = measured._replace(quadrics=fitted), fitted.take(tree.positions()[indices])
        feet, variances = noise.observe(positions, quadrics)
    detail = None if detail is None else detail.take(indices)
    return Candidates(indices, feet, variances, _taken(weights, indices), detail, sheets), stages, measured


def choose_in_stages(
    problem: Problem, candidates: Candidates, stages: list[Stage], criterion: Criterion, timer: Timer
) -> Ranking:
    """Choose in all stages, each of which ends with about twice as many points as the one before."""
    ranking = Ranking.of_fixed(problem.fixed)
    for stage in stages:
        ranking = _choose_in_stage(problem, candidates, stage, criterion, ranking, timer)
    return ranking


def _choose_in_stage(
    problem: Problem, candidates: Candidates, stage: Stage, criterion: Criterion, ranking: Ranking, timer: Timer
) -> Ranking:
    """Return the ranking with the points of one more stage, each of the largest score."""
    with timer("features"):  # steps 3 and 4, Eqs. (2) to (6)
        is_last = stage.target == problem.n_points
        tree, field, measured = field_of(problem.points, candidates, stage, criterion, problem.scale, is_last)
    n_added = problem.n_after(stage.target) - len(ranking.indices)
    with timer("greedy selection", n_added) as on_progress:  # steps 5 and 6, Eqs. (8) and (9)
        indices = stage.indices[tree.order]
        is_chosen = np.zeros(stage.indices[-1] + 1, dtype=np.bool_)
        is_chosen[ranking.indices] = True
        later = problem.later(stage.target)
        is_chosen[later] = False
        chosen = np.flatnonzero(is_chosen[indices])
        settled = None
        if problem.settled is not None:
            spacings = field.spacings * math.sqrt(stage.target / problem.n_points)  # at the end
            crowded = _near_any(tree, problem.points[later] / stage.spacing, CLEARANCE * spacings)
            settled = np.flatnonzero(problem.settled[indices] | crowded)
        added, scores, deviations = extend(
            field, tree, chosen, n_added, criterion.neighbours, criterion.error_weight, settled, on_progress
        )
    return ranking._replace(
        indices=np.concatenate([ranking.indices, indices[added]]),
        scores=np.concatenate([ranking.scores, scores]),
        deviations=np.concatenate([ranking.deviations, deviations]),
        stages=(measured, *ranking.stages),
    )


def _near_any(tree: KdTree, points: Floats, radii: Floats) -> Flags:
    """Return which of the n points of a tree, in its order, have one of some points, (k, 3), within radii, (n,)."""
    if not len(points):
        return np.zeros(len(radii), dtype=np.bool_)
    return np.asarray(KdTree.build(points).nearest_of(tree.points.T, 1)[1][:, 0] < radii**2)


def choose_denoised(problem: Problem, criterion: Criterion, timer: Timer) -> Ranking:
    """Choose as `choose` does among denoised points: all, or those of a sample of a large cloud and the fixed ones."""
    from gppcs.surface.inducing import inducing_points  # only here, as SciPy's linear algebra is slow to load

    points, n_points, fixed, *_ = problem
    indices = np.union1d(np.arange(fixed), sample(short_hashes(points, RANDOM_BITS), n_points))
    with timer("denoising"):
        tree = KdTree.build(points[indices])
        leading = tree.positions()[:fixed]
        indices, observed = indices[tree.order], np.ascontiguousarray(tree.points.T)
        surface = denoised(tree.in_own_order(), n_points, leading)  # Eqs. (11) to (13)
    is_candidate = surface.trusted.copy()
    is_candidate[leading] = False
    if fixed + np.count_nonzero(is_candidate) <= n_points:
        is_candidate = indices >= fixed
    candidates = np.concatenate([leading, np.flatnonzero(is_candidate)])
    ranking = choose(problem.moved(surface.points[candidates], indices[candidates]), criterion, timer)
    chosen = surface.take(candidates[ranking.indices])
    with timer("denoising"):
        positions, converged = inducing_points(chosen.points, observed, surface.points)  # Eqs. (14) to (16)
    return ranking._replace(
        indices=indices[candidates[ranking.indices]], surface=chosen._replace(points=positions), converged=converged
    )


@dataclass(frozen=True)
class Criterion:
    """The weights of the selection, and the density of the candidates."""

    density_power: float  # p: points per area go as the roughness to this power; lower for flat faces with edges
    normal_weight: float  # beta: distance of normals at a right angle, in spacings; lower then, and with thin parts
    error_weight: float  # w: weight of the error |mu - y| in the score; that of the uncertainty is 1
    lengthscale: float  # kappa: of the Matérn kernel, in desired spacings
    neighbours: int  # K: the number of chosen points on which a posterior is conditioned
    candidate_density: float  # Number of candidate cells in a square whose side is the target spacing

    @classmethod
    def from_feature_weight(
        cls, feature_weight: float, lengthscale: float, neighbours: int, candidate_density: float
    ) -> Criterion:
        """Return the weights: at 0.5, the default, the error has none; at 1 that of the paper."""
        density_power, normal_weight = DENSITY_POWER * feature_weight, NORMAL_WEIGHT * feature_weight
        error_weight = max(0.0, 2.0 * feature_weight - 1.0) ** 2
        return cls(density_power, normal_weight, error_weight, lengthscale, neighbours, candidate_density)


class Candidates(NamedTuple):
    """What the field needs to know of n candidates."""

    indices: Ints  # (n,), ascending: indices in the cloud
    feet: Floats | None  # (n, 3), where features are measured: as `Noise.observe` returns them
    variances: Floats  # (n,): of each observation, in the squared unit of the points; 0 without noise
    weights: Floats | None  # (n,)
    detail: Detail | None
    sheets: Floats | None = None  # (n, 4), as `sheets_of` returns them

    def take(self, positions: Ints) -> Candidates:
        """Return some of them."""
        feet, weights, sheets = (_taken(column, positions) for column in (self.feet, self.weights, self.sheets))
        detail = None if self.detail is None else self.detail.take(positions)
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
    converged: bool = True  # Whether the solver of the inducing points did, if the points are denoised

    @classmethod
    def of_fixed(cls, count: int) -> Ranking:
        """Return the first points of a cloud."""
        return cls(np.arange(count), np.zeros(count), np.zeros(count))


def field_of(
    points: Floats, candidates: Candidates, stage: Stage, criterion: Criterion, scale: Scale | None, is_last: bool
) -> tuple[KdTree, LocalField, FieldScale]:
    """Return the tree over a stage's candidates, in units of the target spacing, and the field in tree order.

    Shapes: points (N, 3), of which the candidates are some.
    """
    tree = KdTree.build(points.take(stage.indices, axis=0) / stage.spacing) if stage.tree is None else stage.tree
    order = tree.order
    if len(stage.indices) < len(candidates.indices):
        is_in_stage = np.zeros(len(points), dtype=np.bool_)
        is_in_stage[stage.indices] = True
        order = np.flatnonzero(is_in_stage[candidates.indices])[order]
    candidates = candidates.take(order)
    features = features_of(tree, candidates, stage.spacing, stage.thinned)
    return tree, *local_field(tree, features, candidates, criterion, stage.spacing, scale, is_last)


def features_of(tree: KdTree, candidates: Candidates, spacing: float, thinned: bool) -> Features:
    """Return the features of candidates, all in the order of their tree, in units of the target spacing (Eq. (2))."""
    on_surface = tree.in_own_order()
    if candidates.feet is not None:
        on_surface = KdTree.over(candidates.feet.T / spacing)
    # Where candidates are not thinned, a ball could hold any number of them.
    features = features_in_radius(on_surface, 1.0) if thinned else features_of_nearest(on_surface, 16)
    if candidates.sheets is not None:
        thin = candidates.sheets.any(axis=1)
        ways = candidates.sheets[thin, :3]
        features.normals[thin] = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return features


def local_field(
    tree: KdTree,
    features: Features,
    candidates: Candidates,
    criterion: Criterion,
    spacing: float = 1.0,
    scale: Scale | None = None,
    is_last: bool = True,
) -> tuple[LocalField, FieldScale]:
    """Return the field over candidates, all in the order of their tree, in units of the target spacing (Eqs. (3)-(6)).

    Returns also what is measured of all candidates, or what the scale of a whole cloud says of them. The weights come
    after the gradation, so that the density jumps where they do.
    """
    _, _, variances, weights, detail, sheets = candidates
    variation = features.surface_variation
    whole = None if scale is None else scale.at(spacing)
    roundness = whole.roundness if whole else roundness_of(np.sqrt(variation))
    roughness = np.sqrt(variation if detail is None else variation + detail.variation)
    normal_factor = 1.0
    if sheets is not None:
        normal_factor = normal_factor_of(sheets, is_last)  # Eq. (3c)
        roughness *= sheet_factors_of(tree, sheets, spacing)  # Eq. (3b)
    density = density_of(roughness, criterion.density_power * roundness)
    mean_density = whole.density if whole else float(np.mean(density))
    spacings = graded(tree, np.sqrt(mean_density / density), GRADATION)
    if weights is not None:
        spacings *= weights ** (-0.5 * WEIGHT_POWER)
    factor = whole.factor if whole else float(np.sqrt(np.mean(1.0 / (spacings * spacings))))
    spacings *= factor
    mean, squared = mean_and_variance(variation)
    mean, deviation = (whole.mean, whole.deviation) if whole else (mean, math.sqrt(squared))
    normal_factor = whole.normal_factor if whole else normal_factor
    y = np.zeros(len(variances))
    if criterion.error_weight > 0.0 and deviation > VARIATION_ROUNDING:  # otherwise nothing depends on it
        y = (variation - mean) / deviation
    field = LocalField(
        positions=tree.points,
        normals=np.ascontiguousarray(features.normals.T),
        spacings=spacings,
        y=y,
        noise=NUGGET + variances / spacing**2,
        detail=np.empty((0, len(variances))) if detail is None else detail.distances,
        lengthscale=criterion.lengthscale,
        normal_weight=criterion.normal_weight * roundness * normal_factor,
    )
    return field, FieldScale(spacing, mean, deviation, roundness, mean_density, factor, normal_factor)
