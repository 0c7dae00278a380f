"""The choice in stages, from few points to many. Each stage has a field of its own, at its own target spacing.

Each stage about doubles the number of chosen points. The first points are placed as if no more were to come, so every
prefix of the result is a simplification of its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import Candidates
from gppcs.gp.local.density import ROUNDING, desired_spacings, segregation
from gppcs.gp.local.greedy import extend
from gppcs.gp.local.guiding import Weighing
from gppcs.gp.local.kernel import LocalField
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.noise import Noise, Observations
from gppcs.surface.surface_variation import Features, features_in_radius, features_of_nearest

NEAREST = 16  # Points of a neighbourhood if candidates are not thinned: a ball could then hold any number of them.
NUGGET = 1e-4  # Variance of an observation without noise, in units of the prior's. Keeps covariances regular.


@dataclass(frozen=True)
class Criterion:
    """The weights of the selection.

    Attributes
    ----------
    density_power : float
        Points per area go as the roughness to this power. The power is lower if the cloud consists of flat faces and
        edges.
    normal_weight : float
        beta: the distance of two normals at a right angle, in desired spacings. It is lower in the same case.
    error_weight : float
        w: the weight of the error |mu - y| in the score; that of the uncertainty is 1.
    lengthscale : float
        Of the Matérn kernel, in desired spacings.
    neighbours : int
        K: the number of chosen points on which a posterior is conditioned.
    """

    density_power: float
    normal_weight: float
    error_weight: float
    lengthscale: float
    neighbours: int


@dataclass(frozen=True)
class Ranking:
    """Rows of the M points, in the order of choice.

    Attributes
    ----------
    indices : (M,) array, int64
    scores, deviations : (M,) arrays, float64
        Score of each point, and posterior standard deviation in units of the prior's, when the point was chosen. Scores
        fall within a stage, apart from small effects of the error and of the few neighbours. They rise at the start of
        the next stage, whose field is finer.
    """

    indices: NDArray[np.int64]
    scores: NDArray[np.float64]
    deviations: NDArray[np.float64]


def rank(
    points: NDArray[np.float64],
    candidates: Sequence[Candidates],
    criterion: Criterion,
    noise: Noise,
    stages: Stages | None = None,
    fixed: int = 0,
    weights: NDArray[np.float64] | None = None,
) -> Ranking:
    """Choose points, the most important first.

    Parameters
    ----------
    points : (N, 3) array
        Without repeats.
    candidates : sequence of Candidates
        Of all stages, from coarse to fine.
    criterion : Criterion
    noise : Noise
    stages : Stages, optional
        Times "noise", "features" and "greedy selection". A step of the last is one point.
    fixed : int
        The first so many points are chosen from the start. They are candidates of each stage, which wants more.
    weights : (N,) array, optional
        Multiplies the density of the chosen points; above 0.

    Returns
    -------
    Ranking
        M points, the number that the last stage wants. Scores and deviations of the fixed ones are 0.
    """
    clock = stages or Stages()
    with clock("noise"):
        observations = noise.observe(points)
    chosen = np.arange(fixed)
    scores, deviations = [np.zeros(fixed)], [np.zeros(fixed)]
    weighing = None if weights is None else Weighing(weights)
    for stage in candidates:
        chosen, score, deviation = _extended(chosen, points, stage, criterion, observations, weighing, clock)
        scores.append(score)
        deviations.append(deviation)
    return Ranking(chosen, np.concatenate(scores), np.concatenate(deviations))


def _extended(
    chosen: NDArray[np.int64],
    points: NDArray[np.float64],
    stage: Candidates,
    criterion: Criterion,
    observations: Observations,
    weighing: Weighing | None,
    clock: Stages,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the rows chosen before with those that a stage adds, and the scores and deviations of these."""
    with clock("features"):
        tree, field = _observed(points[stage.indices], stage, criterion, observations.take(stage.indices))
    rows, spacings = stage.indices[tree.order], field.spacings
    if weighing is not None:
        field = field._replace(spacings=weighing.weighted(spacings, rows))
    with clock("greedy selection", stage.target - len(chosen)) as advanced:
        before = tree.positions()[np.searchsorted(stage.indices, chosen)]  # they are candidates of this stage
        extended, scores, deviations = extend(
            field, tree, before, stage.target, criterion.neighbours, criterion.error_weight
        )
        advanced(stage.target - len(chosen))
    if weighing is not None:
        weighing.learn(spacings, rows, extended)
    return rows[extended], scores, deviations


def _observed(
    places: NDArray[np.float64], stage: Candidates, criterion: Criterion, observations: Observations
) -> tuple[KdTree, LocalField]:
    """Return the tree over a stage's candidates, (n, 3), in units of its target spacing, and the field over them."""
    spacing = float(np.sqrt(stage.area / stage.target)) or 1.0
    tree = on_surface = KdTree.build(places).scaled(1.0 / spacing)
    feet, variances = observations.take(tree.order)
    if feet is not None:
        on_surface = KdTree.over(np.ascontiguousarray(feet.T) / spacing, tree.order)
    on_surface = on_surface.in_own_order()
    features = features_in_radius(on_surface, 1.0) if stage.thinned else features_of_nearest(on_surface, NEAREST)
    return tree, local_field(tree, features, variances / spacing**2, criterion)


def local_field(tree: KdTree, features: Features, noise: NDArray[np.float64], criterion: Criterion) -> LocalField:
    """Return the field over the candidates of a stage.

    Parameters
    ----------
    tree : KdTree
        Over the n candidates, in units of the target spacing.
    features : Features
        Of the candidates, in tree order.
    noise : (n,) array
        Variance of the observation at each, in units of the prior's, in tree order.
    criterion : Criterion

    Returns
    -------
    LocalField
        At n points, in tree order.
    """
    variation = features.surface_variation
    roughness = np.sqrt(variation)
    roundness = (1.0 - segregation(roughness) ** 2) ** 4
    spread = float(np.std(variation))
    return LocalField(
        positions=tree.points,
        normals=np.ascontiguousarray(features.normals.T),
        spacings=desired_spacings(tree, roughness, criterion.density_power * roundness),
        y=(variation - np.mean(variation)) / spread if spread > ROUNDING else np.zeros(len(noise)),
        noise=NUGGET + noise,
        lengthscale=criterion.lengthscale,
        normal_weight=criterion.normal_weight * roundness,
    )
