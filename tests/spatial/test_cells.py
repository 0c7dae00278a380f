import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.cells import POINTS_PER_PART, distinct_in_single, first_occurrences, greatest_in_cells


@given(st.integers(0, 400), st.integers(1, 6), st.integers(0, 99))
def test_first_occurrences(n, values, seed):
    points = np.random.default_rng(seed).integers(-values, values, (n, 3)) * 0.5
    points[points == 0] *= -1.0  # minus zero is zero
    _, expected = np.unique(points, axis=0, return_index=True)
    np.testing.assert_array_equal(np.flatnonzero(first_occurrences(points)), np.sort(expected))


@pytest.mark.parametrize("distance", [0.0, 1e-15, 1e-12, 2e-9])
def test_points_that_float32_does_not_tell_apart_are_one(distance):
    rng = np.random.default_rng(0)
    points = rng.random((5_000, 3))
    near = points + distance * rng.uniform(-1, 1, points.shape)
    distinct = distinct_in_single(np.concatenate([points, near, points + 1e-4]))
    assert np.array_equal(distinct[:5_000], np.arange(5_000))
    assert np.array_equal(distinct[-5_000:], np.arange(10_000, 15_000))
    assert len(distinct) <= 10_000 + 5_000 * (distance * 2**25) ** 2
    strays = np.concatenate([np.zeros((1, 3)), 1e7 + points])
    assert len(distinct_in_single(strays)) == 5_001


def cells(points, edge, values):
    greatest = {}
    for i, cell in enumerate(map(tuple, np.floor(points * (1.0 / edge)))):
        rank = values[i], *-points[i]  # ties go to the smallest coordinates
        if cell not in greatest or rank > greatest[cell][0]:
            greatest[cell] = rank, i
    return np.sort([i for _, i in greatest.values()])


def valued(n, kinds, seed):
    """Values with many ties, or all alike."""
    return np.random.default_rng(seed).integers(0, kinds, n).astype(np.uint32)


@given(
    st.integers(0, 3_000),
    st.sampled_from([1e-120, 0.02, 0.1, 0.5, 3.0]),
    st.sampled_from([0.0, -0.5, 1e6]),
    st.sampled_from([1.0, 1e9]),
    st.integers(1, 5),
    st.integers(0, 10**6),
)
def test_the_greatest_in_cells_are_those_of_a_dictionary(n, edge, moved, far, kinds, seed):
    """Cells have numbers where these are few, else a hash of their own."""
    points = np.random.default_rng(seed).random((n, 3)) + moved
    points[: n // 100] *= far
    values = valued(n, kinds, seed)
    np.testing.assert_array_equal(greatest_in_cells(points, edge, values), cells(points, edge, values))


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("far", [1.0, 1e12])
def test_those_of_many_are_the_same_whatever_the_number_of_threads(far):
    """Several parts, of which one holds half the points; a table that has to grow."""
    points = np.random.default_rng(0).integers(0, 60, (6 * POINTS_PER_PART, 3)) / 64.0
    points[::2] = points[0]
    points[-1] = far
    values = valued(len(points), 5, 0)
    expected = cells(points, 0.07, values)
    _, first = np.unique(points, axis=0, return_index=True)
    np.testing.assert_array_equal(greatest_in_cells(points, 0.07, values), expected)
    np.testing.assert_array_equal(np.flatnonzero(first_occurrences(points)), np.sort(first))
