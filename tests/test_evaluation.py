"""The figures of a simplification."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.distance import cdist

import gppcs

LENGTHS = ("diagonal", "covering_radius", "mean_distance")


@pytest.fixture(scope="module")
def pair():
    original = gppcs.sample("bracket", 2000).points
    return original, original[gppcs.simplify(original, n_points=150, method="fps").indices]


def test_a_cloud_against_itself_is_zero(pair):
    report = gppcs.evaluate(pair[0], pair[0])
    assert (report.covering_radius, report.mean_distance, report.chamfer) == (0, 0, 0)
    assert (report.points_in, report.points_out) == (2000, 2000)


def test_figures_equal_their_definitions(pair):
    original, simplified = pair
    simplified = simplified + 0.5  # so that neither direction is zero
    distance = cdist(original, simplified)
    report = gppcs.evaluate(original, simplified)
    assert report.covering_radius == pytest.approx(distance.min(axis=1).max())
    assert report.mean_distance == pytest.approx(distance.min(axis=1).mean())
    assert report.chamfer == pytest.approx((distance.min(axis=1) ** 2).mean() + (distance.min(axis=0) ** 2).mean())
    assert report.diagonal == pytest.approx(np.linalg.norm(np.ptp(original, axis=0)))


def test_shift_and_axis_swap_change_nothing(pair):
    def moved(points):
        return points[:, [2, 0, 1]] * [1, -1, 1] + [500, -700, 20]

    before, after = gppcs.evaluate(*pair), gppcs.evaluate(*map(moved, pair))
    assert dataclasses.astuple(after) == pytest.approx(dataclasses.astuple(before), rel=1e-6)


def test_rotation_changes_no_distance(pair):
    rotation, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    before, after = (gppcs.evaluate(*clouds) for clouds in (pair, [points @ rotation for points in pair]))
    for name in ("covering_radius", "mean_distance", "chamfer"):  # the box, and so its diagonal, does change
        assert getattr(after, name) == pytest.approx(getattr(before, name))


def test_figures_scale_as_their_units_say(pair):
    before, after = gppcs.evaluate(*pair), gppcs.evaluate(*(1000 * points for points in pair))
    for name in LENGTHS:
        assert getattr(after, name) == pytest.approx(1000 * getattr(before, name))
    assert after.chamfer == pytest.approx(1e6 * before.chamfer)
    assert after.mean_surface_variation == pytest.approx(before.mean_surface_variation)


def test_surface_variation_is_that_of_the_simplified_cloud(pair):
    original, simplified = pair
    radius = np.sqrt(25 * np.cbrt(np.ptp(simplified, axis=0).prod()) ** 2 / len(simplified))
    variation = []
    for near in cdist(simplified, simplified) <= radius:
        eigenvalues = np.linalg.eigvalsh(np.cov(simplified[near].T, bias=True))
        variation.append(eigenvalues[0] / eigenvalues.sum())
    assert gppcs.evaluate(original, simplified).mean_surface_variation == pytest.approx(np.mean(variation))


@pytest.mark.parametrize("cloud", [np.zeros((1, 3)), np.ones((5, 3)), np.outer(np.arange(8.0), [1, 2, 3])])
def test_degenerate_clouds_have_figures(cloud):
    report = gppcs.evaluate(cloud, cloud[:1])
    assert report.covering_radius == pytest.approx(np.linalg.norm(cloud[-1] - cloud[0]))
    assert report.mean_surface_variation == 0


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (np.empty((0, 3)), "cloud is empty"),
        (np.full((2, 3), np.nan), "NaN or infinite"),
        (np.zeros((2, 2)), r"shape \(N, 3\)"),
    ],
)
@pytest.mark.parametrize("place", ["original", "simplified"])
def test_what_cannot_be_compared_is_refused(cloud, message, place):
    clouds = {"original": np.zeros((1, 3)), "simplified": np.zeros((1, 3)), place: cloud}
    with pytest.raises(gppcs.InputError, match=message):
        gppcs.evaluate(**clouds)
