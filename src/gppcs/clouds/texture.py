"""The class `Texture`: the colours of a mesh as a picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.equality import ComparedByValue


@dataclass(frozen=True, eq=False)
class Texture(ComparedByValue):
    """The colours of a mesh as a picture, which `gppcs.write_mesh` writes with it.

    The triangles lie beside each other in the picture, so the vertices along its seams are there several times.

    Attributes
    ----------
    image : (size, size, 3) array, uint8
        Red, green and blue, from the upper left.
    indices : (K,) array, int64
        The vertex of the mesh of each vertex of the texture.
    uv : (K, 2) array, float64
        Where the vertices are in the picture, from 0 to 1: to the right and down, from the upper left corner.
    faces : (F, 3) array, int64
        The triangles of the mesh, in its order, by vertices of the texture.
    """

    image: NDArray[np.uint8]
    indices: NDArray[np.int64]
    uv: NDArray[np.float64]
    faces: NDArray[np.int64]
