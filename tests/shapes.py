"""Meshes and clouds whose topology is known."""

import numpy as np
from scipy.spatial import ConvexHull, Delaunay

from gppcs.meshing.halfedges import HalfEdges


def on_sphere(n, seed=0):
    """Random points of the unit sphere."""
    points = np.random.default_rng(seed).standard_normal((n, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def noisy(points, sigma, seed=1):
    """Points with normal noise of a standard deviation in each coordinate."""
    return points + sigma * np.random.default_rng(seed).standard_normal(points.shape)


def ball(n, seed=0):
    """Points, normals and faces of a triangulated unit sphere."""
    points = on_sphere(n, seed)
    return points, points.copy(), hull(points)


def hull(points):
    """Faces of the convex hull of points around the origin, oriented outward."""
    faces = ConvexHull(points).simplices.astype(np.int64)
    inward = np.linalg.det(points[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def sheet(n, seed=0, hole=0.0):
    """Points, normals and faces of a triangulated wavy square, with a round hole if its radius is not zero."""
    rng = np.random.default_rng(seed)
    plane = rng.random((n, 2))
    if hole:
        plane = plane[np.linalg.norm(plane - 0.5, axis=1) > hole]
    faces = Delaunay(plane).simplices.astype(np.int64)
    a, b, c = (plane[corner] for corner in faces.T)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    faces[ux * vy < uy * vx] = faces[ux * vy < uy * vx][:, ::-1]
    if hole:
        faces = faces[np.linalg.norm(plane[faces].mean(axis=1) - 0.5, axis=1) > hole]
    points = np.column_stack([plane, 0.05 * np.sin(6 * plane[:, 0])])
    return points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), faces


def torus(n, seed=0, radius=0.4):
    """Points and normals of a torus around the z axis, uniform by area."""
    rng = np.random.default_rng(seed)
    u, v, w = rng.random((3, 3 * n))
    keep = w < (1 + radius * np.cos(2 * np.pi * v)) / (1 + radius)
    u, v = 2 * np.pi * u[keep][:n], 2 * np.pi * v[keep][:n]
    ring = np.column_stack([np.cos(u), np.sin(u), np.zeros(len(u))])
    normals = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * [0.0, 0.0, 1.0]
    return ring + radius * normals, normals


def drilled_plate(n, across, radius, thickness, seed=0):
    """Points of a plate of side 1 with rows and columns of drilled holes, uniform by area."""
    rng = np.random.default_rng(seed)
    around = 2 * np.pi * radius * across**2
    areas = np.array([2 - around * radius, 4 * thickness, around * thickness])  # both faces, the sides, the bores
    face, side, wall = rng.multinomial(n, areas / areas.sum())
    plane = rng.random((2 * n, 2))
    plane = plane[np.linalg.norm(across * plane % 1 - 0.5, axis=1) > across * radius][:face]
    along, end, turned = rng.random(side), rng.integers(0, 2, side), rng.random(side) < 0.5
    rim = np.where(turned, [along, end], [end, along]).T
    angle = 2 * np.pi * rng.random(wall)
    rings = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    bores = (rng.integers(0, across, (wall, 2)) + 0.5) / across + rings
    height = np.concatenate([rng.integers(0, 2, face), rng.random(side + wall)])
    return np.column_stack([np.concatenate([plane, rim, bores]), thickness * height])


def random_mesh(seed):
    """Points, normals and half-edges of a sphere or a sheet, perhaps with a hole."""
    points, normals, faces = [ball(60, seed), sheet(80, seed), sheet(120, seed, hole=0.2)][seed % 3]
    return points, normals, HalfEdges.from_faces(faces, len(points))


def faults(mesh):
    """The half-edges and vertices of a mesh whose connections are not those of an oriented manifold."""
    there = [h for h in range(len(mesh.origin)) if mesh.origin[h] >= 0]
    edge = {h: (mesh.origin[h], mesh.origin[h - 2 if h % 3 == 2 else h + 1]) for h in there}
    number = {ends: h for h, ends in edge.items()}
    found = [h for h, (p, q) in edge.items() if p == q or mesh.opposite[h] != number.get((q, p), -1)]
    found += [h for h, ends in edge.items() if number[ends] != h]  # a directed edge is there twice
    leaving = {v: {h for h in there if mesh.origin[h] == v} for v in set(mesh.origin) - {-1}}
    for v in range(len(mesh.leaving)):
        h, fan = mesh.leaving[v], set()
        while h >= 0 and h not in fan:
            fan.add(h)
            h = mesh.opposite[h + 2 if h % 3 == 0 else h - 1]
        if fan != leaving.get(v, set()):  # half-edges of other vertices, or the triangles are not one fan
            found.append(v)
    return found


def square(n, left=1, seed=0):
    """Random points of a unit square, (n, 3), whose left half is some times as dense."""
    rng = np.random.default_rng(seed)
    points = np.c_[rng.random((n, 2)), np.zeros(n)]
    more = rng.random(((left - 1) * n // 2, 3)) * [0.5, 1, 0]
    return np.concatenate([points, more])


def cube(n):
    """Random points of the surface of a unit cube, (n, 3)."""
    rng = np.random.default_rng(0)
    points = rng.random((n, 3))
    points[np.arange(n), rng.integers(0, 3, n)] = rng.integers(0, 2, n)
    return points


def odd_clouds():
    """Clouds that are hard on trees and fits, by name; the last are of several leaves of a tree."""
    rng = np.random.default_rng(0)
    places = rng.random((45, 3))
    return {
        "one": np.ones((1, 3)),
        "two": np.array([[0.0, 0, 0], [1, 2, 3]]),
        "all equal": np.full((6, 3), 0.1),
        "collinear": np.outer(np.arange(8.0), [1, 2, 3]),
        "coplanar": np.c_[rng.random((10, 2)), np.zeros(10)],
        "mostly repeats": rng.random((3, 3))[rng.integers(0, 3, 12)],
        "plus and minus zero": np.array([[0.0, 0, 0], [-0.0, 0, 0], [0, -0.0, 0], [1, 0, 0]]),
        "tiny": 1e-300 * rng.random((5, 3)),
        "huge": 1e200 * rng.random((5, 3)),
        "far outlier": np.concatenate([rng.random((9, 3)), [[1e12, 0, 0]]]),
        **{f"random {n}": rng.random((n, 3)) for n in (3, 4, 5, 8, 12)},
        "long line": rng.random((90, 1)) * [1, 2, 3],
        "large plane": np.c_[rng.random((90, 2)), np.zeros(90)],
        "lattice": rng.permutation(np.indices((5, 5, 4)).reshape(3, -1).T),
        "far clumps": rng.integers(0, 2, (90, 1)) + 1e-9 * rng.random((90, 3)),
        "large and far outlier": np.concatenate([rng.random((90, 3)), [[1e9, 0, 0]]]),
        "coincident to rounding": np.concatenate([places, np.nextafter(places, 1)]),
    }


def rotation(seed):
    """A random orthogonal matrix."""
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]


# Clouds of n points of some kind, by a random generator and n.
KINDS = {
    "solid": lambda rng, n: rng.random((n, 3)),
    "sphere": lambda rng, n: (v := rng.standard_normal((n, 3))) / np.linalg.norm(v, axis=1, keepdims=True),
    "grid, with ties and repeats": lambda rng, n: rng.integers(0, 4, (n, 3)).astype(float),
    "lattice": lambda rng, n: rng.permutation(np.indices((8, 8, 8)).reshape(3, -1).T)[:n] / 8,
    "lattice in a plane": lambda rng, n: rng.permutation(np.indices((12, 12, 1)).reshape(3, -1).T)[:n] + 0.0,
    "tilted plane": lambda rng, n: rng.random((n, 2)) @ [[1.0, 0.0, 0.3], [0.0, 1.0, 0.7]],
    "line": lambda rng, n: rng.random((n, 1)) * [[1.0, 2.0, 3.0]],
    "one place": lambda rng, n: np.ones((n, 3)),
    "uneven": lambda rng, n: rng.random((n, 3)) ** 6,
    "far outlier": lambda rng, n: np.vstack([[[1e6, 0.0, 0.0]], rng.random((n - 1, 3))]),
    "far clumps": lambda rng, n: rng.integers(0, 4, (n, 1)) * [[1.0, 3.0, 9.0]] + 0.1 * rng.random((n, 3)),
    "clump": lambda rng, n: np.where(np.arange(n)[:, None] % 3 == 0, 1.0, 1e-9) * rng.random((n, 3)),
    "dot": lambda rng, n: np.where(rng.random((n, 1)) < 0.5, 1.0, 0.05) * rng.random((n, 3)),
}


def metres_of_degrees(longitude, latitude):
    """The lengths of a degree of longitude and of latitude on WGS 84, from distances in space."""

    def in_space(east, north):
        east, north, square = np.radians(longitude + east), np.radians(latitude + north), 0.00669437999014
        radius = 6378137 / np.sqrt(1 - square * np.sin(north) ** 2)
        across = radius * np.cos(north)
        return np.array([across * np.cos(east), across * np.sin(east), radius * (1 - square) * np.sin(north)])

    step = 0.001
    return [
        np.linalg.norm(in_space(east, north) - in_space(-east, -north)) / (2 * step)
        for east, north in ((step, 0), (0, step))
    ]


def plate(n, thickness, seed=0):
    """Points anywhere on a turned plate so many spacings thick, their normals, and its area."""
    rng, area = np.random.default_rng(seed), 2.0
    for _ in range(20):
        sides = np.array([1.0, 1.0, thickness * np.sqrt(area / n)])
        areas = np.roll(sides, 1) * np.roll(sides, 2)
        area = 2 * areas.sum()
    axis, upper = rng.choice(3, n, p=areas / areas.sum()), rng.integers(0, 2, n)
    points, normals = rng.random((n, 3)) * sides, np.zeros((n, 3))
    points[np.arange(n), axis], normals[np.arange(n), axis] = upper * sides[axis], 2 * upper - 1
    turn = rotation(seed)
    return points @ turn, normals @ turn, area
