"""Attributes that count beside the shape: colours, numbers and classes."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.colours import full_scale, oklab
from gppcs.clouds.ranges import AttributeRange
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from scans import sample

RNG = np.random.default_rng(0)
PLACES = np.c_[RNG.random((20_000, 2)), np.zeros(20_000)]
DISC = np.hypot(*(PLACES[:, :2] - 0.5).T) < 0.3


def wall(places=PLACES, disc=DISC):
    return gppcs.PointCloud(places, {"intensity": np.where(disc, 180, 60).astype(np.uint16)})


WALL = wall()


def kept(cloud=WALL, **arguments):
    return gppcs.simplify(cloud, n_points=300, **arguments)


def test_points_go_where_an_attribute_jumps():
    """On three walls, as it is chance which points lie beside the border: one alone has 0.42 to 0.5."""
    errors = np.zeros((2, 2))
    for turn in (0.0, 0.4, 0.8):
        rotation = [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        cloud = wall(PLACES @ np.transpose(rotation))
        for row, detail in enumerate((None, "intensity")):
            result = gppcs.evaluate(cloud, kept(cloud, detail=detail).cloud, detail="intensity").detail["intensity"]
            errors[row] += result.error_mean, result.nearest_error_mean
    assert (errors[1] < [0.48, 0.5] * errors[0]).all()


@pytest.mark.parametrize("count", [800, pytest.param(2400, marks=pytest.mark.slow)])
def test_narrow_stripes_are_kept_at_hardly_any_cost_of_the_shape(count):
    statue = sample("statue", 40_000)
    spacing = np.sqrt(surface_area(KdTree.build(statue.points)) / count)
    stripe = (statue.points @ [0.36, 0.48, 0.8] // (3.0 * spacing)) % 2.0
    striped = gppcs.PointCloud(statue.points, {"stripe": stripe})
    plain, drawn = (
        gppcs.evaluate(striped, gppcs.simplify(striped, n_points=count, detail=detail).cloud, detail="stripe")
        for detail in (None, "stripe")
    )
    assert drawn.detail["stripe"].nearest_error_mean < 0.6 * plain.detail["stripe"].nearest_error_mean
    assert drawn.surface_mean < 1.08 * plain.surface_mean


def test_a_weight_of_zero_changes_nothing():
    assert (kept(detail={"intensity": 0}).indices == kept().indices).all()


@pytest.mark.parametrize("scale", [1e-140, 1.0, 1e140])
def test_the_largest_weight_keeps_different_points_everywhere(scale):
    largest = kept(gppcs.PointCloud(PLACES * scale, WALL.attributes), detail={"intensity": 1000})
    assert len(np.unique(largest.indices)) == 300
    assert gppcs.evaluate(WALL, WALL.take(largest.indices)).covering_radius < 0.3


def test_noise_counts_for_nothing():
    noisy = gppcs.PointCloud(PLACES, {"noise": RNG.normal(size=len(PLACES))})
    with pytest.warns(UserWarning, match="the detail is only noise at this number of points"):
        assert (kept(noisy, detail="noise").indices == kept().indices).all()


@pytest.mark.parametrize(("factor", "kind"), [(257, np.uint16), (1 / 255, np.float64)])
def test_colours_of_any_scale_are_the_same(factor, kind):
    colours = np.where(DISC[:, None], [250, 30, 30], [30, 30, 255])
    first = gppcs.PointCloud(PLACES, dict(zip(("red", "green", "blue"), colours.T.astype(np.uint8), strict=True)))
    other = gppcs.PointCloud(
        PLACES, dict(zip(("red", "green", "blue"), (colours * factor).T.astype(kind), strict=True))
    )
    assert (kept(first, detail="rgb").indices == kept(other, detail="rgb").indices).all()


@pytest.mark.filterwarnings("error")
def test_an_unknown_colour_does_not_change_the_scale_of_the_others():
    assert full_scale(np.array([[0.2, 0.7, 1.0], [np.nan, 0.5, 0.5]])) == 1.0
    assert full_scale(np.full((2, 3), np.nan)) == 1.0


def test_borders_of_classes_do_not_depend_on_their_names():
    numbers = gppcs.PointCloud(PLACES, {"classification": np.where(DISC, 2, 6)})
    names = gppcs.PointCloud(PLACES, {"kind": np.where(DISC, "ground", "roof")})
    some = kept(numbers, detail="classification")
    assert (some.indices == kept(names, detail="kind").indices).all()
    assert not (some.indices == kept().indices).all()


def test_detail_works_with_points_to_keep_weights_and_a_spacing():
    drawn = kept(detail="intensity", keep=[5, 7], weight=np.where(PLACES[:, 0] < 0.5, 1.0, 2.0))
    assert drawn.indices[:2].tolist() == [5, 7]
    assert len(np.unique(drawn.indices)) == 300
    assert len(gppcs.simplify(WALL, spacing=0.06, detail="intensity").indices) == pytest.approx(280, rel=0.1)


@pytest.mark.parametrize(
    ("attributes", "detail", "error", "text"),
    [
        ({}, "rgb", gppcs.InputError, "no attribute 'rgb' to count as detail; it has none at all"),
        ({"red": PLACES[:, 0]}, "rad", gppcs.InputError, "did you mean 'red'"),
        ({"a": np.full(len(PLACES), np.nan)}, "a", gppcs.InputError, "20,000 of 20,000 that are NaN"),
        ({"a": np.arange(len(PLACES)).astype(str)}, "a", gppcs.InputError, "at most 16 different texts"),
        ({"a": PLACES}, "a", gppcs.InputError, "one number or class for each point"),
        ({}, {"a": -1}, gppcs.ParameterError, "weights from 0 to 1000, found 'a' with -1"),
        ({}, {"a": 1e37}, gppcs.ParameterError, r"weights from 0 to 1000, found 'a' with 1e\+37"),
        ({}, ["a"], gppcs.ParameterError, "a mapping of names to weights"),
    ],
)
def test_what_is_no_detail_is_told(attributes, detail, error, text):
    with pytest.raises(error, match=text):
        kept(gppcs.PointCloud(PLACES, attributes), detail=detail)


def test_oklab_has_its_published_values():
    """Of white, red and blue (Ottosson 2020)."""
    found = oklab(np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], dtype=np.float32))
    expected = [[1.0, 0.0, 0.0], [0.62796, 0.22486, 0.12585], [0.45201, -0.03246, -0.31153]]
    assert found == pytest.approx(np.array(expected), abs=2e-4)


def test_a_range_leaves_out_outliers_and_fills_gaps():
    values = np.r_[np.linspace(0.0, 1.0, 1000), 1e9, np.nan]
    cloud = gppcs.PointCloud(np.zeros((1002, 3)), {"a": values})
    shares = AttributeRange.from_cloud(cloud, "a").values(cloud)[:, 0]
    assert shares[500] == pytest.approx(0.5, abs=0.01)
    assert shares[1000:].tolist() == [1.5, 0.5]


@pytest.mark.filterwarnings("error")
def test_a_range_that_a_float_cannot_hold_is_one():
    cloud = gppcs.PointCloud(PLACES, {"a": np.where(DISC, -1.7e308, 1.7e308)})
    assert (kept(cloud, detail="a").indices == kept(detail="intensity").indices).all()
    assert gppcs.evaluate(cloud, cloud, detail="a").detail["a"].error_mean == 0.0
