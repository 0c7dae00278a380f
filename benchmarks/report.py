"""Tables of the benchmarks: printed, and kept in `results/` with where they come from."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numba

import gppcs

HERE = Path(__file__).parent
DATA = Path(os.environ.get("GPPCS_DATA", HERE.parents[1] / "shared" / "data"))


def least_time(work: Callable[[], object], repeats: int = 5) -> float:
    """Return the least wall time in seconds of several runs, after one that compiles or loads the kernels."""
    work()
    times = []
    for _ in range(repeats):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


@dataclass(frozen=True)
class Section:
    """A table under a heading of its own."""

    heading: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def write(
    name: str, title: str, header: Sequence[str], rows: Sequence[Sequence[str]], data: Sequence[Path] = ()
) -> None:
    """Print a Markdown table and write it to results/NAME.md, with commit, machine and checksums of the data."""
    _keep(name, text(title, [Section("", header, rows)], data))


def write_sections(
    name: str, title: str, sections: Sequence[Section], data: Sequence[Path] = (), notes: Sequence[str] = ()
) -> None:
    """As `write`, for several tables and notes on how they came about."""
    _keep(name, text(title, sections, data, notes))


def text(title: str, sections: Sequence[Section], data: Sequence[Path] = (), notes: Sequence[str] = ()) -> str:
    """Return the Markdown of tables, notes and origin."""
    lines = [f"# {title}", ""]
    for section in sections:
        lines += [f"## {section.heading}", ""] if section.heading else []
        lines += [_line(section.header), _line(["---"] * len(section.header)), *map(_line, section.rows), ""]
    lines += [*(f"- {note}" for note in notes), *_origin(data), ""]
    return "\n".join(lines)


def _keep(name: str, page: str) -> None:
    print(page)
    (HERE / "results" / f"{name}.md").write_text(page)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _origin(data: Sequence[Path]) -> list[str]:
    """Say what was measured, on what, by what."""
    changed = " with changes" if _git("status", "--porcelain", "--", "src") else ""
    with open("/proc/cpuinfo") as file:
        processor = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), "unknown")
    return [
        f"- gppcs {gppcs.__version__}, commit {_git('rev-parse', '--short=12', 'HEAD')}{changed}",
        f"- {processor}, {numba.get_num_threads()} threads",
        f"- Python {platform.python_version()}, Numba {numba.__version__}",
        *(f"- {path.name}: SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}…" for path in data),
    ]


def _git(*words: str) -> str:
    """Return what git says, nothing outside a checkout."""
    return subprocess.run(["git", *words], cwd=HERE.parent, capture_output=True, text=True, check=False).stdout.strip()
