"""Points and tables on disk."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gppcs.engine.stages import Stages
from gppcs.spatial import stored
from gppcs.spatial.boxes import Boxes
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.row_sample import row_hashes
from gppcs.spatial.stored import joined, store, store_part

POINTS = np.random.default_rng(0).random((3_000, 3))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(stored, "BOX", 100)
    monkeypatch.setattr(stored, "SAMPLED", 1_000)


@given(st.lists(st.integers(0, 3_000), max_size=5).map(sorted), st.sampled_from([0.0, 0.03, 2.0]))
@settings(max_examples=10)
def test_a_tile_and_its_halo_do_not_depend_on_the_chunks(tmp_path_factory, cuts, width):
    chunked = ChunkedPoints(3_000, lambda: (part for part in np.split(POINTS, cuts) if len(part)))
    points, sample = store(chunked, tmp_path_factory.mktemp("points"), Stages())
    np.testing.assert_array_equal(sample, POINTS[np.argsort(row_hashes(np.arange(3_000)))[:1_000]])
    assert len(points.boxes) == 32
    own = points.boxes.box_of(POINTS)
    tiles = points.boxes.tiles(points.counts, 500)
    assert len(tiles) == 8
    for tile in tiles:
        near = points.near(tile, width)
        inside = (own >= tile.first) & (own < tile.last)
        within = (np.abs(POINTS - (tile.low + tile.high) / 2) <= (tile.high - tile.low) / 2 + width).all(axis=1)
        np.testing.assert_array_equal(near.rows, np.flatnonzero(inside | within))
        np.testing.assert_array_equal(near.points, POINTS[near.rows])
        np.testing.assert_array_equal(near.inside, inside[near.rows])
        np.testing.assert_array_equal(np.unique(points.inside(tile), axis=0), np.unique(POINTS[inside], axis=0))
        assert len(points.inside(tile)) == np.count_nonzero(inside)


def test_few_points_are_one_box(tmp_path):
    points, sample = store(ChunkedPoints.of(POINTS[:9]), tmp_path, Stages())
    assert (len(points.boxes), points.counts.tolist(), len(sample)) == (1, [9], 9)


def test_points_are_removed(tmp_path):
    points, _ = store(ChunkedPoints.of(POINTS), tmp_path, Stages())
    assert list(tmp_path.glob("*.points*"))
    points.remove()
    assert not list(tmp_path.glob("*.points*"))


def table_of(tmp_path):
    boxes = Boxes.of(POINTS, 16)
    own = boxes.box_of(POINTS)
    tiles, parts = boxes.tiles(np.bincount(own, minlength=16), 400), []
    for tile in tiles:
        rows = np.flatnonzero((own >= tile.first) & (own < tile.last))
        parts.append((tile, store_part(tmp_path, tile, boxes, {"row": rows, "place": POINTS[rows]})))
    order = np.argsort(own, kind="stable")
    return joined(tmp_path, boxes, parts, ["row", "place"]), tiles, order


def test_a_table_is_sorted_by_boxes(tmp_path):
    table, tiles, order = table_of(tmp_path)
    assert len(table) == 3_000
    np.testing.assert_array_equal(table.take("row", slice(None)), order)
    np.testing.assert_array_equal(np.concatenate(list(table.chunks_of("place", 700))), POINTS[order])
    np.testing.assert_array_equal(table.counts, np.bincount(table.boxes.box_of(POINTS), minlength=16))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["place.npy", "row.npy"]
    for width in (0.0, 0.05, 9.0):
        for tile in tiles:
            rows, own = table.rows_near(tile, width), table.rows_of(tile)
            places = POINTS[order]
            near = ((places >= tile.low - width) & (places <= tile.high + width)).all(axis=1)
            near[own] = True
            np.testing.assert_array_equal(rows, np.flatnonzero(near))


def test_columns_are_written(tmp_path):
    table, tiles, _ = table_of(tmp_path)
    table.create("normal", np.empty((0, 3), dtype=np.float32))
    for number, tile in enumerate(tiles):
        table.put("normal", table.rows_of(tile), np.float32([number, 1, 2]))
    table.put("normal", np.array([5, 7]), 9)
    found = table.take("normal", np.array([0, 5, 2_999]))
    assert found.dtype == np.float32
    assert found.tolist() == [[0, 1, 2], [9, 9, 9], [len(tiles) - 1, 1, 2]]
    table.remove()
    assert not tmp_path.exists()
