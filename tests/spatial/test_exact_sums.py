"""Sums without rounding."""

import math
from fractions import Fraction
from unittest.mock import patch

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.exact_sums import exact_sum, mean_of

NUMBERS = st.lists(st.floats(0.0, 1e300), min_size=1, max_size=40)


@given(NUMBERS, NUMBERS)
def test_the_mean_is_rounded_once_however_the_numbers_are_divided(some, others):
    together = [*some, *others]
    mean = mean_of(exact_sum(np.array(some)) + exact_sum(np.array(others)), len(together))
    assert mean == float(sum(map(Fraction, together)) / len(together))
    with patch("gppcs.spatial.exact_sums.AT_ONCE", 7):
        assert mean == mean_of(exact_sum(np.array(together[::-1])), len(together))


def test_smallest_numbers_count():
    least = math.ulp(0.0)
    assert mean_of(exact_sum(np.array([least, 3.0 * least])), 2) == 2.0 * least
