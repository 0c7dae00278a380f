"""The line that an error prints installs what the extra of the package installs."""

import tomllib
from pathlib import Path

import pytest

from gppcs.engine.extras import EXTRAS

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_packages_are_those_of_the_extra(extra):
    required = PROJECT["optional-dependencies"]
    own = [each for each in required[extra] if not each.startswith("gppcs[")]
    inherited = [each[len("gppcs[") : -1] for each in required[extra] if each.startswith("gppcs[")]
    assert sorted(EXTRAS[extra]) == sorted([*own, *(each for other in inherited for each in required[other])])
