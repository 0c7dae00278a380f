"""Conditions on attributes and coordinates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.clouds.expressions import Expression

CLOUD = gppcs.PointCloud(
    np.arange(15.0).reshape(5, 3),
    {
        "classification": np.array([1, 2, 6, 6, 2], np.uint8),
        "intensity": np.array([1.0, 2.0, np.nan, 4.0, 5.0], np.float32),
        "flag": np.array([1, 0, 1, 0, 1], bool),
        "scan angle": np.arange(5),
        "label": np.array(list("abcde")),
        "pair": np.zeros((5, 2)),
        "large": np.full(5, 2**63 + 1, np.uint64),
        "raw": np.array([b"a", b"\xff", b"a", b"b", b"b"]),
        "two  spaces": np.array(["a  b", "a b", "a  b", "", ""]),
        "µ": np.arange(5),
    },
)


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("classification == 6", [2, 3]),
        ("Classification == 6", [2, 3]),
        ("z > 2.5 and not intensity < 3", [2, 3, 4]),
        ("z < 3 or x >= 12", [0, 4]),
        ("classification in [2, 6]", [1, 2, 3, 4]),
        ("classification in [ground, building]", [1, 2, 3, 4]),
        ("class == ground", [1, 4]),
        ("sqrt(abs(-x)) >= 3", [3, 4]),
        ("classification not in (2, 6)", [0]),
        ("classification in []", []),
        ("2 < z <= 8", [1, 2]),
        ("flag", [0, 2, 4]),
        ("not flag", [1, 3]),
        ('attributes["scan angle"] % 2 == 1', [1, 3]),
        ("label == 'c'", [2]),
        ("classification - 3 < 0", [0, 1, 4]),  # and not 254
        ("-(x + 2 * y) / 2 <= -13", [3, 4]),
        ("flag - flag == 0", [0, 1, 2, 3, 4]),
        ("large - large == 0", [0, 1, 2, 3, 4]),
        ("intensity != intensity", [2]),
        ("x / 0 > 1", [1, 2, 3, 4]),
        ("  z > 3\n", [1, 2, 3, 4]),
        ("1 == 1", [0, 1, 2, 3, 4]),
        ("-True < flag - True", [0, 2, 4]),
        ("raw == 'a'", [0, 2]),
        ("attributes['two  spaces']\n == 'a  b'", [0, 2]),
        ("µ > 2", [3, 4]),  # which the syntax reads as another letter
        ("label == '#'", []),
        ("z > 3and x < 12", [1, 2, 3]),  # of which Python itself warns, as of the next
        (r"label != '\d'", [0, 1, 2, 3, 4]),
    ],
)
def test_conditions(text, rows):
    assert np.flatnonzero(Expression.from_text(text).mask(CLOUD)).tolist() == rows


def test_numbers_are_computed_as_numpy_does():
    x, y, z = CLOUD.points.T
    for text, expected in (
        ("1/(x*x + y*y + z*z)", 1 / (x * x + y * y + z * z)),
        ("1 / (1 + exp(-intensity))", 1 / (1 + np.exp(-CLOUD.attributes["intensity"].astype(float)))),
        ("log(x) % 2", np.log(np.where(x > 0, x, np.nan)) % 2),
        ("flag * 2", [2, 0, 2, 0, 2]),
        ("3", [3.0] * 5),
    ):
        found = Expression.from_text(text).numbers(CLOUD)
        np.testing.assert_allclose(found[1:], np.asarray(expected)[1:], rtol=1e-15)
    for text in ("eval(x)", "sqrt(x, y)", "x.real(1)", "label * 2"):
        with pytest.raises(gppcs.ParameterError, match="expected"):
            Expression.from_text(text).numbers(CLOUD)


def test_words_of_python_may_be_names():
    cloud = gppcs.PointCloud(
        CLOUD.points, {"class": np.arange(5), "return": np.ones(5), "label": np.array(["class"] * 5)}
    )
    condition = "class > 2 and return == 1 and label == 'class' and attributes['class'] < 9"
    assert np.flatnonzero(Expression.from_text(condition).mask(cloud)).tolist() == [3, 4]
    with pytest.raises(gppcs.ParameterError, match="at character 9 "):
        Expression.from_text("class > > 2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected conditions such as 'classification == 6'"),
        (None, "found None"),
        ("z >", "at its end: expected conditions"),
        ("Classification = 6", "expected conditions such as 'classification == 6'"),
        ("z > 3) or (z < 2", "at character 6"),
        ("classificaton == 6", "character 1 ('classificaton ='): the cloud has no attribute 'classificaton'; did you"),
        ("classification == high_vegetatoin", "did you mean 'high_vegetation'"),
        ("return == 0", "the cloud has no attribute 'return'"),
        ("'é' == label and zz > 2", "at character 18 ('zz > 2')"),
        ("z", "at character 1 ('z'): expected a condition"),
        ("label == 3", "at character 10 ('3'): expected a text in quotes"),
        ("classification == 'a'", "at character 19 (\"'a'\"): expected a number"),
        ("label + 1 == 2", "at character 1 ('label + 1 == 2'): expected a number to compute with"),
        ("classification in 6", "at character 19 ('6'): expected a list"),
        ("pair > 0", "one number or text for each point"),
        ("z is 3", "expected ==, !=, <"),
        ("1 / 0 > z", "a number that can be computed with"),
        ("z > " + "9" * 400, "at character 5 ('99999"),
        ("z > 3 # \n and x < 0", "expected no comment"),
        ("z > 3 and '\udcff' == label", "expected conditions"),
        ("__import__('os')", "expected a function of one number: abs"),
        ("x.__class__ == 1", "expected a number"),
        ("x ** 99 > 1", "expected a number"),
        ("z == 1j", "expected a number"),
        ("(" * 900 + "z > 1" + ")" * 900, "expected"),
        ("-" * 1500 + "z > 1", "nested less deeply"),
        ("z > 1" + " " * 3000, "expected conditions"),
    ],
)
def test_what_is_no_condition_is_refused_with_its_place(text, message):
    with pytest.raises((gppcs.ParameterError, gppcs.InputError)) as error:
        Expression.from_text(text).mask(CLOUD)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


WHOLE = st.integers(-(2**63), 2**63 - 1)


@given(st.lists(WHOLE, min_size=1, max_size=6), WHOLE | st.integers(-3, 3), WHOLE, st.sampled_from("+-*%"))
def test_whole_numbers_are_computed_with_exactly(values, other, bound, sign):
    cloud = gppcs.PointCloud(np.zeros((len(values), 3)), {"k": np.array(values, dtype=np.int64)})
    text = f"k {sign} {other} > {bound}" if other >= 0 else f"k {sign} ({other}) > {bound}"
    if sign == "%" and other == 0:
        with pytest.raises(gppcs.ParameterError, match="a divisor other than 0"):
            Expression.from_text(text).mask(cloud)
        return
    compute = {"+": int.__add__, "-": int.__sub__, "*": int.__mul__, "%": int.__mod__}[sign]
    assert Expression.from_text(text).mask(cloud).tolist() == [compute(value, other) > bound for value in values]


@given(st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=6), st.integers(0, 2**64 - 1), st.floats(0, 2e19))
def test_large_unsigned_numbers_are_compared_exactly(values, bound, fraction):
    cloud = gppcs.PointCloud(np.zeros((len(values), 3)), {"k": np.array(values, dtype=np.uint64)})
    assert Expression.from_text(f"k - 1 < {bound}").mask(cloud).tolist() == [value - 1 < bound for value in values]
    assert Expression.from_text(f"k >= {bound}").mask(cloud).tolist() == [value >= bound for value in values]
    assert Expression.from_text(f"k < {fraction!r}").mask(cloud).tolist() == [value < fraction for value in values]


def test_large_whole_numbers_beside_fractions_are_refused():
    cloud = gppcs.PointCloud(np.zeros((1, 3)), {"time_ns": np.array([1_700_000_000_000_000_001])})
    with pytest.raises(gppcs.ParameterError, match="whole numbers of at most 9,007,199,254,740,992 beside fractions"):
        Expression.from_text("time_ns * 0.5 > 3").mask(cloud)
