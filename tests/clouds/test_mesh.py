"""Meshes: what they tell of themselves, what is refused."""

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
        (np.zeros((3, 3)), [[0, 1, 2, 0]], "shape"),
        (np.zeros((3, 3)), np.empty((0, 3)), "3 points and no triangle"),
        (np.zeros((3, 3)), [[0, 1, 3]], "vertices 0 to 2 in faces, found 0 to 3"),
        (np.full((3, 3), np.inf), [[0, 1, 2]], "NaN or infinite"),
        (np.zeros((3, 3)), [[0, 1, 1.5]], "whole numbers as faces.*float64"),
        (np.zeros((3, 3)), [[0, 1, 2], [0, 1]], "faces of shape .* rows of different lengths"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, message):
    with pytest.raises(gppcs.InputError, match=message):
        gppcs.Mesh(vertices, faces)


def test_files_without_a_mesh_are_refused(tmp_path):
    gppcs.write(tmp_path / "points.ply", gppcs.sample("bracket", 100))
    gppcs.write(tmp_path / "points.las", gppcs.sample("bracket", 100), lossy=True)
    (tmp_path / "text.ply").write_text("no mesh")
    for name, message in (
        ("points.ply", "100 points and no triangle"),
        ("text.ply", "expected 'ply'"),
        ("", "folder"),
        ("points.las", "expected a mesh, found LAS"),
    ):
        with pytest.raises(gppcs.errors.FileFormatError, match=message):
            gppcs.read_mesh(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        gppcs.read_mesh(tmp_path / "missing.ply")
