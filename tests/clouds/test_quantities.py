"""Lengths with units; counts and shares of points."""

from contextlib import suppress
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.clouds.quantities import Length, count_of, ratio_of, units_of
from gppcs.errors import ParameterError

COUNTS = st.integers(0, 10**18)
count = partial(count_of, "n_points", minimum=-(10**18))  # the library refuses a number below 1, with its own message
UNITS = {"k": 10**3, "K": 10**3, "m": 10**6, "M": 10**6, "g": 10**9, "G": 10**9}


@pytest.mark.parametrize(
    ("given", "unit", "expected"),
    [
        (0.5, None, 0.5),
        ("0.5", None, 0.5),
        ("2e-3", None, 0.002),
        ("0.5mm", "m", 0.0005),
        ("5 cm", "mm", 50.0),
        ("1ft", "m", 0.3048),
        ("0.02%", None, 0.002),
        (np.float32(0.5), "m", 0.5),
    ],
)
def test_a_length_in_the_unit_of_the_cloud(given, unit, expected):
    length = Length.from_value("tolerance", given)
    assert length.in_cloud(10.0, units_of(unit, None)) == pytest.approx(expected, rel=1e-12)


def test_the_coordinate_system_of_a_file_tells_the_unit(two_systems):
    cloud = gppcs.read(two_systems[0])
    with pytest.raises(gppcs.InputError, match="does not say in which unit"):
        gppcs.simplify(cloud, spacing="50cm", method="fps")
    in_metres = gppcs.simplify(cloud, spacing="50cm", unit="m", method="fps")
    assert np.array_equal(in_metres.indices, gppcs.simplify(cloud, spacing=0.5, method="fps").indices)


@given(COUNTS, st.sampled_from(["{}", "{:,}", "{:_}", "+{}", " {} ", "{}.0", "{}e0", "-{}"]))
def test_each_spelling_of_a_number_means_it(number, spelling):
    assert count(spelling.format(number)) == (-number if spelling.startswith("-") else number)


@given(st.integers(0, 10**9), st.integers(0, 9), st.sampled_from(list(UNITS)), st.sampled_from(["", " "]))
def test_units_multiply_the_number_exactly(whole, places, unit, space):
    text = f"{whole:0{places + 1}}"
    text = f"{text[:-places]}.{text[-places:]}" if places else text
    expected = Fraction(whole, 10**places) * UNITS[unit]
    if expected.denominator == 1:
        assert count(text + space + unit) == expected
    else:
        with pytest.raises(ParameterError, match="a whole number of at most 1e18, found"):
            count(text + space + unit)


OF_ANOTHER_SCRIPT = "\u0665"  # a digit five
MISWRITTEN = ["3%", "k", ".", "e3", "5,00", "5,0000", "50,00,000", "5__0", "_5", "5_", "5kk", "0x10", "five", "nan"]


REFUSED = {
    r"such as 5000, 5,000, 5k or 1.5M, found": ["", " ", *MISWRITTEN, "5 000", "1e1000", "20.000", OF_ANOTHER_SCRIPT],
    "whole number of at most 1e18, found": ["2.5", "1.2345k", "1e-1", "1e19", "1e999", "9" * 40],
}


@pytest.mark.parametrize(("message", "text"), [(message, text) for message in REFUSED for text in REFUSED[message]])
def test_what_is_no_count_is_refused(message, text):
    with pytest.raises(ParameterError, match=message):
        count(text)


@given(st.text(max_size=12))
def test_any_text_is_a_count_or_refused(text):
    with suppress(ParameterError):
        assert isinstance(count(text), int)


@given(st.decimals("0.000001", 100, allow_nan=False, places=6), st.sampled_from(["", " "]))
def test_a_percentage_is_the_nearest_float(percent, space):
    assert ratio_of("ratio", f"{percent}{space}%") == float(Fraction(percent) / 100)


@given(st.floats(0, 1, exclude_min=True))
def test_a_plain_share_is_the_number_itself(share):
    assert ratio_of("ratio", repr(share)) == ratio_of("ratio", share) == share


@pytest.mark.parametrize("text", ["", "%", "3%%", "5k", "0,03", "few", "nan%", "1/3", "1e9999%"])
def test_what_is_no_share_is_refused(text):
    with pytest.raises(ParameterError, match=r"a fraction, such as 0.03 or 3%, found"):
        ratio_of("ratio", text)
