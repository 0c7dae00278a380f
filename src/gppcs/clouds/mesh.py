"""A triangle mesh, to judge a simplification by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.errors import InputError


@dataclass(frozen=True)
class Mesh:
    """Triangles between vertices.

    Parameters
    ----------
    vertices : (V, 3) array, float64
        Coordinates, in the unit of the file.
    faces : (F, 3) array, int64
        The three vertices of each triangle, counter-clockwise as seen from outside.

    Raises
    ------
    InputError
        If there are no triangles, or what is given is not a mesh.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        vertices, faces = _table(self.vertices, "vertices"), _table(self.faces, "faces")
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
            raise InputError(
                f"expected vertices of shape (V, 3) and faces of shape (F, 3), found {vertices.shape}, {faces.shape}"
            )
        if len(faces) == 0:
            raise InputError(f"expected a mesh with triangles, found {len(vertices)} points and no triangle")
        if not np.issubdtype(faces.dtype, np.integer):
            raise InputError(
                f"expected whole numbers as faces, the indices of vertices, found an array of {faces.dtype}"
            )
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(f"expected faces of vertices 0 to {len(vertices) - 1}, found {faces.min()}, {faces.max()}")
        if not np.isfinite(vertices).all():
            raise InputError("expected finite coordinates of the mesh's vertices, found NaN or infinite ones")
        object.__setattr__(self, "vertices", np.ascontiguousarray(vertices, dtype=np.float64))
        object.__setattr__(self, "faces", np.ascontiguousarray(faces, dtype=np.int64))

    def shifted(self, offset: NDArray[np.float64]) -> Mesh:
        """Return the mesh elsewhere, moved by an offset, (3,)."""
        return Mesh(self.vertices + offset, self.faces)

    def face_areas(self) -> NDArray[np.float64]:
        """Return the area of each triangle, (F,)."""
        return np.linalg.norm(self._cross_products(), axis=1) / 2

    def require_area(self, name: str) -> None:
        """Raise an InputError that calls the mesh `name` if none of its triangles has an area."""
        if not self.face_areas().any():
            raise InputError(f"the {name} has no area: expected triangles whose corners do not lie on a line")

    def vertex_normals(self) -> NDArray[np.float64]:
        """Return the sum of the normals of the triangles at each vertex, weighted by their areas, (V, 3)."""
        products = self._cross_products()
        return np.stack(
            [
                np.bincount(self.faces.ravel(), np.repeat(products[:, axis], 3), len(self.vertices))
                for axis in range(3)
            ],
            axis=1,
        )  # fmt: skip

    def count_pieces(self) -> int:
        """Return the number of connected pieces that the triangles make."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        used, faces = np.unique(self.faces, return_inverse=True)
        faces = faces.reshape(self.faces.shape)
        ends = np.concatenate([faces[:, :2], faces[:, 1:]]).T
        graph = coo_array((np.ones(ends.shape[1]), ends), shape=(len(used), len(used)))
        return int(connected_components(graph, directed=False, return_labels=False))

    def _cross_products(self) -> NDArray[np.float64]:
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        return np.cross(b - a, c - a)


def _table(rows: ArrayLike, name: str) -> NDArray[Any]:
    """Return an array of numbers."""
    try:
        table = np.asarray(rows)
    except ValueError as error:
        raise InputError(f"expected {name} of shape (N, 3), found rows of different lengths") from error
    if not (np.issubdtype(table.dtype, np.floating) or np.issubdtype(table.dtype, np.integer)):
        raise InputError(f"expected numbers as {name}, found an array of {table.dtype}")
    return table
