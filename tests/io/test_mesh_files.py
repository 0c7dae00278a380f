"""Meshes that are written are read back, with what the format holds."""

import json
import re

import numpy as np
import pytest
import trimesh

import gppcs
from formats import glb, parts_of_glb
from gppcs.clouds.colours import linear
from gppcs.errors import FileFormatError, OutputError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
COLOURS = {
    "red": np.array([0, 255, 10, 7], np.uint8),
    "green": np.array([1, 2, 3, 128], np.uint8),
    "blue": np.array([255, 0, 4, 9], np.uint8),
}
LABEL = ["attribute label (int64)"]
DIGITS = ["the last digits of coordinates (which move by at most 2e-08)"]
NORMALS = {name: np.float32([0.6, 0, 0.6, 0])[[i, 1, 2, 3]] for i, name in enumerate(("nx", "ny", "nz"))}


@pytest.fixture
def mesh():
    return gppcs.Mesh(CORNERS, FACES)


@pytest.fixture
def vertices():
    return gppcs.PointCloud(CORNERS, {**COLOURS, **NORMALS, "label": np.arange(4)})


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".stl", ".glb", ".glb.gz"])
@pytest.mark.parametrize("with_attributes", [False, True])
def test_meshes_are_read_back_with_what_the_format_holds(tmp_path, mesh, vertices, suffix, with_attributes):
    path, given = tmp_path / f"mesh{suffix}", vertices if with_attributes else None
    lost = gppcs.write_mesh(path, mesh, given, lossy=with_attributes)
    colours = [f"attribute {name} (uint8)" for name in COLOURS]
    expected = {".ply": [], ".stl": [*colours, *LABEL]}.get(suffix, LABEL)
    is_single = suffix.startswith((".stl", ".glb"))
    assert lost == [*(expected if with_attributes else []), *(DIGITS if is_single else [])]
    content = path.read_bytes()
    gppcs.write_mesh(path, mesh, given, lossy=True, force=True)
    assert path.read_bytes() == content
    found, cloud = gppcs.read_mesh(path), gppcs.read(path)
    order = np.lexsort(found.vertices.T), np.lexsort(CORNERS.T)
    assert found.vertices[order[0]] == pytest.approx(CORNERS[order[1]], abs=1e-7)
    volume = np.linalg.det(found.vertices[found.faces]).sum() / 6
    assert volume == pytest.approx(1.1 / 6)  # so the triangles are those, with their orientation
    if suffix == ".stl":  # which has corners of triangles alone
        return
    assert np.array_equal(found.faces, FACES)
    assert ("label" in cloud.attributes) == (with_attributes and suffix == ".ply")
    for name, values in COLOURS.items() if with_attributes else ():
        assert np.round((255 if suffix == ".obj" else 1) * cloud.attributes[name]) == pytest.approx(values)
    for name, values in NORMALS.items() if with_attributes and suffix in (".ply", ".off") else ():
        assert np.array_equal(cloud.attributes[name].astype(values.dtype), values), name


def test_gltf_is_what_trimesh_reads_and_writes(tmp_path, mesh, vertices):
    path = tmp_path / "mesh.glb"
    assert gppcs.write_mesh(path, mesh, vertices, lossy=True) == [*LABEL, *DIGITS]
    scene = trimesh.load_scene(path, process=False, skip_materials=True)
    (read,) = scene.geometry.values()
    assert np.array_equal(read.faces, FACES)
    light = linear(np.column_stack(list(COLOURS.values())) / 255)  # as three.js and Blender expect it
    assert np.array_equal(read.visual.vertex_colors[:, :3], np.round(255 * light))
    assert scene.to_mesh().vertices == pytest.approx(CORNERS @ [[1, 0, 0], [0, 0, -1], [0, 1, 0]], abs=1e-7)  # y is up
    scene.apply_translation(np.array([500_000.1, 0, -4_100_000.2]))
    scene.export(tmp_path / "moved.glb")
    moved = gppcs.read(tmp_path / "moved.glb")  # a file of trimesh, whose coordinates stay
    assert moved.points == pytest.approx(scene.to_mesh().vertices, abs=1e-6)
    assert moved.coordinate_dtype == np.float64


