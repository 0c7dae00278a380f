"""The latent space of `potamias`: its coordinates, its farthest points, and the attention that moves them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs_learned.layers import Features, Index, softmax
from gppcs_learned.weights import LATENT, Weights

PART = 2048  # points of a part at most, if each part is asked for enough; about as many as in training
SHARE = 64  # points that a part is asked for at least, on average
AMPLE, SPARE = 4, 16  # a part offers so many times its share of the points, and so many more


def coordinates(weights: Weights, places: NDArray[np.float64], features: Features) -> Features:
    """Return the latent coordinates, (N, 11), of places in the unit ball, (N, 3), and features, (N, c)."""
    learned = np.float32(LATENT) * np.tanh(features @ weights["latent"])
    return np.concatenate([places.astype(np.float32), learned], axis=1)


def farthest(latent: Features, n_points: int) -> NDArray[np.int64]:
    """Choose M of N points, (N, d): parts of the tree offer their farthest, and the M largest distances are taken."""
    n = len(latent)
    parts = int(np.clip(n_points // SHARE, 1, -(-n // PART)))
    distances = np.full(n, -1.0, dtype=np.float32)
    on_ranges(_offer, parts, parts, latent, AMPLE * -(-n_points // parts) + SPARE, distances)
    return np.argsort(-distances, kind="stable")[:n_points]


@kernel(fastmath=False)
def _offer(begin, end, parts, latent, most, distances):
    """Fill the distances, (N,), at which points of the parts `begin` to `end` were chosen; they are -1 of others."""
    n, width = latent.shape
    for p in range(begin, end):
        first, last = n * p // parts, n * (p + 1) // parts
        nearest = np.empty(last - first, dtype=np.float32)
        here = np.zeros(width, dtype=np.float32)
        for i in range(first, last):
            for c in range(width):
                here[c] += latent[i, c] / np.float32(last - first)
        for step in range(min(most, last - first)):
            best, size = -1, np.float32(-1)
            for i in range(first, last):
                squared = np.float32(0)
                for c in range(width):
                    squared += (latent[i, c] - here[c]) ** 2
                # The first is the farthest from the mean, which then counts no more.
                if step < 2 or squared < nearest[i - first]:
                    nearest[i - first] = squared
                if distances[i] < 0 and nearest[i - first] > size:
                    best, size = i, nearest[i - first]
            distances[best] = size if step else np.inf
            here[:] = latent[best]


def moved(
    weights: Weights, points: NDArray[np.float64], features: Features, index: Index, kept: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the kept points, (M,), moved to the means of themselves and their neighbours by attention; (M, 3)."""
    around = np.concatenate([kept[:, np.newaxis], index[kept]], axis=1)
    query, key = features[kept] @ weights["query"], features @ weights["key"]
    products = np.stack([np.einsum("mc,mc->m", query, key[column]) for column in around.T], axis=1)
    shares = softmax(products, key.shape[1]).astype(np.float64)
    steps = sum(share[:, np.newaxis] * (points[j] - points[kept]) for share, j in zip(shares.T, around.T, strict=True))
    out: NDArray[np.float64] = points[kept] + steps
    return out
