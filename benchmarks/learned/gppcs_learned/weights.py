"""Load the weights of the learned methods, which benchmarks/learned/train.py made."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FOLDER = Path(__file__).parent
NEIGHBOURS = 16  # nearest others of a point that the layers look at
LATENT = 0.1  # weight of the learned coordinates of the latent space; the others are places in a ball of radius 1

Weights = dict[str, NDArray[np.float32]]


@cache
def weights_of(name: str) -> Weights:
    """Return the weights of a network by the names of its layers; they must not be changed."""
    with np.load(FOLDER / f"{name}.npz") as arrays:
        return dict(arrays)


def part(weights: Weights, name: str) -> Weights:
    """Return the weights of one layer, whose names begin with that of the layer and a dot."""
    start = f"{name}."
    return {key.removeprefix(start): value for key, value in weights.items() if key.startswith(start)}
