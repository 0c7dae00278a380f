"""Meshes that tests make."""

import numpy as np
from scipy.spatial import ConvexHull

import gppcs


def hull_mesh(points) -> gppcs.Mesh:
    """Return the convex hull of (N, 3) points around the origin, its triangles turned outwards."""
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0
    return gppcs.Mesh(points, np.where(outwards[:, None], faces, faces[:, ::-1]))
