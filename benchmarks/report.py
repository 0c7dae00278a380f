"""Tables of the benchmarks: printed, and written to `results/` with the commit, the machine and the data.

A table with figures of `gp` also has a digest of the code of `gp`. Where that code has changed since, the page must say
so: `python benchmarks/mark_stale.py` adds or removes the line in all pages.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numba

import code_digest
import gppcs
from gppcs.engine.threads import number_of_threads

HERE = Path(__file__).parent
DATA = Path(os.environ.get("GPPCS_DATA", HERE.parents[1] / "shared" / "data"))
GP = re.compile(r"(?<![\w-])gp(?![\w-])")  # the method, not gp-spectral
ORIGIN = re.compile(r"- gppcs .*commit (\w+)")
CODE = "- code of gp: SHA-256 {}…"
STALE = "- gp as of commit {}; the code of gp has changed since"


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
    """Do the same for several tables, with a paragraph before them and notes after them."""
    page = text(title, sections, data, notes, introduction)
    print(page)
    (HERE / "results" / f"{name}.md").write_text(page)


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
    of_gp = [CODE.format(code_of_gp())] if shows_gp("\n".join(lines)) else []
    return "\n".join([*lines, *(f"- {note}" for note in notes), *_origin(data), *of_gp, ""])


def shows_gp(page: str) -> bool:
    """Tell whether the title, a heading or a table of a page names the method gp."""
    return any(GP.search(line) for line in page.splitlines() if line.startswith(("#", "|")))


def code_of_gp() -> str:
    """Return the digest of the code that decides what gp chooses."""
    return code_digest.of_method(gppcs.LocalGP())


def marked(page: str) -> str:
    """Return a page with the line that says that gp has changed, or without it where it has not."""
    lines = [line for line in page.splitlines() if not line.startswith(STALE.split("{")[0])]
    if shows_gp(page) and CODE.format(code_of_gp()) not in lines:
        place = next(number for number, line in enumerate(lines) if ORIGIN.match(line))
        lines.insert(place, STALE.format(ORIGIN.match(lines[place])[1]))
    return "\n".join([*lines, ""])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _origin(data: Sequence[Path]) -> list[str]:
    """Return lines on commit, machine, versions and data."""
    changed = " with changes" if _git("status", "--porcelain", "--", "src") else ""
    with open("/proc/cpuinfo") as file:
        processor = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), "unknown")
    return [
        f"- gppcs {gppcs.__version__}, commit {_git('rev-parse', '--short=12', 'HEAD')}{changed}",
        f"- {processor}, {number_of_threads()} threads",
        f"- Python {platform.python_version()}, Numba {numba.__version__}",
        *(f"- {path.name}: SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}…" for path in data),
    ]


def _git(*words: str) -> str:
    """Return what git prints; nothing outside of a checkout."""
    return subprocess.run(["git", *words], cwd=HERE.parent, capture_output=True, text=True, check=False).stdout.strip()
