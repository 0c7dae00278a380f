"""What `import gppcs` offers, and what it leaves unloaded."""

import pickle
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import gppcs


def test_type_checkers_see_the_public_names_which_need_no_other_file():
    stub = Path(gppcs.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    seen = re.findall(r"^from (\S+) import (\w+) as \2$", stub, re.MULTILINE)
    assert {name for _, name in seen} | {"__version__"} == set(gppcs.__all__)
    for module, name in seen:
        assert getattr(gppcs, name) is getattr(import_module(module), name)
    assert "errors" in gppcs.__all__


HEAVY = {"numba", "scipy", "matplotlib", "pyvista", "laspy", "lazrs", "pandas", "pyarrow", "pye57"}


def test_the_module_can_be_sent_to_other_processes():
    """As functions of a notebook are that use it."""
    cloudpickle = pytest.importorskip("cloudpickle", reason="comes with Dask")
    assert pickle.loads(cloudpickle.dumps(gppcs)) is gppcs
    assert pickle.loads(cloudpickle.dumps(lambda: gppcs.__version__))() == gppcs.__version__


@pytest.mark.parametrize(
    "use", ["import gppcs", "import gppcs.io", "sys.argv = ['', '--help']; import gppcs.app.cli as c; c.main()"]
)
def test_heavy_packages_are_not_loaded_before_they_are_used(use):
    code = f"import atexit, sys\natexit.register(lambda: print('loaded:', *sys.modules))\n{use}"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in run.stdout.rpartition("loaded:")[2].split()}
    assert "gppcs" in loaded
    assert not loaded & HEAVY
