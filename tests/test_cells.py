import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gppcs.cells import PART, _mixed, first_in_cells, first_occurrences


@settings(deadline=None)
@given(st.integers(0, 400), st.integers(1, 6), st.integers(0, 99))
def test_first_occurrences(n, values, seed):
    points = np.random.default_rng(seed).integers(-values, values, (n, 3)) * 0.5
    points[points == 0] *= -1.0  # minus zero is zero
    _, expected = np.unique(points, axis=0, return_index=True)
    np.testing.assert_array_equal(np.flatnonzero(first_occurrences(points)), np.sort(expected))


def cells(points, edge):
    first = {}
    for i, cell in enumerate(map(tuple, np.floor(points * (1.0 / edge)))):
        first.setdefault(cell, i)
    return list(first.values())


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 3_000),
    st.sampled_from([1e-120, 0.02, 0.1, 0.5, 3.0]),
    st.sampled_from([0.0, -0.5, 1e6]),
    st.sampled_from([1.0, 1e9]),
    st.integers(0, 10**6),
)
def test_first_in_cells_are_those_of_a_dictionary(n, edge, moved, far, seed):
    """Cells have numbers where these are few, else a hash of their own."""
    points = np.random.default_rng(seed).random((n, 3)) + moved
    points[: n // 100] *= far
    np.testing.assert_array_equal(first_in_cells(points, edge), cells(points, edge))


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("far", [1.0, 1e12])
def test_the_first_of_many_are_the_same_whatever_the_number_of_threads(far):
    """Several parts, of which one holds half the points; a table that has to grow."""
    points = np.random.default_rng(0).integers(0, 60, (6 * PART, 3)) / 64.0
    points[::2] = points[0]
    points[-1] = far
    expected = cells(points, 0.07)
    _, first = np.unique(points, axis=0, return_index=True)
    np.testing.assert_array_equal(first_in_cells(points, 0.07), expected)
    np.testing.assert_array_equal(np.flatnonzero(first_occurrences(points)), np.sort(first))


def test_all_keep_their_first_where_a_table_has_to_grow():
    points = np.random.default_rng(0).random((PART - 1, 3))
    assert first_occurrences(points).all()
    assert len(first_in_cells(points, 1e-9)) == len(points)


def test_memory_does_not_grow_with_the_cells_of_the_box():
    points = np.random.default_rng(0).random((6 * PART, 3))
    for far in (1.0, 1e12):
        points[0] = far
        tracemalloc.start()
        first_in_cells(points, 0.1)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most < 12 * len(points)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_hashes_of_whole_numbers_along_an_axis_spread(axis):
    """Of n numbers thrown at random into n slots, 1 - 1/e find one of their own on average."""
    n = 1 << 12
    with np.errstate(over="ignore"):
        hashes = [_mixed(*(float(i) if a == axis else 0.0 for a in range(3))) for i in range(n)]
    for shift in (0, 20, 64 - 12):
        assert len({h >> shift & (n - 1) for h in map(int, hashes)}) > 0.6 * n
