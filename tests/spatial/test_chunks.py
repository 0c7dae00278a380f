"""What is found in chunks is what is found in one array."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial import chunks
from gppcs.spatial.cells import first_occurrences, greatest_in_cells
from gppcs.spatial.chunks import ChunkedPoints, SparseValues

CUTS = st.lists(st.integers(1, 499), max_size=12, unique=True).map(sorted)


def parts(points, cuts):
    return ChunkedPoints(len(points), lambda: np.split(points, cuts))


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Let the finds of chunks be looked through again and again."""
    monkeypatch.setattr(chunks, "FINDS_AT_ONCE", 20)


@given(CUTS, st.integers(0, 99), st.sampled_from([0.01, 0.2, 0.7, 5.0]))
def test_the_greatest_of_cells_do_not_depend_on_the_chunks(cuts, seed, edge):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 40, (500, 3)) / 40
    values = rng.integers(0, 4, 500).astype(np.float32)  # of equal ones the first counts
    rows = np.flatnonzero(values)
    found = parts(points, cuts).greatest_in_cells(edge, SparseValues(rows, values[rows]))
    np.testing.assert_array_equal(found.rows, greatest_in_cells(points, edge, values))
    np.testing.assert_array_equal(found.points, points[found.rows])
    np.testing.assert_array_equal(found.values, values[found.rows])


@given(CUTS, st.integers(0, 99), st.sampled_from([2, 5, 1000]))
def test_points_without_repeats_do_not_depend_on_the_chunks(cuts, seed, sides):
    points = np.random.default_rng(seed).integers(0, sides, (500, 3)).astype(float)
    found = parts(points, cuts).distinct()
    np.testing.assert_array_equal(found.rows, np.flatnonzero(first_occurrences(points)))
    np.testing.assert_array_equal(found.points, points[found.rows])


@given(CUTS, st.integers(1, 600), st.lists(st.integers(0, 499), unique=True).map(sorted))
def test_some_points_do_not_depend_on_the_chunks(cuts, step, rows):
    points = np.random.default_rng(0).random((500, 3))
    steps = []
    np.testing.assert_array_equal(parts(points, cuts).take(np.array(rows, dtype=np.int64), steps.append), points[rows])
    assert steps == [len(part) for part in np.split(points, cuts)]
    np.testing.assert_array_equal(parts(points, cuts).every(step), points[::step])
    values = np.where(points[:, 0] > 0.7, points[:, 0], 0).astype(np.float32)
    sparse = SparseValues(np.flatnonzero(values), values[values > 0])
    every = sparse.every(step)
    np.testing.assert_array_equal(every.dense(0, len(values[::step])), values[::step])
    np.testing.assert_array_equal(sparse.dense(120, 333), values[120:333])


def test_an_array_is_not_copied():
    points = np.random.default_rng(0).random((50, 3))
    assert np.shares_memory(ChunkedPoints.of(points).every(1), points)
    assert np.shares_memory(ChunkedPoints.of(points).distinct().points, points)
    assert len(ChunkedPoints.of(points)) == 50


def test_what_waits_stays_little(monkeypatch):
    """Of a hundred chunks with the same ten cells, no more than a few chunks are looked through at once."""
    looked, plain = [], chunks.greatest_in_cells
    monkeypatch.setattr(
        chunks, "greatest_in_cells", lambda points, *grid: looked.append(len(points)) or plain(points, *grid)
    )
    points = np.tile(np.random.default_rng(0).random((10, 3)), (100, 1))
    found = ChunkedPoints(1000, lambda: np.split(points, 100)).greatest_in_cells(1e-3, chunks.ALIKE)
    assert len(found.rows) == 10
    assert max(looked) <= 40
    assert sum(looked) < 3 * len(points)
