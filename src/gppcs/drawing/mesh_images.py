"""Draws meshes: triangles with a depth buffer, shaded by smooth normals between sharp edges."""

import math
from collections.abc import Sequence

import numpy as np

from gppcs.clouds.mesh import Mesh
from gppcs.clouds.topology import connected
from gppcs.drawing.camera import Camera, averaged
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel

GREY = 0.88
SHARP = math.radians(20.0)  # no smooth shading across edges with a larger angle between their faces
AMBIENT = 0.12
AMBIENT_OF_COLOURS = 0.26  # which are to be as bright as those of a cloud beside
LIGHTS = (  # right, up, to the viewer; intensity: a key light, one at the viewer, a fill light
    ((-0.6, 0.7, 0.4), 0.85),
    ((0.0, 0.0, 1.0), 0.3),
    ((0.8, -0.1, 0.6), 0.15),
)


def mesh_images(mesh: Mesh, cameras: Sequence[Camera], colours: Floats | None = None) -> list[Floats]:
    """Return the pictures, (height, width, 3) each, of a mesh with the colours (V, 3), seen by several cameras."""
    split, vertices = _split_at_sharp_edges(mesh)
    paint = np.full((len(vertices), 3), GREY) if colours is None else colours[vertices]
    return [_image(split, paint, AMBIENT if colours is None else AMBIENT_OF_COLOURS, camera) for camera in cameras]


def _split_at_sharp_edges(mesh: Mesh) -> tuple[Mesh, Ints]:
    """Return a mesh in which sharp edges part the faces, and which vertex of the first each of its vertices was."""
    from trimesh import Trimesh

    drawn = Trimesh(mesh.vertices, mesh.faces, process=False)
    smooth = drawn.face_adjacency[drawn.face_adjacency_angles < SHARP]
    count, patches = connected(smooth[:, 0], smooth[:, 1], len(mesh.faces))
    corners, faces = np.unique(mesh.faces * count + patches[:, None], return_inverse=True)
    vertices = corners // count
    return Mesh(mesh.vertices[vertices], faces.reshape(-1, 3)), vertices


def _image(mesh: Mesh, colours: Floats, ambient: float, camera: Camera) -> Floats:
    """Return the picture of a mesh with the colours (V, 3) and as much ambient light."""
    positions, depth = camera.positions(mesh.vertices)
    shape = camera.shape[::-1]
    nearest, weights = rasterised(positions, depth, mesh.faces, shape)
    covered = nearest >= 0
    corners, weight = mesh.faces[nearest[covered]], weights[covered]
    seen = np.einsum("kc,kcx->kx", weight, (mesh.vertex_normals() @ camera.axes.T)[corners])
    seen /= np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), np.finfo(float).tiny)
    seen *= np.where(seen[:, 2:] < 0.0, -1.0, 1.0)  # both sides are lit
    light = np.full(len(seen), ambient)
    for direction, intensity in LIGHTS:
        light += intensity * np.clip(seen @ (np.array(direction) / np.linalg.norm(direction)), 0.0, 1.0)
    image = np.ones((*shape, 3))
    image[covered] = np.clip(np.einsum("kc,kcx->kx", weight, colours[corners]) * light[:, None], 0.0, 1.0)
    return averaged(image)


def rasterised(positions: Floats, depth: Floats, faces: Ints, shape: tuple[int, int]) -> tuple[Ints, Floats]:
    """Return the nearest face in each pixel, -1 if there is none, and the barycentric weights of its corners."""
    nearest, weights = np.full(shape, -1), np.zeros((*shape, 3))
    _rasterise(positions, depth, faces, np.full(shape, np.inf), nearest, weights)
    return nearest, weights


@kernel(allocates=False)
def _rasterise(positions, depth, faces, buffer, nearest, weights):
    """Enter into each pixel the nearest face and the barycentric weights of its corners."""
    height, width = nearest.shape
    for index in range(len(faces)):
        a, b, c = faces[index]
        x, y = positions[a]
        x_b, y_b = positions[b, 0] - x, positions[b, 1] - y
        x_c, y_c = positions[c, 0] - x, positions[c, 1] - y
        doubled = x_b * y_c - x_c * y_b
        if doubled == 0.0:
            continue
        top, bottom = y + min(0.0, y_b, y_c), y + max(0.0, y_b, y_c)
        left, right = x + min(0.0, x_b, x_c), x + max(0.0, x_b, x_c)
        for row in range(max(int(top), 0), min(int(bottom) + 1, height)):
            for column in range(max(int(left), 0), min(int(right) + 1, width)):
                dx, dy = column + 0.5 - x, row + 0.5 - y
                of_b = (dx * y_c - x_c * dy) / doubled
                of_c = (x_b * dy - dx * y_b) / doubled
                of_a = 1.0 - of_b - of_c
                if of_a < 0.0 or of_b < 0.0 or of_c < 0.0:
                    continue
                z = of_a * depth[a] + of_b * depth[b] + of_c * depth[c]
                if z < buffer[row, column]:
                    buffer[row, column] = z
                    nearest[row, column] = index
                    weights[row, column, 0], weights[row, column, 1], weights[row, column, 2] = of_a, of_b, of_c
