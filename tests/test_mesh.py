"""Meshes: what they tell of themselves, what is refused."""

import sys

import numpy as np
import pytest

import gppcs

SQUARE = gppcs.Mesh([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 3]])


def test_areas_and_normals():
    np.testing.assert_allclose(SQUARE.face_areas(), [2, 2])
    np.testing.assert_allclose(SQUARE.vertex_normals(), [[0, 0, 8], [0, 0, 4], [0, 0, 8], [0, 0, 4]])


def test_pieces_are_counted_without_unused_vertices():
    vertices = np.concatenate([SQUARE.vertices, SQUARE.vertices + 5, [[9, 9, 9]]])
    mesh = gppcs.Mesh(vertices, np.concatenate([SQUARE.faces, SQUARE.faces + 4]))
    assert (SQUARE.count_pieces(), mesh.count_pieces()) == (1, 2)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], "shape"),
        (np.zeros((3, 3)), [[0, 1, 2, 0]], "shape"),
        (np.zeros((3, 3)), np.empty((0, 3)), "3 points and no triangle"),
        (np.zeros((3, 3)), [[0, 1, 3]], "vertices 0 to 2, found 0, 3"),
        (np.full((3, 3), np.inf), [[0, 1, 2]], "NaN or infinite"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, message):
    with pytest.raises(gppcs.InputError, match=message):
        gppcs.Mesh(vertices, faces)


@pytest.fixture
def off(tmp_path):
    pytest.importorskip("pymeshlab")
    path = tmp_path / "square.off"
    path.write_text("OFF\n4 1 0\n0 0 0\n2 0 0\n2 2 0\n0 2 0\n4 0 1 2 3\n")
    return path


def test_polygons_are_read_as_triangles(off):
    mesh = gppcs.read_mesh(off)
    np.testing.assert_array_equal(mesh.vertices, SQUARE.vertices)
    assert mesh.face_areas().sum() == 4
    assert len(mesh.faces) == 2


def test_files_without_a_mesh_are_refused(off, tmp_path):
    gppcs.write(tmp_path / "points.ply", gppcs.sample("bracket", 100))
    (tmp_path / "text.ply").write_text("no mesh")
    for name, message in (
        ("points.ply", "100 points and no triangle"),
        ("text.ply", "expected a mesh"),
        ("", "folder"),
    ):
        with pytest.raises(gppcs.FileFormatError, match=message):
            gppcs.read_mesh(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        gppcs.read_mesh(tmp_path / "missing.ply")


def test_a_missing_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(gppcs.MissingExtraError, match=r"pip install 'gppcs\[evaluate\]'"):
        gppcs.read_mesh(tmp_path / "mesh.ply")


def test_shared_meshes(shared_data):
    pytest.importorskip("pymeshlab")
    mesh = gppcs.read_mesh(shared_data / "bunny.ply")
    assert (len(mesh.vertices), len(mesh.faces)) == (35_947, 69_451)
