"""Simplify clouds of LAZ tiles that are larger than memory: on this machine, and with workers of Dask.

The tiles are made first: an airborne scan of hills and houses, in scan lines, to the centimetre. Runs on Linux only.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from socket import socket
from threading import Event, Thread
from time import perf_counter
from typing import Any

import laspy
import numpy as np

import report

LINES = 100  # scan lines of a tile
SPACING = 0.5  # metres, about, between points
RUNS = 3  # of which the fastest counts
NOTES = (
    "CPU seconds are those of all threads, or of all workers. The peak is that of the process of the command.",
    "In memory, half of the free memory is allowed. The machine was shared with other work.",
)
WORKER_NOTES = (
    "Workers have one thread each, and two of them are all cores of the machine.",
    "Disk: the largest size of the folder of the output while it is made, with temporary files.",
)


@dataclass(frozen=True)
class Tiles:
    """Files of one cloud."""

    folder: Path
    count: int
    size: int  # points of each

    @classmethod
    def write(cls, folder: Path, count: int, size: int) -> Tiles:
        """Write as many tiles of that many points, in a process of its own.

        Linux counts the peak of a process from that of the process that starts it, so this one stays small.
        """
        folder.mkdir(parents=True)
        across = int(np.ceil(np.sqrt(count)))
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            places = ((number % across, number // across, size, number) for number in range(count))
            written = [pool.submit(write_tile, folder / f"{place[-1]:04}.laz", *place) for place in places]
            for tile in written:
                tile.result()
        return cls(folder, count, size)

    @property
    def n_points(self) -> int:
        """Number of points of all files."""
        return self.count * self.size

    @property
    def name(self) -> str:
        """Number of points and files."""
        return f"{self.n_points / 1e6:g} million in {self.count} file{'s' if self.count > 1 else ''}"


@dataclass(frozen=True)
class Cost:
    """What a process took."""

    seconds: float
    cpu: float
    peak: float

    @classmethod
    def of(cls, words: Sequence[str], **variables: str) -> tuple[Cost, str]:
        """Run a process with some variables of the environment; return its cost and what it printed."""
        start = perf_counter()
        process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=os.environ | variables)
        assert process.stdout
        printed = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, words)
        return cls(perf_counter() - start, usage.ru_utime + usage.ru_stime, 1024 * usage.ru_maxrss), printed


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the height of hills, with a house of 12 by 12 metres on every fourth plot of 25 by 25."""
    hills = 8.0 * np.sin(x / 90.0) * np.cos(y / 70.0) + 2.0 * np.sin(x / 17.0 + y / 23.0)
    plot_x, plot_y = np.floor(x / 25.0), np.floor(y / 25.0)
    in_house = (x - 25.0 * plot_x < 12.0) & (y - 25.0 * plot_y < 12.0) & ((plot_x + 2.0 * plot_y) % 4.0 == 0.0)
    return hills + np.where(in_house, 6.0, 0.0)


def write_tile(path: Path, column: int, row: int, size: int, seed: int) -> None:
    """Write one tile of the scan."""
    rng = np.random.default_rng(seed)
    side, per_line = SPACING * np.sqrt(size), size // LINES
    line = np.sort(rng.integers(0, LINES, size))
    along = (np.arange(size) % per_line) / per_line
    x = side * (column + (line + 0.3 * rng.random(size)) / LINES)
    y = side * (row + (along + rng.random(size) / per_line))
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales = np.full(3, 0.01)
    las.x, las.y, las.z = x, y, height(x, y) + 0.02 * rng.standard_normal(size)
    las.intensity = (200 + 50 * np.sin(x / 5.0)).astype(np.uint16)
    las.write(path)


def simplified(tiles: Tiles, ratio: float, target: Path, *more: str, **variables: str) -> Cost:
    """Return the cost of simplifying tiles to a file or a folder."""
    program = str(Path(sys.executable).with_name("gppcs"))
    words = [program, "simplify", str(tiles.folder), "-o", str(target), "--ratio", str(ratio), *more]
    print(tiles.name, *words[4:], file=sys.stderr)
    cost, printed = Cost.of([*words, "--json", "--quiet", "--force"], **variables)
    assert json.loads(printed.splitlines()[0])["points_out"] == round(ratio * tiles.n_points)
    return cost


def row_of(tiles: Tiles, ratio: float, limit: str, costs: Sequence[Cost], baseline: float | None = None) -> list[str]:
    """Return the row of some runs of a job: the least of each figure, and its time over that in memory."""
    seconds, cpu, peak = (min(getattr(cost, name) for cost in costs) for name in ("seconds", "cpu", "peak"))
    return [
        tiles.name, f"{ratio:.0%}", limit, f"{peak / 1e6:.0f}", f"{seconds:.0f}", f"{cpu:.0f}",
        f"{1e6 * cpu / tiles.n_points:.1f}", f"{seconds / baseline:.2f}" if baseline else "",
    ]  # fmt: skip


