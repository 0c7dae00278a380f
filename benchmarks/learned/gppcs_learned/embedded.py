"""A cloud as the learned methods see it."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.blas import one_blas_thread
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs_learned.layers import Features, Index, embedding, in_unit_ball
from gppcs_learned.weights import NEIGHBOURS, Weights, part, weights_of


class Embedded(NamedTuple):
    """N points in the order of their tree, with what the first layers of a network make of them."""

    weights: Weights  # of the network
    tree: KdTree
    neighbours: Index  # (N, 16): the nearest others of each point
    places: NDArray[np.float64]  # (N, 3): in the unit ball
    features: Features  # (N, 64)

    @classmethod
    def of(cls, method: str, points: NDArray[np.float64], timer: Timer) -> Self:
        """Embed points, (N, 3), by the network of a method; raise an error if they are too few."""
        if len(points) <= NEIGHBOURS:
            raise InputError(
                f"method {method!r} looks at the {NEIGHBOURS} nearest points of each, so it needs at least "
                f"{NEIGHBOURS + 1} different points, found {len(points)}: choose another method, such as fps"
            )
        weights = weights_of(method)
        with timer("embedding"), one_blas_thread():
            tree = KdTree.build(points)
            near, _ = nearest_others(tree, NEIGHBOURS)
            places = in_unit_ball(points)[tree.order]
            return cls(weights, tree, near, places, embedding(part(weights, "embedding"), places, near))
