"""Several methods side by side."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gppcs
from gppcs.evaluation import reconstruction
from gppcs.evaluation.comparison import rebuilt_mesh
from gppcs.evaluation.reconstruction import without_membranes
from meshes import hull_mesh, moved


@pytest.fixture(scope="module")
def sphere(sphere):
    return sphere[:15_000]


def test_entries_are_what_simplify_and_evaluate_give(bracket):
    broken = np.concatenate([bracket, [[np.nan, 0, 0]]])
    entries = gppcs.compare(broken, ["fps", gppcs.Random(seed=5)], n_points=400, invalid="drop")
    assert [entry.method for entry in entries] == [gppcs.FarthestPoint(), gppcs.Random(seed=5)]
    for entry in entries:
        expected = gppcs.simplify(bracket, n_points=400, method=entry.method)
        np.testing.assert_array_equal(entry.result.indices, expected.indices)
        assert entry.report == gppcs.evaluate(bracket, expected.cloud)
        assert entry.seconds > 0
        assert entry.failure is None
    assert ["random numbers" in entry.result.seconds for entry in entries] == [False, True]  # each has its own


def test_all_methods_by_default():
    entries = gppcs.compare(gppcs.sample("bracket", 300), n_points=30)
    assert [entry.method.name for entry in entries] == list(gppcs.METHODS)


def test_a_mesh_to_look_at_ends_where_the_points_end(sphere, monkeypatch):
    """Screened Poisson reconstruction closes the open half of a sphere by a membrane."""
    pytest.importorskip("pymeshlab")
    monkeypatch.setattr(reconstruction, "OCTREE_DEPTH", 6)
    half = sphere[sphere[:, 2] > 0.0]
    place = np.array([500_000.0, 5_400_000.0, 0.0])
    outward = dict(zip(("nx", "ny", "nz"), half.T, strict=True))
    original = gppcs.PointCloud(half + place, outward)
    mesh = rebuilt_mesh(original.take(np.arange(300)), original)
    assert rebuilt_mesh(original.take(np.arange(2)), original) is None
    used = mesh.vertices[np.unique(mesh.faces)]
    gaps, _ = cKDTree(original.points).query(used)
    spacing = np.sqrt(2.0 * np.pi / len(half))
    assert gaps.max() < 6.0 * spacing
    assert mesh.face_areas().sum() == pytest.approx(2.0 * np.pi, rel=0.2)
    assert rebuilt_mesh(original, gppcs.PointCloud(original.points + 100.0), mesh) is None


@pytest.mark.parametrize(
    ("methods", "options", "message"),
    [
        (["fps", "fsp"], {"ratio": 0.1}, "no method 'fsp'"),
        (["fps"], {}, "and `max_gap`, found none"),
        (["fps"], {"ratio": 5}, "at most 1, found 5"),
        ([], {"ratio": 0.1}, "at least one method"),
        (["random"], {"ratio": 0.1, "seed": -1}, "seed to be at least 0, found -1"),
    ],
)
def test_wrong_parameters_are_refused_before_the_cloud_is_read(methods, options, message):
    with pytest.raises(gppcs.ParameterError, match=message):
        gppcs.compare("no cloud, which nobody has looked at", methods, **options)


def test_membranes_far_from_all_points_are_cut_off(sphere):
    """The hull of a sphere without its cap closes the gap by large triangles, to which a corner above it belongs."""
    points = sphere[:2000][sphere[:2000, 2] < 0.5]
    mesh = hull_mesh(np.vstack([points, [0.0, 0.0, 1.0]]))
    left = without_membranes(mesh, points)
    at_the_corner = (mesh.faces == len(points)).any(axis=1)
    np.testing.assert_array_equal(left.faces, mesh.faces[~at_the_corner])
    with pytest.raises(gppcs.errors.NoSurfaceError, match="far from all"):
        without_membranes(moved(mesh, 9), points)
