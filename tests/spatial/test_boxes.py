"""Boxes divide space, and parts divide the boxes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.boxes import Boxes, classes

SEEDS = st.integers(0, 999)


def cloud(seed, n=2_000):
    rng = np.random.default_rng(seed)
    return rng.random((n, 3)) * 10.0 ** rng.integers(-3, 3, 3)


@given(SEEDS, st.sampled_from([1, 2, 8, 64]))
def test_points_lie_in_their_boxes(seed, count):
    points = cloud(seed)
    boxes = Boxes.from_sample(points[:500], count)
    own = boxes.box_of(points)
    assert len(boxes) == count
    low, high = boxes.lower[count:][own], boxes.upper[count:][own]
    inside = ((points >= boxes.lower[1]) & (points <= boxes.upper[1])).all(axis=1)
    assert ((points >= low) & (points <= high))[inside].all()
    held = np.bincount(boxes.box_of(points[:500]), minlength=count)
    assert held.sum() == 500
    assert held.max() - held.min() <= 1 + np.log2(count)


@given(SEEDS, st.integers(1, 3_000))
def test_parts_divide_the_boxes(seed, most):
    points = cloud(seed)
    boxes = Boxes.from_sample(points, 64)
    counts = np.bincount(boxes.box_of(points), minlength=64)
    counts[20:30] = 0
    parts = boxes.parts(counts, most)
    held = [counts[part.first : part.last].sum() for part in parts]
    assert all(0 < number <= most or part.last - part.first == 1 for number, part in zip(held, parts, strict=True))
    assert sum(held) == counts.sum()
    assert [part.first for part in parts] == sorted(part.first for part in parts)
    low, high = boxes.lower[64:], boxes.upper[64:]
    for part in parts:
        assert (low[part.first : part.last].min(axis=0) == part.lower).all()
        assert (high[part.first : part.last].max(axis=0) == part.upper).all()


@pytest.mark.parametrize("width", [0.0, 0.05, 3.0])
def test_parts_of_a_class_are_far_apart(width):
    points = np.random.default_rng(0).random((2_000, 3))
    boxes = Boxes.from_sample(points, 64)
    parts = boxes.parts(np.bincount(boxes.box_of(points), minlength=64), 300)
    found = classes(parts, width)
    assert sorted(part.first for some in found for part in some) == [part.first for part in parts]
    for some in found:
        for i, one in enumerate(some):
            for other in some[:i]:
                gap = np.maximum(one.lower - other.upper, other.lower - one.upper).max()
                assert gap > width
