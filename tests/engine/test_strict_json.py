"""JSON that other programs read: without NaN and infinity."""

import json
import math

from gppcs.engine.strict_json import strict_json


def test_nan_and_infinity_become_null_anywhere():
    text = strict_json({"a": math.nan, "b": [1.5, math.inf, (2, -math.inf)], "c": {"d": math.nan, "e": "é"}})
    assert "\n" not in text
    assert text.isascii()
    read = json.loads(text, parse_constant=lambda word: f"not strict: {word}")
    assert read == {"a": None, "b": [1.5, None, [2, None]], "c": {"d": None, "e": "é"}}
