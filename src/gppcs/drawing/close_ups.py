"""Which parts of a picture deserve a closer look."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gppcs.drawing.camera import Square

Array = NDArray[np.float64]

APART = 1.5  # least distance between two squares' corners along one axis, in sides
FEATURELESS = 1e-3  # of the best square's sum: what has less is no feature


def feature_squares(variation: Array, side: int, count: int) -> list[Square]:
    """Return the squares of a picture in which the mean of a quantity is largest, well apart from each other.

    Parameters
    ----------
    variation : (height, width) array
        Non-negative; 0 where there is nothing.
    side : int
        Of the squares, in pixels; at most the height and the width.
    count : int
        How many squares are wanted. There are fewer where nothing else is left.
    """
    # The sum over a square from sums over all that lies above and to the left of its corners.
    corner = np.pad(variation.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = corner[side:, side:] - corner[:-side, side:] - corner[side:, :-side] + corner[:-side, :-side]
    squares: list[Square] = []
    least = FEATURELESS * sums.max()
    while len(squares) < count:
        row, column = np.unravel_index(sums.argmax(), sums.shape)
        if sums[row, column] <= least:
            break
        squares.append(Square(int(column), int(row), side))
        near = math.ceil(APART * side)
        sums[max(row - near, 0) : row + near, max(column - near, 0) : column + near] = 0.0
    return squares
