"""Points on disk are read by parts with halos, whatever the runs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gppcs.spatial import stored
from gppcs.spatial.samples import is_drawn
from gppcs.spatial.stored import RECORD, StoredPoints, boxes_for, without, write_run

POINTS = np.random.default_rng(0).random((3_000, 3))
POINTS[-100:] = POINTS[:100]


def stored_in(folder, cuts=()):
    """Store the points in runs that end at some rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stored, "BOX", 100)
        boxes = boxes_for(POINTS[:1_000], len(POINTS))
    records = np.empty(len(POINTS), dtype=RECORD)
    records["row"], records["place"] = np.arange(len(POINTS)), POINTS
    split = [part for part in np.split(records, cuts) if len(part)]
    written = [write_run(folder, f"{number}.run", boxes, part) for number, part in enumerate(split)]
    return StoredPoints(
        folder,
        boxes,
        sum(counts for _, counts in written),
        tuple(run for run, _ in written),
        RECORD,
        POINTS[:1_000],
        len(POINTS),
    )


@given(st.lists(st.integers(0, 3_000), max_size=5).map(sorted), st.sampled_from([0.0, 0.03, 2.0]), st.booleans())
@settings(max_examples=10)
def test_a_part_and_its_halo_do_not_depend_on_the_runs(tmp_path_factory, cuts, width, repeats):
    points = stored_in(tmp_path_factory.mktemp("points"), cuts)
    own, parts = points.boxes.box_of(POINTS), points.parts(500)
    assert len(points) == 3_000
    assert len(parts) == 8
    for part in parts:
        near = points.near(part, width, repeats=repeats)
        inside = (own >= part.first) & (own < part.last)
        around = (np.abs(POINTS - (part.lower + part.upper) / 2) <= (part.upper - part.lower) / 2 + width).all(axis=1)
        expected = inside | around if width else inside
        drawn = points.near(part, width, repeats=True, fraction=0.3).indices
        np.testing.assert_array_equal(drawn, np.flatnonzero(expected & is_drawn(np.arange(3_000), 0.3)))
        if not repeats:
            expected[-100:] = False
        np.testing.assert_array_equal(near.indices, np.flatnonzero(expected))
        np.testing.assert_array_equal(near.points, POINTS[near.indices])
        np.testing.assert_array_equal(near.inside, inside[near.indices])


def test_rows_are_left_out(tmp_path):
    left = np.arange(0, 3_000, 7)
    points = without(stored_in(tmp_path, [1_000]), left, map)
    rows = np.concatenate([points.near(part, repeats=True).indices for part in points.parts(500)])
    np.testing.assert_array_equal(np.sort(rows), np.setdiff1d(np.arange(3_000), left))


def test_the_first_of_other_rows_are_told(tmp_path):
    assert stored_in(tmp_path, [10, 2_000]).besides(np.array([0, 2, 2_999]), 4).tolist() == [1, 3, 4, 5]
