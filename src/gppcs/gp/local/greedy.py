"""Greedy selection in a local field (paper, Algorithm 1), exact although each choice updates only few points.

The score is the uncertainty, plus the error if that has a weight. By default it has none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.choice import TAKEN, Choice, begin_choice
from gppcs.gp.local.conditioning import condition
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.parts import Parts, choose, choose_all_above, chosen_by, divide, number_of_parts
from gppcs.gp.local.posterior import posterior
from gppcs.spatial.kdtree import KdTree

STEP = 0.7  # From one level to the next. Larger steps leave more points in doubt, smaller ones take more rounds.
SPARE = 1.01  # Points chosen for each one wanted: the last level is aimed a little too low.
# Scores fall about as the number of chosen points to this power. A wrong power costs another level, nothing else.
FALL = 0.7
LEAST_STEP = 1e-6  # A level below this is the last.
TOLD = 4096  # Points chosen one after another between two reports of progress.


def extend(
    field: LocalField,
    tree: KdTree,
    chosen: NDArray[np.int64],
    n_points: int,
    neighbours: int,
    error_weight: float,
    advanced: Callable[[int], None],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Choose the point with the largest score, again and again, until `n_points` are chosen.

    Let a point have the posterior mean mu and variance sigma^2, and an observation there the variance nu. It has the
    gain g = sigma^2 / (sigma^2 + nu): it lowers the variance by g sigma^2 and moves the mean by g (y - mu). The score
    is sqrt(g) sigma + w g |mu - y|. Without noise and with w = 1 this is the paper's s = sqrt(diag Sigma) + |mu - y|.

    The scores are exact. A posterior changes only if the new point is among the nearest on which the point is
    conditioned, and a node of the tree is skipped only if this holds for none of its points. Many points are chosen by
    parts at once (`gppcs.gp.local.parts`). The order is then that of falling scores. The result is that of one choice
    after another, unless a new point raises a score, as it may since posteriors are given only the nearest points.

    Shapes: chosen (m,); returns chosen (n_points,), scores, deviations (n_points - m,).
    """
    choice, parts = _begun(field, tree, chosen, neighbours, error_weight)
    wanted, whole = n_points - len(chosen), divide(choice, 1)
    if parts is None:
        for taken in range(0, wanted, TOLD):
            choose(0, 1, TAKEN, min(taken + TOLD, wanted), field, error_weight, choice, whole)
            advanced(min(TOLD, wanted - taken))
        added, scores = chosen_by(whole)
    else:
        added, scores = _choose_by_levels(wanted, len(chosen), field, error_weight, choice, parts, whole, advanced)
    return np.concatenate([chosen, added]), scores, np.sqrt(choice.variances[added])


def extend_down_to(
    level: float,
    field: LocalField,
    tree: KdTree,
    chosen: NDArray[np.int64],
    neighbours: int,
    error_weight: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Choose the point with the largest score, again and again, as long as that is at least `level`.

    Shapes: returns added (n,), scores, deviations (n,).
    """
    choice, parts = _begun(field, tree, chosen, neighbours, error_weight)
    whole = divide(choice, 1)
    if parts is None:
        choose(0, 1, level, len(tree.order), field, error_weight, choice, whole)
        added, scores = chosen_by(whole)
    else:
        reached = np.inf
        while reached > level:
            reached = STEP * min(reached, float(choice.best[1]))
            reached = reached if reached > max(level, LEAST_STEP) else level
            choose_all_above(reached, field, error_weight, choice, parts, whole)
        added, scores = _joined(parts, whole)
    order = np.argsort(-scores, kind="stable")
    return added[order], scores[order], np.sqrt(choice.variances[added[order]])


def _begun(
    field: LocalField, tree: KdTree, chosen: NDArray[np.int64], neighbours: int, error_weight: float
) -> tuple[Choice, Parts | None]:
    """Return the state after `chosen`, and the parts that choose at once, or None if they would be too small."""
    conditioning = condition(field, tree, chosen, neighbours)
    choice = begin_choice(field, tree, chosen, conditioning, posterior(field, conditioning, error_weight))
    count = number_of_parts(len(field.y), len(chosen), tree.leaves, neighbours)
    return choice, divide(choice, count) if count > 1 else None


def _choose_by_levels(
    wanted: int,
    chosen: int,
    field: LocalField,
    error_weight: float,
    choice: Choice,
    parts: Parts,
    rest: Parts,
    advanced: Callable[[int], None],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose the `wanted` best points, level by level, after `chosen` others; parts as in `choose_all_above`."""
    level, taken = float(choice.best[1]), 0
    while taken < wanted:
        step = ((chosen + taken) / (chosen + SPARE * wanted)) ** FALL
        level = min(level, float(choice.best[1])) * max(STEP, step)
        choose_all_above(level, field, error_weight, choice, parts, rest)
        before, taken = taken, min(int(parts.counts.sum() + rest.counts.sum()), wanted)
        advanced(taken - before)
    added, scores = _joined(parts, rest)
    best = np.argsort(-scores, kind="stable")[:wanted]
    return added[best], scores[best]


def _joined(parts: Parts, rest: Parts) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return what the parts and the whole have chosen, and the scores."""
    (added, scores), (others, of_others) = chosen_by(parts), chosen_by(rest)
    return np.concatenate([added, others]), np.concatenate([scores, of_others])
