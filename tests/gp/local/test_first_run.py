"""What other processes compile at a first run is what `gp` calls."""

import subprocess
import sys

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
