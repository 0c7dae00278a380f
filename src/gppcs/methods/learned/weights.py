"""Load the weights of the learned methods, and check that they are those that benchmarks/learned/train.py made."""

from __future__ import annotations

import hashlib
import io
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError

FOLDER = Path(__file__).parent
NEIGHBOURS = 16  # nearest others of a point that the layers look at
LATENT = 0.1  # weight of the learned coordinates of the latent space; the others are places in a ball of radius 1
DIGESTS = {  # SHA-256 of each file
    "apes": "769d01e4a5c0ea58209ea7d23f781fc5f50920ca37a51cd011f8c44f6b14f438",
    "apes-global": "d3433c70467b6ed9bf5c46973306ba6d4e01dadaf7262687278c882dc4f8ffb0",
    "potamias": "77144f7ce946df6ab6355e1716602cef92d9a193a9f8fbf64fff048b68b03dab",
}

Weights = dict[str, NDArray[np.float32]]


@cache
def weights_of(name: str) -> Weights:
    """Return the weights of a network by the names of its layers; they must not be changed."""
    path = FOLDER / f"{name}.npz"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileFormatError(
            f"expected the weights of the method {name!r} in {path}, found none ({error.strerror}): install gppcs anew"
        ) from error
    found = hashlib.sha256(content).hexdigest()
    if found != DIGESTS[name]:
        raise FileFormatError(
            f"expected the weights of the method {name!r} in {path} to have the SHA-256 {DIGESTS[name][:16]}…, "
            f"found {found[:16]}…: the file is damaged or of another version, install gppcs anew"
        )
    with np.load(io.BytesIO(content)) as arrays:
        return dict(arrays)


def part(weights: Weights, name: str) -> Weights:
    """Return the weights of one layer, whose names begin with that of the layer and a dot."""
    start = f"{name}."
    return {key.removeprefix(start): value for key, value in weights.items() if key.startswith(start)}
