"""Selects the parts of a picture that close-ups show."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gppcs.drawing.camera import Square

Array = NDArray[np.float64]

MIN_SEPARATION = 1.5  # least distance between the corners of two squares along one axis, in edge lengths
MIN_SHARE = 1e-3  # a square below this share of the largest sum shows no feature


def feature_squares(variation: Array, side: int, count: int) -> list[Square]:
    """Return the squares of a picture in which the mean of a quantity is largest, at a distance from each other.

    Shapes: variation (height, width).
    """
    # The sum over a square, from cumulative sums at its corners.
    corner = np.pad(variation.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = corner[side:, side:] - corner[:-side, side:] - corner[side:, :-side] + corner[:-side, :-side]
    squares: list[Square] = []
    least = MIN_SHARE * sums.max()
    while len(squares) < count:
        row, column = np.unravel_index(sums.argmax(), sums.shape)
        if sums[row, column] <= least:
            break
        squares.append(Square(int(column), int(row), side))
        near = math.ceil(MIN_SEPARATION * side)
        sums[max(row - near, 0) : row + near, max(column - near, 0) : column + near] = 0.0
    return squares
