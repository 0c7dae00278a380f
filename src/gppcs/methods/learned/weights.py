"""Load the weights of the learned methods, which benchmarks/learned/train.py makes, and check that they are whole."""

from __future__ import annotations

import hashlib
import io
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gppcs.errors import FileFormatError, InputError  # noqa: F401

FOLDER = Path(__file__).parent
NEIGHBOURS = 16  # nearest points that a layer looks at
LATENT = 0.1  # weight of the learned coordinates of the latent space; the others are places in a ball of radius 1
DIGESTS = {  # SHA-256 of each file
    "apes": "",
    "apes-global": "",
    "potamias": "",
}

Weights = dict[str, NDArray[np.float32]]
