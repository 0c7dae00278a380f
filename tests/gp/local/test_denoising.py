"""Denoising: kept points go to the surface below the noise, edges stay, and what it cannot do is refused."""

import numpy as np
import pytest

import gppcs
from gppcs.engine.timer import Timer
from gppcs.errors import InputError, ParameterError
from gppcs.gp.local.algorithm import Problem, choose_denoised
from gppcs.gp.local.denoising import MANY_POINTS, neighbourhood
from gppcs.spatial.kdtree import KdTree
from gppcs.surface import inducing
from gppcs.surface.local_surface import LocalSurface
from scans import sample
from shapes import cube, noisy, on_sphere, square

NOISE = 0.01
DENOISE = gppcs.LocalGP(denoise=True)


def off_cube(points):
    """Distances from the surface of the unit cube."""
    beyond = np.abs(points - 0.5) - 0.5
    return np.abs(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))


SHAPES = {
    "plane": (square, lambda points: np.abs(points[:, 2]), 5.0),
    "sphere": (on_sphere, lambda points: np.abs(np.linalg.norm(points, axis=1) - 1.0), 2.5),
    "cube": (cube, off_cube, 3.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_kept_points_come_nearer_to_the_surface_by_a_factor(shape):
    make, off, factor = SHAPES[shape]
    scan = noisy(make(20_000), NOISE)
    kept = gppcs.simplify(scan, n_points=800, method=DENOISE).cloud.points
    assert off(kept).mean() < off(scan).mean() / factor


def test_outliers_do_not_widen_the_neighbourhood():
    with_outliers = sample("statue", 100_000, noise=0.002, outliers=0.05)
    assert neighbourhood(KdTree.build(with_outliers.points))[0] <= MANY_POINTS


def test_without_noise_points_stay():
    for points in (square(5_000), on_sphere(5_000)):
        result = gppcs.simplify(points, n_points=300, method=DENOISE)
        assert np.abs(result.cloud.points - points[result.indices]).max() < 1e-9


def test_attributes_go_along_and_normals_are_those_of_the_surface():
    scan, true = noisy(on_sphere(20_000), NOISE), on_sphere(20_000)
    wrong = true + 0.3 * np.random.default_rng(2).standard_normal(true.shape)
    wrong /= np.linalg.norm(wrong, axis=1)[:, None]
    columns = dict(zip(("nx", "ny", "nz"), wrong.T.astype(np.float32), strict=True))
    cloud = gppcs.PointCloud(scan, {"number": np.arange(len(scan)), **columns})
    result = gppcs.simplify(cloud, n_points=500, method=DENOISE)
    assert (result.cloud.attributes["number"] == result.indices).all()
    assert str(result.method) == "gp (denoise=True)"
    cosines = (result.cloud.normals() * true[result.indices]).sum(axis=1)
    assert np.degrees(np.arccos(cosines.clip(-1, 1))).mean() < 4.0  # 20 degrees or so before


@pytest.mark.parametrize(("size", "n_points"), [(20_000, 200), (3_000, 2_900)])
def test_fixed_points_are_chosen_first_and_denoised(monkeypatch, size, n_points):
    """Of a sample in which they are few, and of nearly all points."""
    monkeypatch.setattr("gppcs.gp.local.candidates.SAMPLE_SIZE", 5_000)
    scan = noisy(square(size), NOISE)
    ranking = choose_denoised(Problem(scan, n_points, fixed=60), gppcs.LocalGP().criterion, Timer())
    np.testing.assert_array_equal(ranking.indices[:60], np.arange(60))
    assert len(np.unique(ranking.indices)) == n_points
    heights = np.abs(ranking.surface.points[:, 2])
    assert heights[:60].mean() < NOISE / 3
    assert heights[60:].mean() < NOISE / 3


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"n_points": None, "tolerance": "1%"}, "`denoise` without `tolerance`, found both"),
        ({"max_gap": "1%"}, "`denoise` without `max_gap`, found both"),
        ({"keep": [1]}, "`denoise` without `keep`, found both"),
        ({"quota": {"z > 0": 5}}, "`denoise` without `quota`, found both"),
    ],
)
def test_what_cannot_be_denoised_is_refused(options, told):
    with pytest.raises(ParameterError, match=told):
        gppcs.simplify(square(100), **{"n_points": 10, "method": DENOISE, **options})


def test_all_points_cannot_be_denoised():
    with pytest.raises(InputError, match="expected fewer points to keep"):
        gppcs.simplify(square(100), ratio=1, method=DENOISE)


def test_weights_and_detail_count_among_denoised_points():
    scan = noisy(square(10_000), NOISE)
    weights = np.where(scan[:, 0] < 0.5, 3.0, 1.0)
    result = gppcs.simplify(scan, n_points=400, method=DENOISE, weight=weights)
    assert (scan[result.indices, 0] < 0.5).mean() == pytest.approx(0.75, abs=0.06)
    cloud = gppcs.PointCloud(scan, {"side": (scan[:, 0] > 0.5).astype(np.int32)})
    result = gppcs.simplify(cloud, n_points=400, method=DENOISE, detail="side")
    assert (np.abs(scan[result.indices, 0] - 0.5) < 0.05).mean() > 0.15


def test_the_result_tells_how_far_points_have_moved():
    points = gppcs.sample("sphere", n_points=4000).points
    for noise in (0.0, 1.0):
        noisy = points + noise * np.random.default_rng(0).standard_normal(points.shape)
        result = gppcs.simplify(noisy, n_points=400, method=DENOISE)
        shifts = np.linalg.norm(result.cloud.points - noisy[result.indices], axis=1)
        assert result.diagnostics["moved_mean"] == pytest.approx(shifts.mean(), abs=1e-9)
        assert result.diagnostics["moved_largest"] == pytest.approx(shifts.max(), abs=1e-9)
        assert (result.diagnostics["moved_largest"] > 0) == (noise > 0)


@pytest.mark.parametrize("name", ["bracket", "sphere"])
def test_the_surface_of_the_kept_points_is_nearer_to_the_true_one(name, monkeypatch):
    true = gppcs.sample(name, n_points=20_000).points
    scan = noisy(true, 0.004 * np.linalg.norm(np.ptp(true, axis=0)))
    distances = {}
    for step in (True, False):
        if not step:
            monkeypatch.setattr(inducing, "inducing_points", lambda kept, observed, places: (kept, True))
        kept = gppcs.simplify(scan, n_points=800, method=DENOISE).cloud.points
        distances[step] = LocalSurface.from_points(kept).nearest_to(true)[0].mean()
    assert distances[True] < 0.97 * distances[False]
