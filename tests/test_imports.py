"""What `import gppcs` offers, and what it leaves unloaded."""

import pickle
import subprocess
import sys

import pytest

import gppcs

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
