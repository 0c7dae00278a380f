"""What holds for all Numba kernels."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gppcs
from gppcs.engine import compiling
from gppcs.engine.kernels import kernel

SOURCE = Path(gppcs.__file__).parent


def kernels():
    """Each kernel's name with the options of its decorator and the names of what it calls."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        for function in ast.walk(ast.parse(path.read_text())):
            for decorator in getattr(function, "decorator_list", []):
                if ast.unparse(decorator).partition("(")[0] == "kernel":
                    keywords = getattr(decorator, "keywords", [])
                    options = {keyword.arg: ast.unparse(keyword.value) for keyword in keywords}
                    calls = [node.func for node in ast.walk(function) if isinstance(node, ast.Call)]
                    found[function.name, path.stem] = options, {ast.unparse(call) for call in calls}
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


@pytest.fixture
def unkept(monkeypatch):
    """Nothing compiled is kept or found."""
    monkeypatch.setattr("gppcs.engine.kernel_cache.folders", list)
    monkeypatch.setattr("gppcs.engine.kernel_cache.folder_to_write", lambda: None)


def test_a_constant_needs_no_code_of_its_own(unkept):
    @kernel
    def added(x, y, negative):
        return x - y if negative else x + y

    @kernel
    def sums(x):
        return added(x, 1, False), added(x, 1, True), added(2, x, x > 1)

    assert sums(5) == (6, 4, -3)
    assert len(added.signatures) == 1


def run_python(code, *arguments, **environment):
    """Run code in a new process; return its exit code, stdout and stderr."""
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    # As for pytest itself, but old packages may use what newer ones deprecate.
    warnings = ["-W", "error", "-W", "ignore:The TBB threading layer", "-W", "ignore::DeprecationWarning"]
    command = [sys.executable, *warnings, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=inherited | environment)
    return done.returncode, done.stdout, done.stderr


COMMAND = "from gppcs.app.cli import main; main()"


@pytest.fixture
def unwritable(tmp_path):
    """A copy of the package beside whose files nothing can be kept, not even by root, and a cloud."""
    package = tmp_path / "unwritable" / "gppcs"
    shutil.copytree(SOURCE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [package, *(path for path in package.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()
    gppcs.write(tmp_path / "scan.ply", gppcs.sample("bracket", 400))
    return package.parent


def simplified(unwritable, output, code=COMMAND, **environment):
    """Simplify the cloud by a method of few kernels, with the copy of the package."""
    source, target = unwritable.parent / "scan.ply", unwritable.parent / output
    arguments = "simplify", source, "-o", target, "--points", 5, "--method", "random"
    exit_code, out, err = run_python(code, *arguments, PYTHONPATH=str(unwritable), **environment)
    assert (exit_code, len(gppcs.read(target))) == (0, 5), err
    return out, err


@pytest.mark.slow
def test_kernels_go_to_the_users_folder_where_that_of_the_package_cannot_be_written(unwritable, tmp_path):
    cache = tmp_path / "cache"
    out, err = simplified(unwritable, "first.ply", XDG_CACHE_HOME=str(cache))
    assert err == f"gppcs: {compiling.NOTICE}\n"
    assert "compiling kernels, this time only" in out
    assert list(cache.glob("gppcs/*/gppcs.spatial.*.nbc"))
    out, err = simplified(unwritable, "second.ply", XDG_CACHE_HOME=str(cache))
    assert err == ""
    assert "compiling" not in out


def test_warmup_refuses_to_compile_what_cannot_be_kept(unwritable, tmp_path):
    folders = {"XDG_CACHE_HOME": str(tmp_path / "scan.ply"), "PYTHONPATH": str(unwritable)}
    code, out, err = run_python(COMMAND, "warmup", **folders)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "expected a folder to keep compiled kernels in" in err
    assert "set NUMBA_CACHE_DIR" in err


@pytest.mark.slow
def test_nothing_is_left_to_compile_after_a_warm_up(tmp_path):
    """Shown of two methods; all take a minute or more."""
    methods, cache = ("gp", "fps"), tmp_path / "cache"
    # Of a copy, as compiled code beside the package would be found.
    shutil.copytree(Path(gppcs.__file__).parent, tmp_path / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    alone = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tmp_path)}
    warm_up = (
        "import sys; from gppcs.app.compilation import compile_method; [compile_method(name) for name in sys.argv[1:]]"
    )
    assert run_python(warm_up, *methods, **alone) == (0, "", "")
    kept = sorted(cache.rglob("*.nbc"))
    assert len(kept) > 40
    cloud = gppcs.sample("bracket", 30_000)  # neither noise nor size of the scan that is compiled on
    gppcs.write(tmp_path / "scan.ply", gppcs.PointCloud(cloud.points.astype("float32"), cloud.attributes))
    for method in methods:
        arguments = "simplify", tmp_path / "scan.ply", "-o", tmp_path / f"{method}.ply", "--ratio", 0.03
        code, _, err = run_python(COMMAND, *arguments, "--method", method, **alone)
        assert (code, err) == (0, "")
    assert sorted(cache.rglob("*.nbc")) == kept
