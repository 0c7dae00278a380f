"""Several pipelines to a mesh side by side."""

import numpy as np
import pytest

import gppcs
from gppcs.evaluation import mesh_comparison, reconstruction
from gppcs.evaluation.reconstruction import decimated, oriented_alike, without_membranes
from gppcs.spatial.kdtree import KdTree
from meshes import hull_mesh, moved

pytest.importorskip("pymeshlab")


@pytest.fixture
def shallow(monkeypatch):
    """Let Poisson reconstruction take a tenth of a second."""
    monkeypatch.setattr(reconstruction, "OCTREE_DEPTH", 4)


def test_entries_are_what_mesh_and_evaluate_mesh_give(bracket):
    cloud = gppcs.PointCloud(bracket[:3000] + np.array([500_000.0, 5_400_000.0, 0.0]))
    broken = np.concatenate([cloud.points, [[np.nan, 0, 0]]])
    pipelines = {"mesh": {}, "mesh-moved": {"moved": True}, "mesh-effort": {"effort": 2}}
    entries = gppcs.compare_meshes(broken, n_points=100, pipelines=pipelines, invalid="drop")
    assert [entry.pipeline for entry in entries] == [*pipelines]
    for entry in entries:
        expected = gppcs.mesh(cloud, n_points=100, **pipelines[entry.pipeline]).mesh
        assert entry.mesh == expected
        assert entry.report == gppcs.evaluate_mesh(cloud, expected)
        assert entry.seconds > 0
        assert entry.failure is None


@pytest.mark.parametrize("pipeline", ["poisson-kept", "poisson-decimated", "ball-pivoting", "advancing-front"])
def test_the_other_pipelines_find_a_sphere_wherever_it_lies(sphere, pipeline, shallow):
    if not mesh_comparison.is_installed(pipeline):
        pytest.skip("no CGAL")
    place = np.array([500_000.0, 5_400_000.0, 0.0])
    (entry,) = gppcs.compare_meshes(sphere[:2000] + place, n_points=300, pipelines=[pipeline])
    np.testing.assert_allclose(np.linalg.norm(entry.mesh.vertices - place, axis=1), 1.0, atol=0.05)
    assert (entry.report.mesh_pieces, entry.report.genus) == (1, 0)
    assert entry.report.figures(relative=True)["mesh_mean"] < 0.01
    if pipeline == "poisson-decimated":
        assert entry.report.triangles == pytest.approx(600, abs=2)
    elif pipeline == "poisson-kept":
        assert entry.report.triangles > 600
    else:
        kept = gppcs.simplify(sphere[:2000] + place, n_points=300).cloud.points
        used = entry.mesh.vertices[np.unique(entry.mesh.faces)]
        assert len(used) > 290
        assert KdTree.build(kept).nearest_of(used, 1)[1].max() < 1e-12


def test_a_pipeline_without_a_surface_says_why_and_stops_no_other(monkeypatch):
    volume = np.random.default_rng(0).random((400, 3))
    mesh, ball = gppcs.compare_meshes(volume, n_points=100, pipelines=["mesh", "ball-pivoting"])
    assert (mesh.mesh, mesh.report) == (None, None)
    assert "fill a volume" in mesh.failure
    assert ball.failure is None
    assert ball.report.triangles > 0

    elsewhere = {"mesh": lambda *_: moved(hull_mesh(volume - 0.5), 90)}
    monkeypatch.setattr("gppcs.evaluation.mesh_comparison.PIPELINES", elsewhere)
    (entry,) = gppcs.compare_meshes(volume, n_points=100, pipelines=["mesh"])
    assert entry.report is None
    assert "does not lie on the original" in entry.failure


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"pipelines": ["poison-kept"], "ratio": 0.1}, "did you mean 'poisson-kept'"),
        ({"pipelines": "mesh", "ratio": 0.1}, "list of pipelines"),
        ({"pipelines": [], "ratio": 0.1}, "at least one pipeline"),
        ({}, "and `max_gap`, found none"),
        ({"n_points": 3}, "from 4 on, found 3"),
    ],
)
def test_wrong_parameters_are_refused_before_the_cloud_is_read(parameters, message):
    with pytest.raises(gppcs.ParameterError, match=message):
        gppcs.compare_meshes("no cloud, which nobody has looked at", **parameters)


def test_membranes_far_from_all_points_are_cut_off(sphere):
    """The hull of a sphere without its cap closes the gap by large triangles, to which a corner above it belongs."""
    points = sphere[:2000][sphere[:2000, 2] < 0.5]
    mesh = hull_mesh(np.vstack([points, [0.0, 0.0, 1.0]]))
    left = without_membranes(mesh, points)
    at_the_corner = (mesh.faces == len(points)).any(axis=1)
    np.testing.assert_array_equal(left.faces, mesh.faces[~at_the_corner])
    with pytest.raises(gppcs.errors.NoSurfaceError, match="far from all"):
        without_membranes(moved(mesh, 9), points)


def test_decimation_leaves_the_number_of_triangles_and_no_vertex_without_one(sphere):
    hull = hull_mesh(sphere[:500])
    mesh = decimated(gppcs.Mesh(np.vstack([[[5.0, 5.0, 5.0]], hull.vertices]), hull.faces + 1), 200)
    assert len(mesh.faces) == 200
    np.testing.assert_array_equal(np.unique(mesh.faces), np.arange(102))


def test_triangles_are_turned_alike(sphere):
    hull = hull_mesh(sphere[:300])
    turned = hull.faces.copy()
    turned[::3] = turned[::3, ::-1]
    mixed = gppcs.Mesh(hull.vertices, turned)
    assert gppcs.evaluate_mesh(sphere[:300], mixed).non_manifold_edges > 0
    assert gppcs.evaluate_mesh(sphere[:300], oriented_alike(mixed)).non_manifold_edges == 0
