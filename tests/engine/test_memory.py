import subprocess
import sys

import numpy as np
import pytest

import gppcs
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


def test_memory_that_the_system_does_not_tell_is_unknown(tmp_path, monkeypatch):
    """As without /proc, in a plain chroot."""
    import psutil

    def missing(*_):
        raise FileNotFoundError("/proc/meminfo")

    def unknown(*_):
        raise psutil.NoSuchProcess(1)

    monkeypatch.setattr(psutil, "virtual_memory", missing)
    monkeypatch.setattr(psutil, "Process", unknown)
    monkeypatch.setattr(memory, "STATUS", tmp_path / "none")
    monkeypatch.setattr(memory, "control_groups", lambda controller, root: iter(()))
    assert memory.available_memory() is None
    assert memory.peak_memory() is None
    gppcs.write(tmp_path / "a.ply", np.random.default_rng(0).random((50, 3)))
    gppcs.write(tmp_path / "a.copc.laz", gppcs.read(tmp_path / "a.ply"), lossy=True)
    assert len(gppcs.simplify(tmp_path / "a.ply", n_points=5, method="fps")) == 5


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("", {}, None),
        ("0::/a/b\n", {"a/b/memory.max": "100000", "a/b/memory.current": "30000", "a/b/memory.stat": "anon 1\n"}, None),
        ("0::/a\n", {"a/memory.max": "9000", "a/memory.current": "3000", "a/memory.stat": "inactive_file 50\n"}, 6_050),
        ("0::/a/b\n", {"a/memory.max": "90", "a/memory.current": "3000", "a/memory.stat": "inactive_file 50\n"}, 0),
        (
            "5:memory:/x\n0::/\n",
            {
                "memory/x/memory.limit_in_bytes": "7000",
                "memory/x/memory.usage_in_bytes": "6000",
                "memory/x/memory.stat": "inactive_file 9\ntotal_inactive_file 70\n",
            },
            1_070,
        ),
    ],
)
def test_the_limit_of_a_container_counts(container, groups, files, expected):
    free = memory.available_memory(container(groups, files))
    assert free == expected if expected is not None else free > 10_000
