"""Measure what the engine costs: threads on an idle and on a busy machine, and a first run.

Runs on Linux only.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

import clouds
import gppcs
import report
from gppcs.engine.threads import number_of_threads

DRAGON = report.DATA / "dragon.ply"
REPEATS = 5
METHODS = ("gp", "gp-spectral", "fps", "hc", "wlop")
COMPILES = """
import sys
import gppcs
gppcs.set_threads(int(sys.argv[2]) or None)
timer = gppcs.Timer()
gppcs.simplify(gppcs.sample("medallion", 20_000), ratio=0.1, method=sys.argv[1], timer=timer)
print(timer.seconds.get("compilation", 0.0))
"""
NOTES = (
    "Seconds are wall time with compiled kernels, the least of 5 runs; one thread and all take turns. Busy means that "
    "an endless loop runs beside them on each core.",
    "A first run compiles all kernels of a method, with an empty folder for compiled code. Of gp, other processes "
    "compile the choice and the placement while the one that runs compiles the rest, unless it has one thread only.",
    "What remains is compiled once, as the run calls it. Numba infers types and writes LLVM's code in Python, spread "
    "over thousands of its functions; LLVM takes the rest.",
)


@contextmanager
def endless_loops() -> Iterator[None]:
    """Keep every core busy."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number_of_threads())]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def least_times(points: clouds.Array, n_points: int) -> dict[int, float]:
    """Return the least seconds of gp by number of threads."""
    times: dict[int, list[float]] = {1: [], number_of_threads(): []}
    for _ in range(REPEATS):
        for threads, seconds in times.items():
            gppcs.set_threads(threads)
            start = perf_counter()
            gppcs.simplify(points, n_points=n_points)
            seconds.append(perf_counter() - start)
    gppcs.set_threads(None)
    return {threads: min(seconds) for threads, seconds in times.items()}


def thread_table() -> report.Section:
    """Return the table of one thread and all, on an idle and on a busy machine."""
    inputs = {
        "medallion, 100,000 points to 4,000": (gppcs.sample("medallion", n_points=100_000).points, 4_000),
        "medallion, 5,000,000 points to 28,000": (gppcs.sample("medallion", n_points=5_000_000).points, 28_000),
    }
    if DRAGON.exists():
        points = gppcs.read(DRAGON).points
        inputs["Dragon, 437,645 points to 13,129"] = (points, 13_129)
    rows, threads = [], number_of_threads()
    for name, (points, n_points) in inputs.items():
        print(name, file=sys.stderr)
        idle = least_times(points, n_points)
        with endless_loops():
            busy = least_times(points, n_points)
        cells = (f"{each[1]:.3f}|{each[threads]:.3f}|{each[1] / each[threads]:.2f}" for each in (idle, busy))
        rows.append([name, *"|".join(cells).split("|")])
    several = f"{threads} threads"
    return report.Section(
        "gp with one thread and with all, seconds",
        ["job", "idle, 1 thread", f"idle, {several}", "times as fast", "busy, 1 thread", f"busy, {several}",
         "times as fast"],
        rows,
    )  # fmt: skip


def first_run_table() -> report.Section:
    """Return the table of the compilation of each method."""
    rows = []
    for method in METHODS:
        print(f"first run of {method}", file=sys.stderr)
        (_, alone), (kernels, seconds) = first_run(method, 1), first_run(method, 0)
        rows.append([method, str(kernels), f"{seconds:.1f}", f"{alone:.1f}"])
    columns = ["method", "kernels compiled", "seconds of compilation", "with one thread"]
    return report.Section("First run", columns, rows)


def first_run(method: str, threads: int) -> tuple[int, float]:
    """Return the number of kernels that a method compiles, and the seconds; 0 stands for all threads."""
    with tempfile.TemporaryDirectory() as folder:  # compiled code beside the package would be found, too
        copied = shutil.ignore_patterns("__pycache__")
        shutil.copytree(Path(gppcs.__file__).parent, Path(folder) / "gppcs", ignore=copied)
        alone = {**os.environ, "PYTHONPATH": folder, "NUMBA_CACHE_DIR": f"{folder}/cache"}
        words = [sys.executable, "-c", COMPILES, method, str(threads)]
        seconds = subprocess.run(words, env=alone, capture_output=True, text=True, check=True).stdout
        return len(list(Path(folder).rglob("*.nbc"))), float(seconds)


def warm_start() -> report.Section:
    """Return the table of a whole process that simplifies a file, with compiled kernels."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "scan.ply", Path(folder) / "small.ply"
        gppcs.write(source, gppcs.sample("medallion", n_points=400_000))
        words = [
            str(Path(sys.executable).with_name("gppcs")),
            "simplify",
            str(source),
            "-o",
            str(target),
            "--ratio",
            "0.03",
            "--force",
        ]
        seconds = report.least_time(lambda: subprocess.run(words, check=True, capture_output=True))
    return report.Section(
        "A whole process, warm",
        ["command", "seconds"],
        [["gppcs simplify, 400,000 points to 12,000", f"{seconds:.2f}"]],
    )


def main() -> None:
    """Print the tables and write them."""
    sections = [first_run_table(), warm_start(), thread_table()]
    report.write_sections("engine", "What the engine costs", sections, [DRAGON] if DRAGON.exists() else [], NOTES)


if __name__ == "__main__":
    main()
