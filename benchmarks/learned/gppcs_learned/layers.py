"""The layers of the learned methods in NumPy: EdgeConv, attention to neighbours, and attention that scores points.

Shapes: N points, k neighbours, c features. Work is done in blocks of points of a fixed size, so that results do not
depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.threads import on_ranges
from gppcs_learned.weights import Weights, part

BLOCK = 1024  # points of a block: their neighbours' features fit into the CPU cache
HEADS = 4  # of the attention to neighbours
SLOPE = np.float32(0.2)  # of LeakyReLU below zero

Features = NDArray[np.float32]
Index = NDArray[np.int64]


def in_unit_ball(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points, (N, 3), about their mean, the farthest at distance 1."""
    centred = points - points.mean(axis=0)
    return centred / np.sqrt(np.einsum("ni,ni->n", centred, centred).max())


def embedding(weights: Weights, points: NDArray[np.float64], index: Index) -> Features:
    """Return features, (N, 64), of points in the unit ball, (N, 3), by two EdgeConv blocks; density does not matter."""
    first, second = part(weights, "first"), part(weights, "second")
    places = points.astype(np.float32)

    def steps(rows: slice) -> Features:
        differences = points[index[rows]] - points[rows, np.newaxis]
        reach = np.sqrt((differences[:, -1:] ** 2).sum(axis=2, keepdims=True))
        reach[reach == 0.0] = 1.0  # of points that rounding has moved to one place
        return (differences / reach).astype(np.float32) @ first["difference"]

    one = _edge_conv(first, places, steps)
    weighed = one @ second["difference"]
    two = _edge_conv(second, one, lambda rows: weighed[index[rows]] - weighed[rows, np.newaxis])
    return np.concatenate([one, two], axis=1)


def attended(weights: Weights, features: Features, index: Index) -> Features:
    """Return features, (N, c), after attention to the neighbours and a feed-forward layer."""
    out = np.empty_like(features)
    key, value = features @ weights["key"], features @ weights["value"]

    def of_block(rows: slice) -> None:
        here, around = features[rows], index[rows]
        keys = key[around] - key[rows, np.newaxis]
        keys *= (here @ weights["query"])[:, np.newaxis]
        by_head = (*around.shape, HEADS, -1)
        shares = softmax(keys.reshape(by_head).sum(axis=3), key.shape[1] // HEADS)
        values = value[around].reshape(by_head)
        values *= shares[..., np.newaxis]
        joined = here + (values.sum(axis=1).reshape(here.shape) - value[rows])
        normed = joined * weights["factors"][0] + weights["shifts"][0]
        after = normed + _leaky(normed @ weights["up"]) @ weights["down"]
        out[rows] = after * weights["factors"][1] + weights["shifts"][1]

    _on_blocks(of_block, len(features))
    return out


def unevenness(weights: Weights, features: Features, index: Index) -> NDArray[np.float64]:
    """Return the standard deviation of the attention of each point to its neighbours, (N,)."""
    scores, key = np.empty(len(features)), features @ weights["key"]

    def of_block(rows: slice) -> None:
        keys = key[index[rows]] - key[rows, np.newaxis]
        keys *= (features[rows] @ weights["query"])[:, np.newaxis]
        scores[rows] = softmax(keys.sum(axis=2), key.shape[1]).std(axis=1, dtype=np.float64)

    _on_blocks(of_block, len(features))
    return scores


def attention_received(weights: Weights, features: Features) -> NDArray[np.float64]:
    """Return the attention that each point gets from all points, (N,); it takes N x N numbers."""
    query, key = features @ weights["query"], features @ weights["key"]
    shares = np.empty((len(key), len(key)), dtype=np.float32)

    def of_block(rows: slice) -> None:
        shares[rows] = softmax(query[rows] @ key.T, key.shape[1])

    _on_blocks(of_block, len(key))
    return shares.sum(axis=0, dtype=np.float64)


def _edge_conv(weights: Weights, centre: Features, difference: Callable[[slice], Features]) -> Features:
    """Return features, (N, 32), of centres, (N, c), and of the differences of a block, (n, k, 32), already weighed."""
    out = np.empty((len(centre), weights["second"].shape[1]), dtype=np.float32)
    of_centre = centre @ weights["centre"] + weights["shift"]

    def of_block(rows: slice) -> None:
        edges = _leaky(difference(rows) + of_centre[rows, np.newaxis])
        out[rows] = _leaky((edges @ weights["second"]).max(axis=1) + weights["shift_2"])

    _on_blocks(of_block, len(centre))
    return out


def _leaky(values: Features) -> Features:
    return np.maximum(values, SLOPE * values)


def softmax(products: NDArray[Any], width: int) -> Features:
    """Return the attention over the second axis, by dot products of vectors of a width."""
    powers: Features = np.exp((products - products.max(axis=1, keepdims=True)) / np.float32(width**0.5))
    powers /= powers.sum(axis=1, keepdims=True)
    return powers


def _on_blocks(work: Callable[[slice], None], n: int) -> None:
    """Do the work on each block of n points, in several threads."""

    def on_range(begin: int, end: int) -> None:
        for block in range(begin, end):
            work(slice(block * BLOCK, min((block + 1) * BLOCK, n)))

    on_ranges(on_range, -(-n // BLOCK))
