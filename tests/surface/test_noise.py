import numpy as np
import pytest

from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from gppcs.surface.noise import CLEAN, FEWEST, NEIGHBOURS, Noise, feet_of, layer_of, two_sheets
from scans import sample
from shapes import plate


def rough_plane(sigma, n=20_000):
    rng = np.random.default_rng(0)
    return np.column_stack([rng.random((n, 2)), sigma * rng.standard_normal(n)])


def test_smooth_surfaces_are_quiet(sphere):
    for points, n_points, spacing, most in (
        (sphere, 500, 0.01, 1e-6), (sphere[::20], 100, 0.05, 5e-4), (rough_plane(0.0), 500, 0.01, 1e-12),
    ):  # fmt: skip
        tree = KdTree.build(points)
        noise = Noise.measure(tree, n_points, spacing)
        assert noise.is_negligible
        assert noise.sigma <= most
        feet, variances = noise.observe(points)
        assert feet is None
        assert (variances == 0).all()


@pytest.mark.parametrize("sigma", [0.001, 0.002, 0.005, 0.01])
def test_the_level_is_about_that_of_the_noise(sigma):
    """It is a little less, as a point pulls its quadric along."""
    found = Noise.measure(KdTree.build(rough_plane(sigma)), 400, 0.02).sigma
    assert 0.85 * sigma < found < 1.1 * sigma


def test_detail_as_small_as_the_target_spacing_is_not_smoothed_away():
    """Unlike noise, it lies off quadrics the farther, the wider these are."""
    rng = np.random.default_rng(0)
    flat = rng.random((20_000, 2))
    waves = np.column_stack([flat, 0.006 * np.sin(200 * flat[:, 0])])
    noise = Noise.measure(KdTree.build(waves), 500, 0.045)
    assert noise.sigma > CLEAN * noise.spacing
    assert noise.is_negligible
    assert not noise.is_below_threshold
    assert not noise.thick
    for sigma, is_thick in ((0.002, False), (0.005, False), (0.01, True), (0.02, True)):
        noise = Noise.measure(KdTree.build(rough_plane(sigma)), 500, 0.045)
        assert noise.thick == is_thick


def test_outliers_do_not_count_as_noise():
    """The root mean square distance of these points from the quadrics is ten times as large."""
    plane = rough_plane(0.001)
    scattered = np.random.default_rng(0).uniform([0, 0, -0.5], [1, 1, 0.5], (400, 3))
    alone, together = (
        layer_of(KdTree.build(points), NEIGHBOURS) for points in (plane, np.concatenate([plane, scattered]))
    )
    assert together.sigma == pytest.approx(alone.sigma, rel=0.08)
    assert together.radius == pytest.approx(alone.radius, rel=0.08)


@pytest.mark.parametrize(
    ("name", "n"),
    [("horn", 20_000), ("handlebar", 20_000), pytest.param("vents", 40_000, marks=pytest.mark.slow), ("fan", 20_000)],
)
def test_sheets_without_noise_have_none(name, n):
    points = sample(name, n_points=n).points
    tree = KdTree.build(points)
    noise = Noise.measure(tree, n // 20, np.sqrt(surface_area(tree) / (n // 20)))
    assert noise.in_spacings < 0.03


@pytest.mark.parametrize(("level", "neighbours"), [(0.1, 60), (0.3, 60), (0.75, 240)])
def test_the_noise_of_two_sheets_is_that_of_each(level, neighbours):
    """In spacings; the wall is three of these thick. Noise thicker than a fourth of the wall hides the two sheets."""
    points, outward, area = plate(20_000, 3.0)
    spacing = np.sqrt(area / len(points))
    points = points + level * spacing * outward * np.random.default_rng(0).standard_normal((len(points), 1))
    sheets = two_sheets(KdTree.build(points), neighbours)
    assert sheets.noise == pytest.approx(level * spacing, rel=0.25)
    assert sheets.apart == pytest.approx(3.0 * spacing, rel=0.1)


@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.02])
def test_noise_and_smooth_surfaces_are_no_sheets(sigma, sphere):
    assert two_sheets(KdTree.build(rough_plane(sigma))) is None
    assert two_sheets(KdTree.build(sphere[::4])) is None


def test_noise_is_not_told_from_detail_where_few_points_lie_within_the_target_spacing():
    points = rough_plane(0.01, 4_000)
    most = int(np.pi * len(points) / FEWEST)
    assert not Noise.measure(KdTree.build(points), most - 5, 0.02).is_negligible
    assert Noise.measure(KdTree.build(points), most + 5, 0.02).sigma == 0


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.01, 0.02, 0.03])
def test_feet_lie_nearer_to_the_surface_where_neighbourhoods_grow(sigma, sphere):
    """Half of the 30 points of a first fit lie on one side of the layer."""
    surface = sphere[::2] / np.sqrt(4 * np.pi)
    rng = np.random.default_rng(1)  # another seed than that of the sphere
    points = surface * (1 + sigma * np.sqrt(4 * np.pi) * rng.standard_normal((len(surface), 1)))
    tree = KdTree.build(points)
    noise = Noise.measure(tree, 500, 0.045)
    assert noise.thick
    assert noise.neighbours > NEIGHBOURS
    across, within = (
        np.sqrt(np.mean(((feet - surface) ** 2).sum(axis=1)))
        for feet in (noise.observe(points)[0], feet_of(tree, points, NEIGHBOURS))
    )
    assert across < 0.8 * within
    assert layer_of(tree, NEIGHBOURS).sigma < noise.sigma < 1.1 * sigma
