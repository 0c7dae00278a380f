import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gppcs.drawing.close_ups import MIN_SEPARATION, feature_squares


def total(picture, square):
    return picture[square.row : square.row + square.side, square.column : square.column + square.side].sum()


def test_bumps_are_found_the_rougher_first():
    picture = np.full((120, 160), 0.01)
    picture[30:40, 100:110] = 0.2
    picture[80:90, 20:30] = 0.3
    first, second, third = feature_squares(picture, 20, 3)
    assert total(picture, first) == pytest.approx(100 * 0.3 + 300 * 0.01)
    assert total(picture, second) == pytest.approx(100 * 0.2 + 300 * 0.01)
    assert total(picture, third) == pytest.approx(400 * 0.01)


@given(arrays(np.float64, (15, 20), elements=st.floats(0.0, 1.0, width=16)), st.integers(1, 6))
def test_the_first_square_is_the_best_of_all_and_squares_keep_apart(picture, side):
    squares = feature_squares(picture, side, 3)
    best = max(picture[r : r + side, c : c + side].sum() for r in range(16 - side) for c in range(21 - side))
    assert bool(squares) == (best > 0.0)
    if squares:
        assert total(picture, squares[0]) == pytest.approx(best)
    for rank, one in enumerate(squares):
        assert one.column + side <= 20
        assert one.row + side <= 15
        for other in squares[:rank]:
            assert max(abs(one.column - other.column), abs(one.row - other.row)) >= MIN_SEPARATION * side


def test_where_there_is_nothing_there_is_no_close_up():
    assert feature_squares(np.zeros((50, 60)), 10, 2) == []
    picture = np.zeros((50, 60))
    picture[20:25, 20:25] = 1.0
    assert len(feature_squares(picture, 10, 2)) == 1
