"""The error of an optional package that cannot be imported says why, and what installs it."""

import sys

import pytest

from gppcs.engine.extras import require_all, require_matplotlib, require_pye57
from gppcs.errors import MissingExtraError


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
    with pytest.raises(MissingExtraError, match=rf"E57 files need pye57, which {fault} \(the extra e57\): pip install"):
        require_pye57()


def test_several_missing_packages_are_told_apart(monkeypatch):
    for name in ("pye57", "matplotlib"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match="pip install pye57; a picture needs matplotlib"):
        require_all(require_pye57, require_matplotlib)
