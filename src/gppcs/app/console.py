"""What a person at a terminal sees while the command works: progress on stderr, tables on stdout."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from gppcs.app.tables import UNITS, columns_of, shown
from gppcs.engine import kernel_cache

if TYPE_CHECKING:
    from gppcs.evaluation.comparison import Entry

NOTICE = "gppcs: compiling its kernels, once on this machine"
PASSING_NOTICE = (
    "gppcs: compiling its kernels, for this run only: neither its folder nor the user's cache folder can be written; "
    "set NUMBA_CACHE_DIR to one that can"
)
PATIENCE = 1.0  # seconds that a stage may take before a bar appears


class ProgressBar:
    """A listener that draws a bar on stderr for each stage of over a second, if that is a terminal."""

    def __init__(self) -> None:
        self._progress: Progress | None = None
        self._task: TaskID | None = None
        self._timer: threading.Timer | None = None

    def started(self, stage: str, total: int | None) -> None:
        """Prepare a bar, and show it if the stage takes long."""
        console = Console(stderr=True)
        if not sys.stderr.isatty() or console.is_dumb_terminal:
            return
        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        self._progress = Progress(*columns, console=console, transient=True)
        self._task = self._progress.add_task(stage, total=total)
        self._timer = threading.Timer(PATIENCE, self._progress.start)
        self._timer.daemon = True
        self._timer.start()

    def advanced(self, steps: int) -> None:
        """Move the bar."""
        if self._progress is not None and self._task is not None:
            self._progress.advance(self._task, steps)

    def finished(self) -> None:
        """Take the bar away."""
        if self._progress is not None and self._timer is not None:
            self._timer.cancel()
            self._timer.join()
            self._progress.stop()
            self._progress = None


class Compilation:
    """Says on stderr, once, that kernels are being compiled, and adds up the seconds that it takes."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0
        self._start = 0.0

    def on_start(self, event: object) -> None:
        """Hear that a kernel is about to be compiled; one may need another."""
        if self.seconds == 0.0 and self._depth == 0:
            print(NOTICE if kernel_cache.are_kept() else PASSING_NOTICE, file=sys.stderr)  # noqa: T201
        if self._depth == 0:
            self._start = perf_counter()
        self._depth += 1

    def on_end(self, event: object) -> None:
        """Hear that it is done."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += perf_counter() - self._start


@contextmanager
def compilation_noticed() -> Iterator[Compilation]:
    """Watch for kernels that are compiled, rather than loaded from the cache, while the block runs."""
    from numba.core import event

    compilation = Compilation()
    listener = type("Listener", (event.Listener,), {"on_start": compilation.on_start, "on_end": compilation.on_end})()
    with event.install_listener("numba:compile", listener):
        yield compilation


def print_comparison(entries: Sequence[Entry]) -> None:
    """Print a row for each method, the best of each column in bold."""
    columns = columns_of(entries)
    names = [entry.result.method.label for entry in entries]
    widths = [max(map(len, [*column.title.split(), *map(shown, column.values)])) for column in columns]
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("method", width=(longest := max(map(len, [*names, "method"]))))
    for column, width in zip(columns, widths, strict=True):
        table.add_column(column.title, justify="right", width=width)
    for row, name in enumerate(names):
        cells = (Text(shown(column.values[row]), style="bold" if column.is_best(row) else "") for column in columns)
        table.add_row(Text(name), *cells)
    needed = longest + sum(widths) + 2 * len(columns)
    console = Console(width=max(Console().width, needed), highlight=False)  # rather over the edge than cut short
    console.print(table)
    console.print(UNITS, style="dim")


def print_paragraphs(paragraphs: Sequence[tuple[str, str]]) -> None:
    """Print texts, indented, each under its title; an empty line parts a text."""
    console = Console(markup=False, emoji=False, highlight=False)
    for title, text in paragraphs:
        console.print(title, style="bold")
        for part in text.strip().split("\n\n"):
            console.print(Padding(" ".join(part.split()), (0, 0, 0, 4)))


def print_table(title: str, rows: Mapping[str, str]) -> None:
    """Print names and values under a title."""
    console = Console(markup=False, emoji=False, highlight=False, soft_wrap=True)
    console.print(title, style="bold")
    width = max(map(len, rows))
    for name, value in rows.items():
        console.print(f"{name:<{width}}  {value}".rstrip())
