import subprocess
import sys
from pathlib import Path

import pytest

from gppcs.engine import memory

LINUX = pytest.mark.skipif(not memory.STATUS.exists(), reason="needs /proc")


@LINUX
def test_the_peak_counts_what_was_held_and_given_back():
    size = 200_000_000
    code = (
        "from gppcs.engine.memory import peak_memory\n"
        "before = peak_memory()\n"
        f"assert b'x' * {size}\n"
        "print(before, peak_memory())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    before, after = map(int, done.stdout.split())
    assert 0 < before < size
    assert 0.9 * size < after - before < 1.1 * size


@LINUX
def test_without_proc_the_system_is_asked(monkeypatch):
    told = memory.peak_memory()
    monkeypatch.setattr(memory, "STATUS", Path("missing"))
    assert 0.9 * told < memory.peak_memory() < 100 * told  # of what this process was before its exec as well


def test_where_nobody_tells_there_is_none(monkeypatch):
    monkeypatch.setattr(memory, "STATUS", Path("missing"))
    monkeypatch.setitem(sys.modules, "resource", None)
    assert memory.peak_memory() is None
