"""The line that an error prints installs what the extra of the package installs."""

import sys
import tomllib
from pathlib import Path

import pytest

from gppcs.engine.extras import EXTRAS, require_pye57
from gppcs.errors import MissingExtraError

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_packages_are_those_of_the_extra(extra):
    required = PROJECT["optional-dependencies"]
    own = [each for each in required[extra] if not each.startswith("gppcs[")]
    inherited = [each[len("gppcs[") : -1] for each in required[extra] if each.startswith("gppcs[")]
    assert sorted(EXTRAS[extra]) == sorted([*own, *(each for other in inherited for each in required[other])])


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("raise ImportError('libGL.so.1: no such file')", r"cannot be imported \(libGL\.so\.1: no such file\)"),
        ("import no_such_module_at_all", "is not installed"),
    ],
)
def test_the_error_tells_a_broken_package_from_a_missing_one(tmp_path, monkeypatch, content, fault):
    (tmp_path / "pye57.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pye57", raising=False)
    with pytest.raises(MissingExtraError, match=rf"E57 files need pye57, which {fault} \(the extra e57\): pip"):
        require_pye57()