def test_gltf_of_a_survey_keeps_its_millimetres(tmp_path):
    ball = trimesh.creation.icosphere(2, 40.0)
    far = gppcs.Mesh(ball.vertices + np.array([432_100.123, 5_412_300.456, 87.9]), ball.faces)
    gppcs.write_mesh(tmp_path / "far.glb", far)
    read = gppcs.read_mesh(tmp_path / "far.glb")
    assert np.abs(read.vertices - far.vertices).max() < 1e-5
    scene = trimesh.load_scene(tmp_path / "far.glb", process=False)
    (local,) = scene.geometry.values()
    assert np.abs(local.vertices).max() < 50
    assert scene.to_mesh().vertices[:, [0, 2, 1]] * [1, -1, 1] == pytest.approx(far.vertices, abs=1e-5)


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize(("faces", "is_open"), [(FACES, False), (FACES[1:], True)])
def test_gltf_shows_both_sides_of_open_meshes(tmp_path, vertices, faces, is_open, coloured):
    gppcs.write_mesh(tmp_path / "mesh.glb", gppcs.Mesh(CORNERS, faces), vertices if coloured else None)
    (material,) = json.loads(parts_of_glb((tmp_path / "mesh.glb").read_bytes())[0])["materials"]
    assert material["doubleSided"] is is_open
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0  # metal is black where no surroundings are mirrored


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'"count":12', b'"count":9999999999', "expected at most .* numbers in a file of so many bytes"),
        (b'"buffers":[{', b'"buffers":[{"uri":"/etc/passwd",', "trimesh reports"),
        (b'"scene":0', b'"scene":', "trimesh reports"),
    ],
)
def test_hostile_gltf_is_refused(tmp_path, mesh, old, new, message):
    gppcs.write_mesh(tmp_path / "mesh.glb", mesh, lossy=True)
    text, numbers = parts_of_glb((tmp_path / "mesh.glb").read_bytes())
    text = text.replace(b", ", b",").replace(b": ", b":")
    assert old in text
    (tmp_path / "mesh.glb").write_bytes(glb(text.replace(old, new), numbers))
    with pytest.raises(FileFormatError, match=message):
        gppcs.read(tmp_path / "mesh.glb")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.array([200, 100, 0, 255], np.uint16), [200, 100, 0, 255]),  # 8 bits in a type of 16, as in many LAS files
        (np.array([65535, 257, 0, 51400], np.uint16), [255, 1, 0, 200]),
        (np.array([200.0, 100.0, 0.0, 255.0]), [200, 100, 0, 255]),
        (np.array([1.0, 0.2, 0.0, 0.6]), [255, 51, 0, 153]),
    ],
)
def test_colours_of_any_type_look_the_same(tmp_path, mesh, values, expected):
    gppcs.write_mesh(tmp_path / "mesh.off", mesh, gppcs.PointCloud(CORNERS, dict.fromkeys(COLOURS, values)))
    assert gppcs.read(tmp_path / "mesh.off").attributes["red"].tolist() == expected


@pytest.mark.parametrize(
    ("suffix", "changes", "lost"),
    [
        (".obj", {"label": [1, 2, 3, 4]}, "attribute label"),
        (".ply", {"kind": np.array(["a", "b", "c", "d"])}, r"attribute kind \(text\)"),
        (".off", {"red": [1, 2, 3, 4]}, "attribute red"),  # a colour needs green and blue
        (".obj", dict.fromkeys(COLOURS, np.array([0, 300, 9, 65535], np.uint16)), "the exact values of attribute red"),
        (".stl", COLOURS, "attribute red"),
    ],
)
def test_what_a_format_cannot_hold_is_refused_and_leaves_no_file(tmp_path, mesh, suffix, changes, lost):
    cloud = gppcs.PointCloud(CORNERS, changes)
    with pytest.raises(OutputError, match=f"cannot hold: {lost}"):
        gppcs.write_mesh(tmp_path / f"mesh{suffix}", mesh, cloud)
    assert not list(tmp_path.iterdir())
    (first, *_) = gppcs.write_mesh(tmp_path / f"mesh{suffix}", mesh, cloud, lossy=True)
    assert re.match(lost, first)


def test_survey_coordinates_are_not_rounded_to_single_precision_unasked(tmp_path):
    far = gppcs.Mesh(CORNERS + np.array([5e5 + 0.1, 5e6, 0]), FACES)
    with pytest.raises(OutputError, match=r"the last digits of coordinates \(which move by"):
        gppcs.write_mesh(tmp_path / "mesh.stl", far)
    gppcs.write_mesh(tmp_path / "mesh.obj", far)
    assert len(gppcs.write_mesh(tmp_path / "mesh.stl", far, lossy=True)) == 1


@pytest.mark.parametrize("name", ["mesh.las", "mesh", "mesh.gltf"])
def test_other_formats_and_other_vertices_are_an_error(tmp_path, mesh, name):
    with pytest.raises(FileFormatError, match=r"one of the formats of meshes \.ply \.obj \.stl \.off \.glb, found"):
        gppcs.write_mesh(tmp_path / name, mesh)
    with pytest.raises(gppcs.InputError, match="the vertices of the mesh"):
        gppcs.write_mesh(tmp_path / "mesh.ply", mesh, gppcs.PointCloud(CORNERS + 1))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("extras", ["x", None, {"metresPerUnit": 0}, {"metresPerUnit": "2"}, {"metresPerUnit": [1, 2]}])
def test_lengths_of_units_in_gltf_are_one_or_three_numbers_above_zero(tmp_path, mesh, extras):
    path = tmp_path / "mesh.glb"
    gppcs.write_mesh(path, mesh)
    text, numbers = parts_of_glb(path.read_bytes())
    description = json.loads(text)
    description["asset"]["extras"] = extras
    path.write_bytes(glb(json.dumps(description).encode(), numbers))
    if isinstance(extras, dict):
        with pytest.raises(gppcs.GppcsError, match="numbers above 0 as metresPerUnit"):
            gppcs.read(path)
    else:
        assert gppcs.read(path).points == pytest.approx(CORNERS, abs=1e-7)
