import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.scaling import bounds, normalised
from gppcs.spatial.units import Units
from shapes import metres_of_degrees


def plainly(points):
    corner = points.min(axis=0)
    local = points - corner
    _, exponent = np.frexp(local.max())
    local = np.ldexp(local, -exponent)
    return np.where(local < 1e-100, 0.0, local), corner, exponent, np.ones(3)


@given(
    st.integers(1, 3_000),
    st.sampled_from([1e-320, 1e-300, 1e-90, 1.0, 1e200, 8e307]),
    st.sampled_from([0.0, 5e6]),
    st.integers(0, 99),
)
def test_points_are_those_of_plain_numpy(n, size, moved, seed):
    rng = np.random.default_rng(seed)
    points = (rng.random((n, 3)) - 0.5) * size * rng.choice([1.0, 1e-110, 0.0], (n, 3)) + moved
    local, frame = normalised(points)
    for found, expected in zip((local, *frame), plainly(points), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert not np.signbit(normalised(points)[0]).any()


@pytest.mark.usefixtures("threads")
def test_neither_bounds_nor_points_depend_on_the_number_of_threads():
    points = np.random.default_rng(0).standard_normal((100_003, 3)) * [1, 20, 300]
    np.testing.assert_array_equal(bounds(points), [points.min(axis=0), points.max(axis=0)])
    np.testing.assert_array_equal(normalised(points)[0], plainly(points)[0])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 1_500, 4_999])
def test_one_bad_coordinate_shows_in_the_bounds(bad, place):
    points = np.random.default_rng(0).random((5_000, 3))
    points[place, 1] = bad
    assert (np.isfinite(bounds(points)).all(axis=0) == [True, False, True]).all()


@pytest.mark.parametrize("degrees", [[7.0, 47.0], [-179.5, -89.0], [12.0, 0.0]])
def test_an_angle_is_as_long_as_on_the_ellipsoid(degrees):
    box = np.add([*degrees, 0.0], [[-0.01, -0.01, 0], [0.01, 0.01, 0]])
    factors = Units(np.pi / 180, 0.3048, is_geographic=True).factors(*box)
    np.testing.assert_allclose(factors, [*metres_of_degrees(*degrees), 0.3048], rtol=1e-7)


@pytest.mark.parametrize("units", [Units(1.0, 0.3048), Units(np.pi / 200, 1.0, is_geographic=True)])
def test_coordinates_come_back_from_lengths(units):
    points = np.random.default_rng(0).random((100, 3)) * [0.01, 0.02, 300] + [7, 50, 1000]
    local, frame = normalised(points, units)
    np.testing.assert_allclose(frame.world(local), points, rtol=1e-14)
    np.testing.assert_allclose(frame.near(points), local, rtol=1e-12)
    lengths = (points - points.min(axis=0)) * units.factors(*bounds(points))
    np.testing.assert_allclose(frame.lengths(local), lengths, rtol=1e-12)
