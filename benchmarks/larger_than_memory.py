"""Simplify clouds of 50 and 200 million points that lie in LAZ tiles, with little memory.

The tiles are made first: an airborne scan of hills and houses, in scan lines, to the centimetre. Runs on Linux only.
Other numbers of points may be given, in millions.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import laspy
import numpy as np

import report

TILE = 5_000_000  # points
SIDE = 500.0  # metres, of a tile
LINES = 1_000  # scan lines of a tile
MILLIONS = (50, 200)
JOBS = ((0.002, "3GB"), (0.05, "6GB"))  # share of the points to keep, and the limit of memory
NOTES = (
    "CPU seconds are those of all threads. Decoding is what laspy alone takes to read the files once, on one thread.",
    "The peak is that of the whole process. LAZ is counted in GB of all files.",
    "The machine was shared with other work, so wall time says little.",
)


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


def write_tile(path: Path, column: int, row: int, seed: int) -> None:
    """Write one tile of the scan."""
    rng = np.random.default_rng(seed)
    line = np.sort(rng.integers(0, LINES, TILE))
    along = (np.arange(TILE) % (TILE // LINES)) / (TILE // LINES)
    x = SIDE * (column + (line + 0.3 * rng.random(TILE)) / LINES)
    y = SIDE * (row + (along + rng.random(TILE) / (TILE // LINES)))
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales = np.full(3, 0.01)
    las.x, las.y, las.z = x, y, height(x, y) + 0.02 * rng.standard_normal(TILE)
    las.intensity = (200 + 50 * np.sin(x / 5.0)).astype(np.uint16)
    las.write(path)


def write_tiles(folder: Path, millions: int) -> list[Path]:
    """Write as many tiles as have that many points."""
    count = -(-millions * 1_000_000 // TILE)
    across = int(np.ceil(np.sqrt(count)))
    paths = [folder / f"{number:03}.laz" for number in range(count)]
    for number, path in enumerate(paths):
        if not path.exists():
            print(f"writing {path.name}", file=sys.stderr)
            write_tile(path, number % across, number // across, number)
    return paths


def decoding(paths: list[Path]) -> float:
    """Return the CPU seconds that laspy takes to read the files once."""
    code = "import sys, laspy\nfor path in sys.argv[1:]:\n    for _ in laspy.open(path).chunk_iterator(1_000_000): pass"
    return Cost.of([sys.executable, "-c", code, *map(str, paths)])[0].cpu


def measured(paths: list[Path], share: float, memory: str, folder: Path) -> list[str]:
    """Return the row of a job."""
    n, target = len(paths) * TILE, folder / "small.laz"
    words = [
        str(Path(sys.executable).with_name("gppcs")), "simplify", *map(str, paths), "-o", str(target),
        "--ratio", str(share), "--memory", memory, "--json", "--quiet", "--force",
    ]  # fmt: skip
    print(f"{n // 1_000_000} million points to {share:.1%}", file=sys.stderr)
    cost, printed = Cost.of(words, TMPDIR=str(folder))
    kept = int(laspy.open(target).header.point_count)
    assert kept == round(share * n) == json.loads(printed)["points_out"]
    return [
        f"{n / 1e6:,.0f} million", f"{kept / 1e6:g} million", memory, f"{cost.peak / 1e9:.2f}", f"{cost.seconds:.0f}",
        f"{cost.cpu:.0f}", f"{1e6 * cost.cpu / n:.2f}", f"{1e6 * decoding(paths) / n:.2f}",
    ]  # fmt: skip


def main() -> None:
    """Print the table and write it."""
    rows = []
    subprocess.run([Path(sys.executable).with_name("gppcs"), "warmup"], check=True)
    with tempfile.TemporaryDirectory(dir=os.environ.get("GPPCS_SCRATCH")) as name:
        tiles, work = Path(name) / "tiles", Path(name) / "work"
        tiles.mkdir()
        work.mkdir()
        for millions in map(int, sys.argv[1:] or MILLIONS):
            for path in tiles.iterdir():  # their place follows from their number
                path.unlink()
            paths = write_tiles(tiles, millions)
            size = sum(path.stat().st_size for path in paths)
            rows += [[*measured(paths, share, memory, work), f"{size / 1e9:.2f}"] for share, memory in JOBS]
            print(*rows[-2:], sep="\n", file=sys.stderr)
    header = (
        "points", "kept", "limit of memory", "peak GB", "seconds", "CPU seconds", "CPU µs for each point",
        "of which decoding once", "GB of LAZ",
    )  # fmt: skip
    report.write_sections(
        "larger_than_memory", "gp on files larger than memory", [report.Section("", header, rows)], [], NOTES
    )


if __name__ == "__main__":
    main()
