"""The numbers that people write for `--points` and `--ratio`."""

from contextlib import suppress
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.clouds.quantities import count_of, share_of
from gppcs.errors import ParameterError

COUNTS = st.integers(0, 10**18)
UNITS = {"": 1, "k": 10**3, "K": 10**3, "m": 10**6, "M": 10**6, "g": 10**9, "G": 10**9}


@given(COUNTS, st.sampled_from(["{}", "{:,}", "{:_}", "+{}", " {} ", "{}.0", "{}e0", "-{}"]))
def test_each_spelling_of_a_number_means_it(count, spelling):
    """The library refuses a number below 1, with its own message."""
    expected = -count if spelling.startswith("-") else count
    assert count_of("n_points", spelling.format(count), least=-(10**18)) == expected


@given(st.integers(0, 10**9), st.integers(0, 9), st.sampled_from(sorted(UNITS)), st.sampled_from(["", " "]))
def test_units_multiply_the_number_exactly(whole, places, unit, space):
    text = f"{whole:0{places + 1}}"
    text = f"{text[:-places]}.{text[-places:]}" if places else text
    expected = Fraction(whole, 10**places) * UNITS[unit]
    if expected.denominator == 1:
        assert count_of("n_points", text + space + unit, least=-(10**18)) == expected
    else:
        with pytest.raises(ParameterError, match="a whole number of at most 1e18, found"):
            count_of("n_points", text + space + unit, least=-(10**18))


HELP = {"5k": 5000, "1e3": 1000, "1.5M": 1_500_000, "5,000": 5000, "5_000": 5000, ".5k": 500, "1,234.5k": 1_234_500}


@pytest.mark.parametrize(("text", "count"), HELP.items())
def test_the_spellings_of_the_help(text, count):
    assert count_of("n_points", text, least=-(10**18)) == count


OF_ANOTHER_SCRIPT = "\u0665"  # a digit five
MISWRITTEN = ("k", ".", "e3", "5,00", "5,0000", "50,00,000", "5__0", "_5", "5_", "5kk", "5 000", "0x10", "five", "nan")


@pytest.mark.parametrize("text", ["", " ", *MISWRITTEN, "1e1000", OF_ANOTHER_SCRIPT])
def test_what_is_no_count_is_refused(text):
    with pytest.raises(ParameterError, match=r"such as 5000, 5,000, 5k or 1.5M, found"):
        count_of("n_points", text, least=-(10**18))


@pytest.mark.parametrize("text", ["2.5", "1.2345k", "1e-1", "1e19", "1e999", "9" * 40])
def test_numbers_that_are_not_whole_or_too_large_are_refused(text):
    with pytest.raises(ParameterError, match="whole number of at most 1e18, found"):
        count_of("n_points", text, least=-(10**18))


@given(st.text(max_size=12))
def test_any_text_is_a_count_or_refused(text):
    with suppress(ParameterError):
        assert isinstance(count_of("n_points", text, least=-(10**18)), int)


def test_a_percentage_of_points_names_the_option_for_it():
    with pytest.raises(ParameterError, match="found '3%'; a share of the points is the ratio"):
        count_of("n_points", "3%", least=-(10**18))


@given(st.decimals("0.000001", 100, allow_nan=False, places=6), st.sampled_from(["", " "]))
def test_a_percentage_is_the_nearest_float(percent, space):
    assert share_of("ratio", f"{percent}{space}%") == float(Fraction(percent) / 100)


@given(st.floats(0, 1, exclude_min=True))
def test_a_plain_share_is_the_number_itself(share):
    assert share_of("ratio", repr(share)) == share_of("ratio", share) == share


@pytest.mark.parametrize("text", ["", "%", "3%%", "5k", "0,03", "few", "nan%", "1/3", "1e9999%"])
def test_what_is_no_share_is_refused(text):
    with pytest.raises(ParameterError, match=r"a share, such as 0.03 or 3%, found"):
        share_of("ratio", text)
