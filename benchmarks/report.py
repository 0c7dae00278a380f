"""Tables of the benchmarks: printed, and written to `results/` with the commit, the machine and the data."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numba

import gppcs
from gppcs.engine.threads import number_of_threads

HERE = Path(__file__).parent
SEAL = "- the lines above, as the script wrote them: SHA-256 "
DATA = Path(os.environ.get("GPPCS_DATA", HERE.parents[1] / "shared" / "data"))


def least_time(work: Callable[[], object], repeats: int = 5, clock: Callable[[], float] = perf_counter) -> float:
    """Return the least time in seconds of several runs, after one that compiles or loads the kernels."""
    work()
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


@dataclass(frozen=True)
class Section:
    """A table under a heading."""

    heading: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def write(
    name: str, title: str, header: Sequence[str], rows: Sequence[Sequence[str]], data: Sequence[Path] = ()
) -> None:
    """Print a Markdown table and write it to results/NAME.md, with commit, machine and checksums of the data."""
    write_sections(name, title, [Section("", header, rows)], data)


def write_sections(
    name: str,
    title: str,
    sections: Sequence[Section],
    data: Sequence[Path] = (),
    notes: Sequence[str] = (),
    introduction: str = "",
) -> None:
    """Do the same for several tables, with notes after them.

    Before them stands a paragraph, by default the first line of the script's docstring.
    """
    introduction = introduction or (sys.modules["__main__"].__doc__ or "").partition("\n")[0]
    page = text(title, sections, data, notes, introduction)
    print(page)
    (HERE / "results" / f"{name}.md").write_text(page + SEAL + seal(page) + "\n")


def seal(page: str) -> str:
    """Return the SHA-256 of a page, which its last line has: a figure typed in later is noticed."""
    return hashlib.sha256(page.encode()).hexdigest()


def text(
    title: str,
    sections: Sequence[Section],
    data: Sequence[Path] = (),
    notes: Sequence[str] = (),
    introduction: str = "",
) -> str:
    """Return the Markdown of a page: introduction, tables, notes and origin."""
    lines = [f"# {title}", ""]
    lines += [introduction, ""] if introduction else []
    for section in sections:
        lines += [f"## {section.heading}", ""] if section.heading else []
        lines += [_line(section.header), _line(["---"] * len(section.header)), *map(_line, section.rows), ""]
    return "\n".join([*lines, *(f"- {note}" for note in notes), *_origin(data), ""])


def commit() -> str:
    """Return the commit of the code, and whether it was changed since."""
    changed = " with changes" if _git("status", "--porcelain", "--", "src") else ""
    return _git("rev-parse", "--short=12", "HEAD") + changed


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _origin(data: Sequence[Path]) -> list[str]:
    """Return lines on commit, machine, versions and data."""
    with open("/proc/cpuinfo") as file:
        processor = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), "unknown")
    return [
        f"- gppcs {gppcs.__version__}, commit {commit()}",
        f"- {processor}, {number_of_threads()} threads",
        f"- Python {platform.python_version()}, Numba {numba.__version__}",
        *(f"- {path.name}: SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}…" for path in data),
    ]


def _git(*words: str) -> str:
    """Return what git prints; nothing outside of a checkout."""
    return subprocess.run(["git", *words], cwd=HERE.parent, capture_output=True, text=True, check=False).stdout.strip()
