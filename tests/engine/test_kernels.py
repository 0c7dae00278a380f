"""What holds for all Numba kernels."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import gppcs

SOURCE = Path(gppcs.__file__).parent


def kernels():
    """Each kernel's name with the options of its decorator and the names of what it calls."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        for function in ast.parse(path.read_text()).body:
            for decorator in getattr(function, "decorator_list", []):
                if ast.unparse(decorator).partition("(")[0] == "kernel":
                    keywords = getattr(decorator, "keywords", [])
                    options = {keyword.arg: ast.unparse(keyword.value) for keyword in keywords}
                    calls = [node.func for node in ast.walk(function) if isinstance(node, ast.Call)]
                    found[function.name, path.stem] = options, {call.id for call in calls if hasattr(call, "id")}
    return found


def test_rounding_does_not_depend_on_which_kernel_is_compiled_first():
    """Numba lets a kernel without `fastmath` take over that of the first kernel to call it, and keeps it on disk."""
    found = kernels()
    assert len(found) > 50
    unclear = []
    for (name, module), (own, _) in found.items():
        callers = {options.get("fastmath", "False") for options, calls in found.values() if name in calls}
        if len(callers) > 1 and "fastmath" not in own and "inline" not in own:
            unclear.append(f"{module}.{name}: add fastmath=False")
    assert not unclear


def test_warmup_refuses_to_compile_what_cannot_be_kept(tmp_path):
    shutil.copytree(SOURCE, tmp_path / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [tmp_path / "gppcs", *(path for path in (tmp_path / "gppcs").rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()  # not even root can write into it
    folders = {"XDG_CACHE_HOME": str(tmp_path / "gppcs" / "errors.py"), "PYTHONPATH": str(tmp_path)}
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    command = [sys.executable, "-m", "gppcs", "warmup"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=inherited | folders)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "set NUMBA_CACHE_DIR" in done.stderr
