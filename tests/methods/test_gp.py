import numpy as np
import pytest
from scipy.spatial import cKDTree

import gppcs
from gppcs.methods import LocalGP
from shapes import rotation, square

SAMPLES = ("bracket", "medallion")


@pytest.fixture(scope="module", params=SAMPLES)
def scan(request):
    """10,000 points."""
    return gppcs.sample(request.param, n_points=10_000).points


def chosen(points, n_points, method="gp"):
    return gppcs.simplify(points, n_points=n_points, method=method).indices


def covering_radius(points, indices):
    return cKDTree(points[indices]).query(points)[0].max()


def test_each_prefix_is_as_good_as_a_choice_of_its_size(scan, monkeypatch):
    """As good as one that is not placed: a prefix gains by the placement of the whole, but less than by its own."""
    whole = chosen(scan, 1_000)
    monkeypatch.setattr("gppcs.gp.local.algorithm.place", lambda points, chosen, *_: chosen)
    for size in (750, 500, 250):
        prefix, direct = (gppcs.evaluate(scan, scan[kept]) for kept in (whole[:size], chosen(scan, size)))
        assert prefix.mean_distance == pytest.approx(direct.mean_distance, rel=0.03)
        assert prefix.surface_mean < 1.15 * direct.surface_mean


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
def test_the_feature_weight_goes_from_an_even_cover_to_features(name):
    scan = gppcs.sample(name, n_points=20_000).points
    kept = [chosen(scan, 2_000, LocalGP(feature_weight=weight)) for weight in (0, 0.25, 0.5, 0.75, 1)]
    variation = [gppcs.evaluate(scan, scan[indices]).mean_surface_variation for indices in kept]
    assert (np.diff(variation) > 0.01 * variation[0]).all()
    least = covering_radius(scan, chosen(scan, 2_000, "fps"))
    assert covering_radius(scan, kept[0]) < 1.35 * least
    assert covering_radius(scan, kept[2]) < 2 * least


def off_the_sphere(points):
    return np.sqrt(np.mean((np.linalg.norm(points, axis=1) - 1) ** 2))


@pytest.mark.parametrize(("sigma", "at_most"), [(0.01, 0.85), (0.02, 0.74)])
def test_noise_is_left_out(sphere, sigma, at_most):
    noisy = sphere[::2] * (1 + sigma * np.random.default_rng(0).standard_normal((20_000, 1)))
    result = gppcs.simplify(noisy, n_points=600)
    assert off_the_sphere(noisy[result.indices]) < at_most * off_the_sphere(noisy)
    assert off_the_sphere(noisy[chosen(noisy, 600, "fps")]) > off_the_sphere(noisy)
    assert result.diagnostics["noise_in_spacings"] == pytest.approx(sigma / 0.145, rel=0.3)


def test_half_of_the_points_in_a_dot_get_no_more_than_their_share():
    dot = [0.3, 0.3, 0.0] + 1e-7 * np.random.default_rng(1).random((5_000, 3))
    points = np.concatenate([dot, square(5_000)])
    kept = chosen(points, 500)
    assert len(np.unique(kept)) == 500
    assert (kept < 5_000).sum() <= 5
    assert covering_radius(points, kept) < 1.6 * covering_radius(points, chosen(points, 500, "fps"))


@pytest.mark.parametrize("turned", [False, True])
def test_features_above_all_still_cover_a_plane(turned):
    """The surface variation is nothing but rounding there, and no reason to choose."""
    points = square(5_000) @ (rotation(0) if turned else np.eye(3))
    kept = chosen(points, 400, LocalGP(feature_weight=1.0))
    assert covering_radius(points, kept) < 1.3 * covering_radius(points, chosen(points, 400, "fps"))


def test_scores_are_carried_by_the_points():
    scan = gppcs.sample("bracket", 3_000).points
    result = gppcs.simplify(scan, n_points=400, scores=True)
    score, deviation = (result.cloud.attributes[name] for name in ("score", "deviation"))
    assert score.dtype == deviation.dtype == np.float32
    assert (deviation > 0).all()
    assert (deviation <= 1).all()
    assert deviation[0] == 1
    assert (score > 0).all()
    selection = gppcs.simplify(scan, n_points=400)
    np.testing.assert_array_equal(selection.indices, result.indices)
    assert "score" not in selection.cloud.attributes


@pytest.mark.slow
def test_the_bunny_is_rebuilt_closer_than_from_other_methods(shared_data):
    pytest.importorskip("pymeshlab", reason="needs PyMeshLab: the extra 'evaluate'")
    cloud, mesh = gppcs.read(shared_data / "bunny.ply"), gppcs.read_mesh(shared_data / "bunny.ply")
    distance = {}
    for method in ("gp", "hc", "fps"):
        kept = gppcs.simplify(cloud, ratio=0.05, method=method).cloud
        distance[method] = gppcs.evaluate(cloud, kept, mesh=mesh).rebuilt.hausdorff_mean
    assert distance["gp"] <= 0.97 * min(distance["hc"], distance["fps"])
