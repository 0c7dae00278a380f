import importlib.util
import sys
from functools import cache
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="session")
def script():
    """Import a script by its path in the folder of benchmarks."""

    @cache
    def load(path):
        specification = importlib.util.spec_from_file_location(f"benchmarks of {path}", BENCHMARKS / path)
        module = importlib.util.module_from_spec(specification)
        sys.modules[specification.name] = module  # dataclasses look their module up
        specification.loader.exec_module(module)
        return module

    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)  # for what the scripts share
        yield load
