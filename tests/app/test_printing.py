"""Numbers and times in words."""

import pytest

from gppcs.app.printing import number_in_words, time_in_words


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (35947.0, "35,947"), (0.0123456, "0.01235"), (1e300, "1e+300"), (-2.0, "-2"), (float("nan"), "nan")],
)
def test_whole_numbers_are_written_in_full(value, text):
    assert number_in_words(value) == text


def test_the_time_names_the_stages_that_take_long():
    assert time_in_words({"reading": 0.5, "tree": 0.1, "choice": 5.0}) == "5.60 s; choice 5.00 s"


def test_the_compilation_is_told_apart(monkeypatch):
    seconds = {"reading": 0.5, "compilation": 30.0, "choice": 1.0}
    expected = "31.50 s, of which 30.00 s compiling kernels, this time only; reading 0.50 s; choice 1.00 s"
    assert time_in_words(seconds) == expected
    monkeypatch.setattr("gppcs.engine.kernel_cache.folder_to_write", lambda: None)
    assert time_in_words(seconds) == expected.replace(", this time only", "")
