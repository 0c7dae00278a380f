"""Strict JSON, which has no NaN and no infinity."""

import json
import math
from typing import Any


def strict_json(value: Any) -> str:
    """Return a value as one line of strict JSON in ASCII."""
    return json.dumps(_strict(value), allow_nan=False)


def _strict(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