def beside_memory(folder: Path) -> list[list[str]]:
    """Return the rows of clouds that fit into memory, chosen in memory and tile by tile."""
    rows = []
    for millions, ratio in ((10, 0.01), (10, 0.05)):
        tiles = Tiles.write(folder / f"{millions}-{ratio}", 10, 100_000 * millions)
        jobs = {limit: [] for limit in ("", "700MB")}
        for _ in range(RUNS):
            for limit, costs in jobs.items():
                memory = ("--memory", limit) if limit else ()
                costs.append(simplified(tiles, ratio, folder / "small.laz", *memory))
        in_memory = min(cost.seconds for cost in jobs[""])
        rows += [row_of(tiles, ratio, limit or "in memory", costs, in_memory) for limit, costs in jobs.items()]
    return rows


@contextmanager
def cluster(count: int, folder: Path) -> Iterator[tuple[str, list[resource.struct_rusage]]]:
    """Start a scheduler and workers of one thread; yield its address, and a list for what workers used at the end."""
    dask = str(Path(sys.executable).with_name("dask"))
    with socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = subprocess.Popen(
        [dask, "scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2], "--no-dashboard"], **quiet
    )
    words = [dask, "worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    workers, used = [subprocess.Popen(words, **quiet) for _ in range(count)], []
    try:
        yield address, used
    finally:
        for worker in workers:
            worker.send_signal(signal.SIGINT)
            used.append(os.wait4(worker.pid, 0)[2])
        scheduler.terminate()
        scheduler.wait()


def with_workers(tiles: Tiles, ratio: float, folder: Path, count: int) -> list[str]:
    """Return the row of a run with so many workers, from folder to folder."""
    target, work = folder / f"thinned-{tiles.count}-{count}", folder / f"work-{tiles.count}-{count}"
    work.mkdir()
    with cluster(count, work) as (address, used):
        watch = Disk(target, work)
        cost = simplified(tiles, ratio, target, "--memory", "500MB", "--workers", address, TMPDIR=str(work))
        size = watch.stop()
    cpu, peak = sum(usage.ru_utime + usage.ru_stime for usage in used), max(usage.ru_maxrss for usage in used)
    return [
        tiles.name, f"{ratio:.0%}", str(count), f"{cost.peak / 1e6:.0f}", f"{1024 * peak / 1e6:.0f}",
        f"{cost.seconds:.0f}", f"{cpu + cost.cpu:.0f}", f"{1e6 * (cpu + cost.cpu) / tiles.n_points:.1f}",
        f"{size / 1e6:.0f}",
    ]  # fmt: skip


class Disk(Thread):
    """Watches how large some folders become together."""

    def __init__(self, *folders: Path) -> None:
        super().__init__(daemon=True)
        self._folders, self._largest, self._ended = folders, 0, Event()
        self.start()

    def run(self) -> None:
        """Look once a second."""
        while not self._ended.wait(1.0):
            words = ["du", "-sbc", *map(str, self._folders)]
            total = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
            self._largest = max(self._largest, int(total.split()[-2]))

    def stop(self) -> int:
        """Return the largest size, in bytes."""
        self._ended.set()
        self.join()
        return self._largest


def main() -> None:
    """Print the tables and write them."""
    subprocess.run([Path(sys.executable).with_name("gppcs"), "warmup"], check=True)
    with tempfile.TemporaryDirectory(dir=os.environ.get("GPPCS_SCRATCH")) as name:
        folder = Path(name)
        rows = beside_memory(folder)
        tiles = Tiles.write(folder / "40", 8, 5_000_000)
        rows.append(row_of(tiles, 0.01, "2GB", [simplified(tiles, 0.01, folder / "small.laz", "--memory", "2GB")]))
        tiles = Tiles.write(folder / "few", 40, 100_000)
        worker_rows = [with_workers(tiles, 0.05, folder, count) for count in (1, 2)]
        tiles = Tiles.write(folder / "many", 1_000, 100_000)
        worker_rows.append(with_workers(tiles, 0.05, folder, 2))
    same = "points", "kept", "limit of memory", "peak MB", "seconds", "CPU seconds", "CPU seconds for a million points"
    header = (*same, "time beside that in memory")
    worker_header = (
        "points", "kept", "workers", "peak MB of the command", "of a worker", *same[4:], "MB of disk",
    )  # fmt: skip
    sections = [
        report.Section("On one machine", header, rows),
        report.Section("From folder to folder, with workers of Dask", worker_header, worker_rows),
    ]
    report.write_sections("larger_than_memory", "gp on files larger than memory", sections, [], NOTES + WORKER_NOTES)


if __name__ == "__main__":
    main()
