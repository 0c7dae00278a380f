"""One call stays short: a reader can follow it."""

import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import gppcs

PACKAGE = Path(gppcs.__file__).parent


@pytest.mark.usefixtures("default_threads")
def test_a_call_enters_few_functions_in_few_files():
    """Functions, kernels, properties and comprehensions of the package, in all threads of a second call."""
    u, v = np.random.default_rng(0).random((2, 20_000))
    points = np.column_stack([u, v, 0.1 * np.sin(6 * u) * np.cos(5 * v)])
    gppcs.set_threads(2)
    gppcs.simplify(points, ratio=0.05)
    entered = set()

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(PACKAGE):
            entered.add((path, frame.f_code.co_qualname))

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        gppcs.simplify(points, ratio=0.05)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    assert len(entered) <= 100, sorted(entered)
    assert len({path for path, _ in entered}) <= 22
