"""Compiled kernels are kept, and never taken for those of other sources."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import gppcs
from gppcs.engine.numba_internals import FEATURES, SHIPPED_FOR

SOURCE = Path(gppcs.__file__).parent
# Kernels of its own, quick to compile, for a copy of the package.
MODULES = {
    "constant": "SHIFT = 10\n",
    "callee": """
from gppcs.constant import SHIFT
from gppcs.engine.kernels import kernel
@kernel
def inner(x):
    return 2 * x + SHIFT
""",
    "caller": """
from gppcs.callee import inner
from gppcs.engine.kernels import kernel
@kernel
def outer(x):
    "Return one more."
    return inner(x) + 1
""",
}
CALL = """
from gppcs.caller import outer
from gppcs.callee import inner
print(outer(3), outer(0.25), sum(sum(kernel.stats.cache_misses.values()) for kernel in (inner, outer)))
"""
COMPILED, LOADED = "17 11.5 2\n", "17 11.5 0\n"


def copy_to(folder):
    """Copy the package without its compiled files."""
    shutil.copytree(SOURCE, folder / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    return folder / "gppcs"


@pytest.fixture
def package(tmp_path):
    """A copy of the package with the kernels of `MODULES`."""
    package = copy_to(tmp_path / "installed")
    for name, source in MODULES.items():
        (package / f"{name}.py").write_text(source)
    return package


def run_python(code, **environment):
    """Run code in a new process; return its exit code, stdout and stderr."""
    # Python itself would not notice a change that leaves time, in seconds, and size of a file the same.
    inherited = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    inherited.pop("NUMBA_CACHE_DIR", None)
    # As for pytest itself, but old packages may use what newer ones deprecate.
    warnings = ["-W", "error", "-W", "ignore:The TBB threading layer", "-W", "ignore::DeprecationWarning"]
    command = [sys.executable, *warnings, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=inherited | environment)
    return done.returncode, done.stdout, done.stderr


def call(package, code=CALL, **environment):
    """Run code with a copy of the package; return its stdout."""
    exit_code, out, err = run_python(code, PYTHONPATH=str(package.parent), **environment)
    assert (exit_code, err) == (0, "")
    return out


def kept(folder):
    """The files below a folder that are there for compiled kernels."""
    return sorted(path for path in folder.rglob("*") if ".nbc" in path.name)


def change(package, module, old, new):
    path = package / f"{module}.py"
    path.write_text(path.read_text().replace(old, new))


@pytest.mark.slow
def test_a_change_that_a_kernel_reaches_is_noticed_and_switching_back_costs_nothing(package):
    assert call(package) == COMPILED
    assert call(package) == LOADED
    change(package, "callee", "2 * x", "3 * x")
    assert call(package) == "20 11.75 2\n"
    change(package, "constant", "10", "20")
    assert call(package) == "30 21.75 2\n"
    assert call(package) == "30 21.75 0\n"
    change(package, "constant", "20", "10")
    change(package, "callee", "3 * x", "2 * x")
    assert call(package) == LOADED
    assert len(kept(package)) == 12


@pytest.mark.slow
def test_code_that_came_with_the_package_is_asked_first(package, tmp_path):
    processor = {"NUMBA_CPU_NAME": SHIPPED_FOR, "NUMBA_CPU_FEATURES": FEATURES}
    assert call(package, NUMBA_CACHE_DIR=str(tmp_path / "built"), **processor) == COMPILED
    (tmp_path / "built" / "gppcs").rename(package / "compiled")
    assert call(package) == LOADED
    assert kept(package / "__pycache__") == []
    change(package, "constant", "10", "20")
    assert call(package) == "27 21.5 2\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("is_blocked", "named", "expected"),
    [(True, {"XDG_CACHE_HOME": "user"}, "user/gppcs"), (False, {"NUMBA_CACHE_DIR": "named"}, "named"),
     (True, {"XDG_CACHE_HOME": "file"}, None)],
)  # fmt: skip
def test_code_goes_to_the_named_folder_or_to_the_users_or_nowhere(package, tmp_path, is_blocked, named, expected):
    (tmp_path / "file").touch()
    if is_blocked:
        (package / "__pycache__").touch()  # not even root can make this a folder
    folders = {variable: str(tmp_path / name) for variable, name in named.items()}
    assert call(package, **folders) == COMPILED
    assert call(package, **folders) == (LOADED if expected else COMPILED)
    assert len(kept(tmp_path)) == (len(kept(tmp_path / expected)) if expected else 0) == (4 if expected else 0)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no owners of files")
def test_code_that_others_can_have_written_is_not_run(package, tmp_path):
    named = tmp_path / "shared"
    assert call(package, NUMBA_CACHE_DIR=str(named)) == COMPILED
    for path in kept(named):
        path.chmod(0o666)
    assert call(package, NUMBA_CACHE_DIR=str(named)) == COMPILED
    assert {path.stat().st_mode & 0o777 for path in kept(named)} == {0o644}
    for path in kept(named):
        path.unlink()
        os.mkfifo(path)  # to read it would wait for ever
    assert call(package, NUMBA_CACHE_DIR=str(named)) == COMPILED
    for path in kept(named):
        path.rename(path.with_suffix(".away"))
        path.symlink_to(path.with_suffix(".away"))
    assert call(package, NUMBA_CACHE_DIR=str(named)) == COMPILED
    assert call(package, NUMBA_CACHE_DIR=str(named)) == LOADED
    if os.geteuid() == 0:
        for path in kept(named):
            os.chown(path, 12345, 12345)
        assert call(package, NUMBA_CACHE_DIR=str(named)) == COMPILED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ("os.replace = lambda *arguments: os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL),
        ("def full(*arguments): raise OSError(28, 'No space left')\nos.replace = full", 0),
    ],
)
def test_a_killed_process_a_full_disk_and_half_a_file_leave_nothing_that_is_taken_for_code(package, fault, code):
    assert run_python(f"import os, signal, pathlib\n{fault}\n{CALL}", PYTHONPATH=str(package.parent))[0] == code
    assert call(package) == COMPILED
    assert call(package) == LOADED
    for number, path in enumerate(kept(package)):
        os.truncate(path, (10, 2000)[number % 2])
    assert call(package) == COMPILED


@pytest.mark.slow
def test_processes_that_need_the_same_kernel_at_once_compile_it_once(package):
    command = [sys.executable, "-c", CALL]
    environment = os.environ | {"PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(3)]
    lines = [run.communicate()[0].split() for run in runs]
    assert {tuple(line[:2]) for line in lines} == {("17", "11.5")}
    assert sum(int(line[2]) for line in lines) == 2


@pytest.mark.slow
def test_code_of_several_processes_works_together(package):
    """Numba numbers its own functions in each process, here `max` and `min` alike."""
    for name in ("max", "min"):
        source = f"from gppcs.engine.kernels import kernel\n@kernel\ndef {name}_of(x, y):\n    return {name}(x, y)\n"
        source += f"@kernel\ndef twice_{name}(x, y):\n    return 2.0 * {name}_of(x, y)\n"
        (package / f"{name}.py").write_text(source)
        call(package, f"from gppcs.{name} import twice_{name}\ntwice_{name}(1.0, 2.0)")
    both = "from gppcs.engine.kernels import kernel\nfrom gppcs.max import max_of\nfrom gppcs.min import min_of\n"
    (package / "both.py").write_text(both + "@kernel\ndef span(x, y):\n    return max_of(x, y) - min_of(x, y)\n")
    assert call(package, "from gppcs.both import span\nprint(span(1.0, 4.0), span(7.0, 5.0))") == "3.0 2.0\n"


@pytest.mark.slow
def test_on_a_numba_that_was_not_tried_all_works_in_its_own_way(package, tmp_path):
    code = """
import logging, sys, numba
numba.__version__ = "99.0.0"
logging.basicConfig(stream=sys.stdout, format="%(message)s")
import gppcs
from gppcs.engine.kernels import number_compiled
scan = gppcs.sample("bracket", 3_000)
for method in ("gp", "fps"):
    print(gppcs.simplify(scan, n_points=200, method=method).indices.sum())
print("gppcs.engine.numba_internals" in sys.modules, number_compiled() > 0)
"""
    named = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    note, *lines = call(package, code, **named).splitlines()
    scan = gppcs.sample("bracket", 3_000)
    sums = [str(gppcs.simplify(scan, n_points=200, method=method).indices.sum()) for method in ("gp", "fps")]
    assert note.startswith("Numba 99.0.0 was not tried")
    assert lines == [*sums, "False True"]
    assert call(package, code, **named).splitlines() == [note, *sums, "False False"]
