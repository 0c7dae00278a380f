"""Arrays survive the packing as the page's own code reads it, up to the quantisation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gppcs.drawing.web.packing import UNKNOWN, Blocks, octahedral, packed_faces, quantised, quantised_values
from web_page import faces_of, unpacked


@given(st.sampled_from([np.uint8, np.uint16, np.uint32]), st.integers(1, 3), st.data())
def test_packed_arrays_come_back(kind, columns, data):
    array = data.draw(arrays(kind, (data.draw(st.integers(1, 20)), columns)))
    blocks = Blocks()
    assert blocks.add(array) == "block0"
    assert (unpacked(blocks.texts[0], len(array), columns, kind) == array).all()


@given(arrays(np.int64, st.tuples(st.integers(1, 20), st.just(3)), elements=st.integers(0, 2**31)))
def test_triangles_come_back_sorted_and_turning_as_they_did(faces):
    def from_the_lowest(triangles):
        return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in triangles.tolist())

    found = faces_of(packed_faces(faces))
    assert from_the_lowest(found) == from_the_lowest(faces)
    assert (found[:, 0] == found.min(axis=1)).all()


@pytest.mark.parametrize(("factor", "shift"), [(1.0, 0.0), (1e-30, 0.0), (1e200, 0.0), (1.0, 5e6), ((1, 2, 0), 7.0)])
def test_coordinates_differ_by_half_a_step_at_most(sphere, factor, shift):
    points = factor * sphere[:1000] + shift
    held = quantised(points)
    assert (np.abs(held.lower + held.step * held.numbers - points) <= 0.5001 * held.step + 1e-9 * np.max(factor)).all()
    assert held.step == pytest.approx(np.ptp(points, axis=0) / 65535, rel=1e-6)


@pytest.mark.parametrize(
    ("values", "step"),
    [
        (np.array([-5, 0, 900], dtype=np.int16), 1),
        (np.array([True, False]), 1),
        (np.array([2**63, 2**63 + 2**40], dtype=np.uint64), 2**40 / 65534),
        (np.array([0.0, np.nan, 0.25, np.inf, 1.0, -np.inf]), 1 / 65534),
        (np.array([3.0, 3.0]), 0),
        (np.array([-8e307, 0.0, 8e307]), 8e307 / 32767),
        (np.array([np.nan, np.inf]), 0),
    ],
)
def test_values_are_held_in_16_bits_of_their_range_and_unknown_ones_marked(values, step):
    held = quantised_values(values)
    assert held.step == pytest.approx(step)
    known = np.isfinite(values)
    back = held.lower + held.step * held.numbers[known].astype(np.float64)
    assert back == pytest.approx(values[known].astype(np.float64), abs=0.5001 * float(held.step))
    assert ((held.numbers == UNKNOWN) == ~known).all()


def test_normals_are_held_within_a_degree_and_unknown_ones_are_no_error(sphere):
    flat = octahedral(3.0 * sphere).astype(np.float64) / 127.5 - 1.0
    z = 1.0 - np.abs(flat).sum(axis=1)
    folded = (1.0 - np.abs(flat[:, ::-1])) * np.where(flat < 0, -1.0, 1.0)
    back = np.column_stack([np.where(z[:, None] < 0, folded, flat), z])
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((back * sphere).sum(axis=1), -1, 1))).max() < 1.0
    assert octahedral(np.array([[0.0, 0.0, 0.0], [np.nan, 1.0, 0.0]])).tolist() == [[128, 128], [128, 128]]
