"""Textures of meshes: the colours of all points."""

import json

import numpy as np
import pytest
import trimesh

import gppcs
from gppcs.clouds.colours import linear
from gppcs.clouds.columns import COLOUR
from gppcs.drawing.camera import Camera, Viewpoint
from gppcs.drawing.mesh_images import rasterised
from gppcs.spatial.kdtree import KdTree

pytest.importorskip("xatlas")
SIZE = 1024
FRESCO = gppcs.sample("fresco", n_points=100_000)


@pytest.fixture(scope="module")
def result():
    return gppcs.mesh(FRESCO, n_faces=5000)


@pytest.fixture(scope="module")
def texture(result):
    return gppcs.bake_texture(result.mesh, FRESCO, SIZE)


def colours_of(cloud):
    return np.column_stack([cloud.attributes[name] for name in COLOUR]).astype(np.float64)


def blended(weights, values):
    return np.einsum("kc,kcx->kx", weights, values)


def test_it_has_a_third_of_the_colour_error_of_the_vertices(result, texture):
    mesh, tree = result.mesh, KdTree.build(FRESCO.points)
    errors = []
    for azimuth in range(20, 380, 45):
        camera = Camera.towards(FRESCO.points, 300, (225, 225), Viewpoint("z", (azimuth, 20.0)))
        nearest, weights = rasterised(*camera.positions(mesh.vertices), mesh.faces, camera.shape[::-1])
        faces, weights = nearest[nearest >= 0], weights[nearest >= 0]
        seen = blended(weights, mesh.vertices[mesh.faces[faces]])
        expected = colours_of(FRESCO)[tree.nearest_of(seen, 1)[0][:, 0]]
        of_vertices = blended(weights, colours_of(result.cloud)[mesh.faces[faces]])
        column, row = np.floor(SIZE * blended(weights, texture.uv[texture.faces[faces]])).astype(int).T
        errors.append([np.abs(colours - expected).mean() for colours in (of_vertices, texture.image[row, column])])
    of_vertices, of_texture = np.mean(errors, axis=0)
    assert of_texture < of_vertices / 3


def test_the_triangles_lie_beside_each_other_in_the_picture(result, texture):
    assert np.array_equal(texture.indices[texture.faces], result.mesh.faces)
    corners = SIZE * texture.uv[texture.faces]
    areas = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 2
    covered = rasterised(SIZE * texture.uv, np.zeros(len(texture.uv)), texture.faces, (SIZE, SIZE))[0] >= 0
    assert covered.sum() == pytest.approx(areas.sum(), rel=0.02)
    assert covered.mean() > 0.5


@pytest.mark.parametrize("textured", [False, True])
def test_trimesh_sees_the_colours_and_gltf_is_in_metres(tmp_path, result, texture, textured):
    path = tmp_path / "wall.glb"
    gppcs.write_mesh(path, result.mesh, result.cloud, texture=texture if textured else None, unit="mm")
    mesh = trimesh.load_scene(path, process=False, skip_materials=not textured).to_mesh()
    assert mesh.extents == pytest.approx(np.ptp(result.mesh.vertices, axis=0)[[0, 2, 1]] / 1000, rel=1e-6)
    visual, indices = mesh.visual, np.arange(len(result.mesh.vertices))
    expected = 255 * linear(colours_of(result.cloud) / 255)
    if textured:
        visual, indices, expected = visual.to_color(), texture.indices, colours_of(result.cloud)[texture.indices]
    assert np.abs(visual.vertex_colors[:, :3] - expected).mean() < (8 if textured else 0.5)
    read = gppcs.read_mesh(path)
    assert read.vertices == pytest.approx(result.mesh.vertices[indices], abs=1e-3)
    data = path.read_bytes()
    description = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    images = {image["bufferView"] for image in description.get("images", [])}
    assert all(("target" in view) != (i in images) for i, view in enumerate(description["bufferViews"]))


def test_a_texture_needs_colours_its_mesh_and_gltf(tmp_path, result, texture):
    plain = gppcs.PointCloud(FRESCO.points)
    with pytest.raises(gppcs.InputError, match="red, green and blue for a texture, found none"):
        gppcs.bake_texture(result.mesh, plain)
    with pytest.raises(gppcs.ParameterError, match="at most 8192"):
        gppcs.bake_texture(result.mesh, FRESCO, 10_000)
    with pytest.raises(gppcs.errors.FileFormatError, match=r"expected \.glb"):
        gppcs.write_mesh(tmp_path / "wall.ply", result.mesh, result.cloud, texture=texture)
    other = gppcs.Mesh(result.mesh.vertices, result.mesh.faces[1:])
    with pytest.raises(gppcs.InputError, match="another mesh"):
        gppcs.write_mesh(tmp_path / "wall.glb", other, texture=texture)
    assert not list(tmp_path.iterdir())
