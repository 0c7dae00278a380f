"""The topology of a mesh: whether it is a manifold, its boundary loops, pieces and handles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Topology(NamedTuple):
    """How triangles hang together."""

    non_manifold_edges: int  # Edges of more than two triangles, or of two that are not oriented alike
    non_manifold_vertices: int  # Vertices at which several fans of triangles meet
    boundary_loops: int  # Closed curves of edges with one triangle
    pieces: int  # Connected pieces
    genus: int | None  # Handles of all pieces together; None if the mesh is no oriented manifold


def topology_of(faces: NDArray[np.int64]) -> Topology:
    """Return the topology of a mesh. Shapes: faces (F, 3)."""
    vertices, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    n, corners = len(vertices), np.arange(3 * len(faces))
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    next_corner = np.roll(corners.reshape(-1, 3), -1, axis=1).ravel()
    edges, edge, counts = np.unique(
        np.minimum(begin, end) * n + np.maximum(begin, end), return_inverse=True, return_counts=True
    )
    forward = np.bincount(edge, begin < end, minlength=len(edges))
    bad = int(((counts > 2) | ((counts == 2) & (forward != 1))).sum())
    order = np.argsort(edge, kind="stable")
    pairs = order[:-1][edge[order[1:]] == edge[order[:-1]]], order[1:][edge[order[1:]] == edge[order[:-1]]]
    alike = begin[pairs[0]] == begin[pairs[1]]
    first = np.where(alike, pairs[1], next_corner[pairs[1]]), np.where(alike, next_corner[pairs[1]], pairs[1])
    n_fans, fan = connected(np.concatenate([pairs[0], next_corner[pairs[0]]]), np.concatenate(first), len(corners))
    middle = np.empty(n_fans, dtype=np.int64)
    middle[fan] = begin  # the same vertex at all corners of a fan
    several = np.bincount(middle)
    on_boundary = counts[edge] == 1
    boundary_loops = len(np.unique(connected(begin[on_boundary], end[on_boundary], n)[1][begin[on_boundary]]))
    pieces, _ = connected(begin, end, n)
    non_manifold = int((several > 1).sum())
    genus = None if bad or non_manifold else (2 * pieces - boundary_loops - (n - len(edges) + len(faces))) // 2
    return Topology(bad, non_manifold, boundary_loops, pieces, genus)


def connected(begins: NDArray[np.int64], ends: NDArray[np.int64], n: int) -> tuple[int, NDArray[np.int64]]:
    """Return the number of connected components of n nodes with some edges, (E,), and the component of each.

    Components are numbered in the order of their first nodes.
    """
    from scipy.sparse import coo_array  # only here, as it is slow to load
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(begins)), (begins, ends)), shape=(n, n))
    count, labels = connected_components(graph, directed=False)
    return int(count), labels.astype(np.int64)
