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

SAMPLE = ("sample", "bracket", "-o", "out.ply", "--points", "100")
START = f"""
import os, signal, sys
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that started the tests may have it ignored

def send(number=signal.SIGINT):
    os.kill(os.getpid(), number)

def sends_while_writing(number=signal.SIGINT):
    import gppcs.io.ply as ply
    original = ply.write_records
    def patched(*arguments):
        (part,) = [name for name in os.listdir() if name.endswith(".part")]
        send(number)
        return original(*arguments)
    ply.write_records = patched

sys.argv = {["gppcs", *SAMPLE]!r}
"""
RUN = "from gppcs.app.cli import main; main()"


def run_python(code):
    code = START + textwrap.dedent(code)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("name", "code", "word"),
    [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated"), ("SIGHUP", 129, "stopped")],
)
def test_a_signal_while_writing_leaves_nothing(folder, name, code, word):
    found, err = run_python(f"sends_while_writing(signal.{name})\n{RUN}")
    assert (found, err.count("\n"), files()) == (code, 1, [])
    assert err.startswith(f"gppcs: {word}")


def test_an_existing_file_outlives_a_signal(folder):
    Path("out.ply").write_text("old")
    assert run_python(f"sys.argv += ['--force']\nsends_while_writing()\n{RUN}")[0] == 130
    assert files() == ["out.ply"]
    assert Path("out.ply").read_text() == "old"


def test_an_existing_copc_file_outlives_a_signal(folder):
    Path("out.copc.laz").write_text("old")
    code = f"""
        sys.argv = {["gppcs", "sample", "bracket", "-o", "out.copc.laz", "--points", "100", "--force"]!r}
        import gppcs.io.copc_writing as copc
        original = copc._hierarchy
        def patched(*arguments):
            send(signal.SIGTERM)
            return original(*arguments)
        copc._hierarchy = patched
    """
    assert run_python(textwrap.dedent(code) + RUN) == (143, "gppcs: terminated\n")
    assert files() == ["out.copc.laz"]
    assert Path("out.copc.laz").read_text() == "old"


FINDER = """
    class Finder:
        def find_spec(self, name, path=None, target=None):
            if name == {!r}:
                send()
    sys.meta_path.insert(0, Finder())
"""
WRITER = """
    import ctypes
    import gppcs.io.ply as ply
    original = ply.write_records
    def patched(*arguments):
        {}
        return original(*arguments)
    ply.write_records = patched
"""
MODULES = ("typer", "gppcs.app.program", "numpy", "numpy._core.multiarray", "gppcs.scans.bracket")
CASES = {
    "a second signal while cleaning up": """
    import gppcs.engine.unfinished as unfinished
    original = unfinished._remove
    def patched(path):
        unfinished._remove = original
        send()
        original(path)
    unfinished._remove = patched
    sends_while_writing()
    """,
    **{f"a signal during the import of {module}": FINDER.format(module) for module in MODULES},
    "an exception that C code swallows": WRITER.format("ctypes.CFUNCTYPE(None)(send)()"),
    "an exception that Python swallows": WRITER.format("type('Fragile', (), {'__del__': lambda self: send()})()"),
    "an error that a library makes of the signal": """
    import gppcs.scans as scans
    def broken(*arguments, **options):
        try:
            send()
        except BaseException as error:
            raise ZeroDivisionError from error
    scans.sample = broken
    """,
}


@pytest.mark.parametrize("code", CASES.values(), ids=CASES)
def test_the_program_ends_with_one_line_and_leaves_nothing(folder, code):
    assert run_python(textwrap.dedent(code) + RUN) == (130, "gppcs: interrupted\n")
    assert files() == []


def test_a_signal_at_exit_shows_no_traceback(folder):
    code, err = run_python(f"import atexit; atexit.register(send)\n{RUN}")
    assert (code, err) == (130, "gppcs: interrupted\n")
    assert len(gppcs.read("out.ply")) == 100


@pytest.mark.parametrize("name", ["SIGHUP", "SIGINT"])
def test_signals_that_are_ignored_from_the_start_stay_ignored(folder, name):
    """As under nohup, and in the background of a script."""
    ignore = f"signal.signal(signal.{name}, signal.SIG_IGN)\nsends_while_writing(signal.{name})\n"
    assert run_python(ignore + RUN) == (0, "")
    assert files() == ["out.ply"]


def test_the_library_leaves_signals_and_hooks_alone(folder):
    code = """
        numbers = signal.valid_signals()
        before = [*map(signal.getsignal, numbers), sys.excepthook, sys.unraisablehook]
        import gppcs, gppcs.app.cli, gppcs.app.program
        cloud = gppcs.sample("bracket", 100)
        gppcs.write("cloud.ply", cloud)
        gppcs.simplify(gppcs.read("cloud.ply"), n_points=10, method="random")
        assert before == [*map(signal.getsignal, numbers), sys.excepthook, sys.unraisablehook]
    """
    assert run_python(code) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0, 1, 3])
@pytest.mark.parametrize("times", [1, 3])
def test_ctrl_c_while_kernels_compile(scan, tmp_path, seconds, times):
    package = Path(gppcs.__file__).parent
    shutil.copytree(package, tmp_path / "copy" / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "copy"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "gppcs", "simplify", "scan.ply", "-o", "out.ply", "--points", "40"]
    restored = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, **restored) as run:
        assert run.stderr.readline() == f"gppcs: {timer.NOTICE}\n"
        time.sleep(seconds)
        for _ in range(times):
            run.send_signal(signal.SIGINT)
        assert run.stderr.read() == "gppcs: interrupted\n"
    assert run.returncode in (130, -signal.SIGINT)  # a late one ends Python itself, which shells see as 130, too
    assert set(files()) <= {"scan.ply", "copy", "cache"}
