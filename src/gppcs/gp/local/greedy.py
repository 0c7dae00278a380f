"""Greedy selection in a local field (paper, Algorithm 1), exact although each choice updates only few points.

The score is the uncertainty, plus the error if that has a weight. By default it has none.
"""

from __future__ import annotations

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


def extend(
    field: LocalField, tree: KdTree, chosen: NDArray[np.int64], n_points: int, neighbours: int, error_weight: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Choose the point with the largest score, again and again, until `n_points` are chosen.

    Let a point have the posterior mean mu and variance sigma^2, and an observation there the variance nu. It has the
    gain g = sigma^2 / (sigma^2 + nu): it lowers the variance by g sigma^2 and moves the mean by g (y - mu). The score
    is sqrt(g) sigma + w g |mu - y|. Without noise and with w = 1 this is the paper's s = sqrt(diag Sigma) + |mu - y|.

    The scores are exact. A posterior changes only if the new point is among the nearest on which the point is
    conditioned, and a node of the tree is skipped only if this holds for none of its points. Many points are chosen by
    parts at once (`gppcs.gp.local.parts`). The order is then that of falling scores. The result is that of one choice
    after another, unless a new point raises a score, as it may since posteriors are given only the nearest points.

    Parameters
    ----------
    field : LocalField
        In the tree's order.
    tree : KdTree
        Over the field's positions.
    chosen : (m,) array
        Columns in the tree's order of the points chosen so far, in the order of choice.
    n_points : int
        From m to n.
    neighbours : int
        K: the number of chosen points on which a point is conditioned.
    error_weight : float
        w, the weight of the error.

    Returns
    -------
    chosen : (n_points,) array
        `chosen`, continued. Of equal scores in one part, the smallest index in the tree's input wins.
    scores, deviations : (n_points - m,) arrays
        Score and sigma of each new point when it was chosen.
    """
    conditioning = condition(field, tree, chosen, neighbours)
    choice = begin_choice(field, tree, chosen, conditioning, posterior(field, conditioning, error_weight))
    wanted = n_points - len(chosen)
    whole, count = divide(choice, 1), number_of_parts(len(field.y), len(chosen), tree.leaves, neighbours)
    if count == 1:
        choose(0, 1, TAKEN, wanted, field, error_weight, choice, whole)
        added, scores = chosen_by(whole)
    else:
        parts = divide(choice, count)
        added, scores = _choose_by_levels(wanted, len(chosen), field, error_weight, choice, parts, whole)
    return np.concatenate([chosen, added]), scores, np.sqrt(choice.variances[added])


def _choose_by_levels(
    wanted: int, chosen: int, field: LocalField, error_weight: float, choice: Choice, parts: Parts, rest: Parts
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose the `wanted` best points, level by level, after `chosen` others; parts as in `choose_all_above`."""
    level = float(choice.best[1])
    while (taken := int(parts.counts.sum() + rest.counts.sum())) < wanted:
        step = ((chosen + taken) / (chosen + SPARE * wanted)) ** FALL
        level = min(level, float(choice.best[1])) * max(STEP, step)
        choose_all_above(level, field, error_weight, choice, parts, rest)
    (added, scores), (others, of_others) = chosen_by(parts), chosen_by(rest)
    added, scores = np.concatenate([added, others]), np.concatenate([scores, of_others])
    best = np.argsort(-scores, kind="stable")[:wanted]
    return added[best], scores[best]
