"""What other processes compile at a first run is what `gp` calls."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gppcs

FIRST_RUN = """
import gppcs
from gppcs.engine.kernels import number_compiled
gppcs.set_threads(2)
gppcs.simplify(gppcs.sample("medallion", 20_000), n_points=2000)
print(number_compiled())
"""
CODE = """
import sys
import gppcs
from gppcs.gp.local.first_run import compile_choice, compile_placement
from gppcs.gp.local.greedy import PART_POINTS

def types_of_kernels():
    modules = [module for name, module in sys.modules.items() if name.startswith("gppcs.")]
    kernels = [value for module in modules for value in vars(module).values() if hasattr(value, "py_func")]
    return {(kernel.__name__, types) for kernel in kernels for types in kernel.signatures}

scan = gppcs.sample("medallion", 30_000)
gppcs.simplify(scan, n_points=3000)
of_gp = types_of_kernels()
compile_choice(2 * PART_POINTS)
compile_placement()
print(len(of_gp) > 20, types_of_kernels() - of_gp)
"""


def test_helpers_compile_nothing_that_the_method_does_not_call():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert done.stdout == "True set()\n"


@pytest.mark.slow
def test_a_first_run_compiles_in_two_processes(tmp_path):
    shutil.copytree(Path(gppcs.__file__).parent, tmp_path / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    variables = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    variables.pop("PYTEST_XDIST_WORKER", None)
    command = [sys.executable, "-c", FIRST_RUN]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=variables)
    called_by_python = [path for path in tmp_path.rglob("*.nbc") if ".inner." not in path.name]
    assert 10 < int(done.stdout) < len(called_by_python)
