"""Each test draws from a generator of its own, so that its numbers do not depend on the tests that ran before it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

TESTS = Path(__file__).parent
MODULES = sorted(path.relative_to(TESTS).as_posix() for path in TESTS.rglob("test_*.py"))


@pytest.mark.parametrize("path", [path for path in MODULES if "default_rng" in (TESTS / path).read_text("utf-8")])
def test_no_module_holds_a_generator(path):
    spec = importlib.util.spec_from_file_location(f"generators_of_{Path(path).stem}", TESTS / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert not [name for name, value in vars(module).items() if isinstance(value, np.random.Generator)]
