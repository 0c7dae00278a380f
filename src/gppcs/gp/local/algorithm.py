"""The method `gp`, in the order of the paper's Algorithm 1.

Survey the cloud; find the candidates; then, for each doubling of the number of points, make a field over the
candidates at its own target spacing and choose greedily. The first points are chosen as if no more were to come, so
every prefix of the result is a simplification of its size. At last each point goes to the place near it that is best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.timer import Timer
from gppcs.gp.local.candidates import Candidates, cell_edge, nested_candidates, sample, survey
from gppcs.gp.local.denoising import Denoised, denoised
from gppcs.gp.local.density import GRADATION, ROUNDING, density_of, graded, refinement, roundness_of, weighted
from gppcs.gp.local.detail import Detail
from gppcs.gp.local.greedy import extend
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.placement import placed
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.inducing import inducing_points
from gppcs.surface.noise import Observations
from gppcs.surface.surface_variation import Features, features_in_radius, features_of_nearest

NEAREST = 16  # Points of a neighbourhood if candidates are not thinned: a ball could then hold any number of them.
NUGGET = 1e-4  # Variance of an observation without noise, in units of the prior's. Keeps covariances regular.


@dataclass(frozen=True)
class Criterion:
    """The weights of the selection."""

    # Points per area go as the roughness to this power. The power is lower if the cloud consists of flat faces and
    # edges.
    density_power: float
    # beta: the distance of two normals at a right angle, in desired spacings. It is lower in the same case.
    normal_weight: float
    error_weight: float  # w: the weight of the error |mu - y| in the score; that of the uncertainty is 1
    lengthscale: float  # Of the Matérn kernel, in desired spacings
    neighbours: int  # K: the number of chosen points on which a posterior is conditioned


class Ranking(NamedTuple):
    """The M chosen points, in the order of choice."""

    rows: NDArray[np.int64]  # (M,)
    # (M,): Score of each point, and posterior standard deviation in units of the prior's, when the point was chosen; 0
    # for fixed points. Scores fall within a stage, apart from small effects of the error and of the few neighbours.
    # They rise at the start of the next stage, whose field is finer.
    scores: NDArray[np.float64]
    deviations: NDArray[np.float64]
    noise_in_spacings: float = 0.0  # Standard deviation of the noise, in target spacings
    surface: Denoised | None = None  # Where the chosen points go, if they are denoised


def choose(
    points: NDArray[np.float64],
    n_points: int,
    criterion: Criterion,
    density: float,
    timer: Timer,
    fixed: int = 0,
    weights: NDArray[np.float64] | None = None,
    attributes: NDArray[np.float32] | None = None,
) -> Ranking:
    """Choose `n_points` of a cloud, the most important first.

    The first `fixed` points are chosen from the start. `density` is the number of candidate cells in a square whose
    side is the target spacing; weights multiply the density of the chosen points; attributes count beside the shape.
    Shapes: points (N, 3) without repeats, weights (N,) above 0, attributes (N, k).
    """
    density *= 1.0 if weights is None else refinement(weights)
    area, noise, sharpness, detail = survey(points, n_points, density, timer, attributes)
    with timer("candidates"):
        candidates = nested_candidates(points, sharpness, n_points, area, density, fixed)
    del sharpness  # to free its memory
    with timer("noise"):
        rows = candidates[-1].rows  # those of all stages are among them
        observations = Observations(None, np.zeros(len(rows))) if noise.quiet else noise.observe(points[rows])
    level = noise.level / noise.spacing if noise.spacing > 0.0 else 0.0
    ranking = rank(points, candidates, observations, criterion, timer, fixed, weights, detail and detail.take(rows))
    area = candidates[-1].area
    del candidates, observations  # to free their memory
    with timer("placement"):
        chosen = placed(points, ranking.rows, fixed, area, noise, detail and detail.values)
    return ranking._replace(rows=chosen, noise_in_spacings=level)


def choose_denoised(
    points: NDArray[np.float64],
    n_points: int,
    criterion: Criterion,
    density: float,
    timer: Timer,
    weights: NDArray[np.float64] | None = None,
    attributes: NDArray[np.float32] | None = None,
) -> Ranking:
    """Choose as `choose` does among denoised points: all, or those of a sample of a large cloud."""
    rows = sample(points, n_points)
    observed = points[rows]
    with timer("denoising"):
        surface = denoised(observed, n_points)
        trusted = np.flatnonzero(surface.trusted)
    among = trusted if len(trusted) > n_points else np.arange(len(observed))
    rows = rows[among]
    ranking = choose(
        surface.places[among], n_points, criterion, density, timer, 0, weights if weights is None else weights[rows],
        attributes if attributes is None else attributes[rows],
    )  # fmt: skip
    chosen = surface.take(among[ranking.rows])
    with timer("denoising"):
        places = inducing_points(chosen.places, observed, surface.places)
    return ranking._replace(rows=rows[ranking.rows], surface=chosen._replace(places=places))


def rank(
    points: NDArray[np.float64],
    candidates: list[Candidates],
    observations: Observations,
    criterion: Criterion,
    timer: Timer,
    fixed: int = 0,
    weights: NDArray[np.float64] | None = None,
    detail: Detail | None = None,
) -> Ranking:
    """Choose among the candidates, stage by stage; `observations` and `detail` are at those of the last stage."""
    ranking = Ranking(np.arange(fixed), np.zeros(fixed), np.zeros(fixed))
    for stage in candidates:
        with timer("features"):
            among = np.searchsorted(candidates[-1].rows, stage.rows)
            spacing = cell_edge(stage.area, stage.target)
            feet = None if observations.feet is None else observations.feet[among]
            tree, features = features_of(points[stage.rows], feet, spacing, stage.thinned)
            among = among[tree.order]
            variances = observations.variances[among] / spacing**2
            field = local_field(tree, features, variances, criterion, detail and detail.take(among))
            rows = stage.rows[tree.order]
            if weights is not None:
                field = field._replace(spacings=weighted(field.spacings, weights[rows]))
        with timer("greedy selection", stage.target - len(ranking.rows)) as advanced:
            before, wanted = np.flatnonzero(np.isin(rows, ranking.rows)), stage.target - len(ranking.rows)
            added, scores, deviations = extend(
                field, tree, before, wanted, criterion.neighbours, criterion.error_weight, advanced=advanced
            )
        ranking = Ranking(
            np.concatenate([ranking.rows, rows[added]]), np.concatenate([ranking.scores, scores]),
            np.concatenate([ranking.deviations, deviations]),
        )  # fmt: skip
    return ranking


def features_of(
    places: NDArray[np.float64], feet: NDArray[np.float64] | None, spacing: float, thinned: bool
) -> tuple[KdTree, Features]:
    """Return the tree over the candidates of a stage, in units of its target spacing, and their features in tree order.

    The features are measured at the feet of the places, if there are any. Shapes: places, feet (n, 3).
    """
    tree = KdTree.build(places / spacing)
    on_surface = tree.in_own_order()
    if feet is not None:
        on_surface = KdTree.over(np.ascontiguousarray(feet[tree.order].T) / spacing)
    return tree, features_in_radius(on_surface, 1.0) if thinned else features_of_nearest(on_surface, NEAREST)


class Scale(NamedTuple):
    """What the field at a candidate needs to know of all candidates of the stage, where it has only some."""

    # Mean and standard deviation of the surface variation.
    mean: float
    deviation: float
    roundness: float  # From 1 for a cloud whose places are alike to 0 for flat faces and edges only
    density: float  # Mean of the wanted density
    spacing: float = 1.0  # What makes the mean of 1 / spacing^2 equal to 1

    @classmethod
    def of(
        cls, variation: NDArray[np.float64], criterion: Criterion, detail: NDArray[np.float64] | float = 0.0
    ) -> Scale:
        """Measure candidates, given their surface variation and the roughness of their detail, (n,)."""
        roundness = roundness_of(np.sqrt(variation))
        density = density_of(np.sqrt(variation + detail), criterion.density_power * roundness)
        return cls(float(np.mean(variation)), float(np.std(variation)), roundness, float(np.mean(density)))


def local_field(
    tree: KdTree,
    features: Features,
    noise: NDArray[np.float64],
    criterion: Criterion,
    detail: Detail | None = None,
    scale: Scale | None = None,
) -> LocalField:
    """Return the field over candidates, all in the order of their tree, which is in units of the target spacing.

    Shapes: noise (n,), the variance of the observation at each candidate, in units of the prior's.
    """
    variation = features.surface_variation
    roundness = scale.roundness if scale else roundness_of(np.sqrt(variation))
    roughness = np.sqrt(variation if detail is None else variation + detail.variation)
    density = density_of(roughness, criterion.density_power * roundness)
    spacings = graded(tree, np.sqrt((scale.density if scale else np.mean(density)) / density), GRADATION)
    spacings *= scale.spacing if scale else np.sqrt(np.mean(spacings**-2.0))
    y = np.zeros(len(noise))
    if criterion.error_weight > 0.0:  # otherwise nothing asks for it
        mean, deviation = (scale.mean, scale.deviation) if scale else (np.mean(variation), np.std(variation))
        y = (variation - mean) / deviation if deviation > ROUNDING else y
    return LocalField(
        positions=tree.points,
        normals=np.ascontiguousarray(features.normals.T),
        spacings=spacings,
        y=y,
        noise=NUGGET + noise,
        detail=np.empty((0, len(noise))) if detail is None else detail.distances,
        lengthscale=criterion.lengthscale,
        normal_weight=criterion.normal_weight * roundness,
    )
