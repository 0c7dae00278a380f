"""The classes `Mesh`, triangles between vertices, and `Texture`, their colours as a picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import array_of, require_numbers
from gppcs.engine.equality import ComparedByValue
from gppcs.errors import InputError


@dataclass(frozen=True, eq=False)
class Mesh(ComparedByValue):
    """Triangles between vertices.

    Parameters
    ----------
    vertices : (V, 3) array, float64
        Finite coordinates, in any unit.
    faces : (F, 3) array, int64
        Indices of the three vertices of each triangle, counter-clockwise as seen from outside.

    Raises
    ------
    InputError
        If the arrays have other shapes or types, there is no triangle, an index is out of range, or a coordinate is
        not finite.

    Examples
    --------
    >>> mesh = gppcs.Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    >>> mesh.face_areas()
    array([2.])
    >>> mesh.count_pieces()
    1
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"Mesh(vertices={len(self.vertices)}, triangles={len(self.faces)})"

    def __post_init__(self) -> None:
        vertices = array_of(self.vertices, "vertices of shape (V, 3)")
        faces = array_of(self.faces, "faces of shape (F, 3)")
        require_numbers(vertices.dtype, "numbers as vertices, found an array of")
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            raise InputError(
                f"expected vertices of shape (V, 3) and faces of shape (F, 3), found {vertices.shape}, {faces.shape}"
            )
        if len(faces) == 0:
            raise InputError(f"expected a mesh with triangles, found {len(vertices)} points and no triangle")
        if not np.issubdtype(faces.dtype, np.integer):
            raise InputError(
                f"expected whole numbers as faces (the indices of vertices), found an array of {faces.dtype}"
            )
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(
                f"expected indices of vertices 0 to {len(vertices) - 1} in faces, found {faces.min()} to {faces.max()}"
            )
        if not np.isfinite(vertices).all():
            raise InputError("expected finite coordinates of the mesh's vertices, found NaN or infinite ones")
        object.__setattr__(self, "vertices", np.ascontiguousarray(vertices, dtype=np.float64))
        object.__setattr__(self, "faces", np.ascontiguousarray(faces, dtype=np.int64))

    def face_areas(self) -> NDArray[np.float64]:
        """Return the area of each triangle, (F,), in squared units of the coordinates."""
        return np.linalg.norm(self.face_normals(), axis=1) / 2

    def face_normals(self) -> NDArray[np.float64]:
        """Return the normal of each triangle, (F, 3), whose length is twice the area."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        return np.cross(b - a, c - a)

    def vertex_normals(self) -> NDArray[np.float64]:
        """Return the area-weighted sum of the normals of the triangles at each vertex, (V, 3), not of unit length."""
        corners, along = self.faces.ravel(), self.face_normals().T
        return np.stack([np.bincount(corners, np.repeat(axis, 3), len(self.vertices)) for axis in along], axis=1)

    def count_pieces(self) -> int:
        """Return the number of connected pieces, of triangles that share vertices; vertices without do not count."""
        from gppcs.clouds.topology import connected

        used, faces = np.unique(self.faces, return_inverse=True)
        faces = faces.reshape(self.faces.shape)
        return connected(faces[:, :2].ravel(), faces[:, 1:].ravel(), len(used))[0]


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
