"""Ctrl-C, SIGTERM and SIGHUP: one line, the exit code that shells expect, no traceback, no unfinished file."""

import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

import gppcs
from command_line import files
from gppcs.engine import timer

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on Unix")

START = """
import os, signal, sys
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that started the tests may have it ignored

def send(number=signal.SIGINT):
    os.kill(os.getpid(), number)

def sends_while_writing(number=signal.SIGINT):
    import gppcs.io.rows as rows
    original = rows.write_records
    def patched(*arguments):
        (part,) = [name for name in os.listdir() if name.endswith(".part")]
        send(number)
        return original(*arguments)
    rows.write_records = patched

sys.argv = ["gppcs", "sample", "bracket", "-o", "out.ply", "--points", "100"]
"""
RUN = "from gppcs.app.cli import main; main()"


def run_python(code):
    code = START + textwrap.dedent(code)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.parametrize(("name", "old"), [("SIGINT", []), ("SIGTERM", ["out.ply"]), ("SIGHUP", [])])
def test_a_signal_while_writing_leaves_what_was_there(folder, name, old):
    for path in old:
        Path(path).write_text("old")
    code = f"sys.argv += ['--force']\nsends_while_writing(signal.{name})\n{RUN}"
    assert run_python(code) == (128 + getattr(signal, name), "gppcs: interrupted\n")
    assert files() == old
    assert all(Path(path).read_text() == "old" for path in old)


def test_the_next_run_removes_what_a_killed_one_left(folder):
    assert run_python(f"sends_while_writing(signal.SIGKILL)\n{RUN}")[0] == -signal.SIGKILL
    [part] = os.listdir()
    gppcs.write("other.ply", [[0, 0, 0]])  # whose own temporary file may be one of another process
    assert part in os.listdir()
    with gppcs.io.whole_output("out.ply", force=True) as file, gppcs.io.whole_output("out.ply", force=True):
        file.write(b"two writers do not disturb each other")
    assert files() == ["other.ply", "out.ply"]


@pytest.mark.parametrize("module", ["typer", "gppcs.scans.bracket"])
def test_a_signal_during_an_import(folder, module):
    finder = f"""
    class Finder:
        def find_spec(self, name, path=None, target=None):
            if name == {module!r}:
                send()
    sys.meta_path.insert(0, Finder())
    """
    assert run_python(textwrap.dedent(finder) + RUN) == (130, "gppcs: interrupted\n")
    assert files() == []


@pytest.mark.parametrize("name", ["SIGHUP", "SIGINT"])
def test_signals_that_are_ignored_from_the_start_stay_ignored(folder, name):
    """As under nohup, and in the background of a script."""
    ignore = f"signal.signal(signal.{name}, signal.SIG_IGN)\nsends_while_writing(signal.{name})\n"
    assert run_python(ignore + RUN) == (0, "")
    assert files() == ["out.ply"]


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0, 1, 3])
def test_ctrl_c_while_kernels_compile(scan, tmp_path, seconds):
    package = Path(gppcs.__file__).parent
    shutil.copytree(package, tmp_path / "copy" / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "copy"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "gppcs", "simplify", "scan.ply", "-o", "out.ply", "--points", "40"]
    restored = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, **restored) as run:
        assert run.stderr.readline() == f"gppcs: {timer.NOTICE}\n"
        time.sleep(seconds)
        run.send_signal(signal.SIGINT)
        assert run.stderr.read() == "gppcs: interrupted\n"
    assert run.returncode == 130
    assert set(files()) <= {"scan.ply", "copy", "cache"}
