"""Output for people at a terminal: progress on stderr, tables on stdout."""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from gppcs.app.tables import UNITS, columns_of, shown

if TYPE_CHECKING:
    from gppcs.evaluation.comparison import Entry

PATIENCE = 1.0  # seconds after which a stage shows a bar


class ProgressBar:
    """A `Listener` that draws a progress bar for each stage of over a second, if stderr is a terminal."""

    def __init__(self) -> None:
        self._progress: Progress | None = None
        self._task: TaskID | None = None
        self._timer: threading.Timer | None = None

    def started(self, stage: str, total: int | None) -> None:
        """Prepare a bar, which appears if the stage takes over a second.

        Parameters
        ----------
        stage : str
            The name of the stage.
        total : int or None
            The number of its steps, if known.
        """
        console = Console(stderr=True)
        if not sys.stderr.isatty() or console.is_dumb_terminal:
            return
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        self._progress = Progress(*columns, console=console, transient=True)
        self._task = self._progress.add_task(stage, total=total)
        self._timer = threading.Timer(PATIENCE, self._progress.start)
        self._timer.daemon = True
        self._timer.start()

    def advanced(self, steps: int) -> None:
        """Move the bar.

        Parameters
        ----------
        steps : int
            Steps done since the last call.
        """
        if self._progress is not None and self._task is not None:
            self._progress.advance(self._task, steps)

    def finished(self) -> None:
        """Remove the bar."""
        if self._progress is not None and self._timer is not None:
            self._timer.cancel()
            self._timer.join()
            self._progress.stop()
            self._progress = None


def print_comparison(entries: Sequence[Entry]) -> None:
    """Print a table with a row for each method. The best value of each column is bold.

    Parameters
    ----------
    entries : sequence of Entry
        At least one.
    """
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
    console = Console(width=max(Console().width, needed), highlight=False)  # wider than the terminal rather than cut
    console.print(table)
    console.print(UNITS, style="dim")


def print_paragraphs(paragraphs: Sequence[tuple[str, str]]) -> None:
    """Print texts, each indented below its title.

    Parameters
    ----------
    paragraphs : sequence of (title, text)
        Empty lines separate the paragraphs of a text.
    """
    console = Console(markup=False, emoji=False, highlight=False)
    for title, text in paragraphs:
        console.print(title, style="bold")
        for part in text.strip().split("\n\n"):
            console.print(Padding(" ".join(part.split()), (0, 0, 0, 4)))


def print_table(title: str, rows: Mapping[str, str]) -> None:
    """Print names and values below a title.

    Parameters
    ----------
    title : str
        The first line.
    rows : mapping of str to str
        Values by name.
    """
    console = Console(markup=False, emoji=False, highlight=False, soft_wrap=True)
    console.print(title, style="bold")
    width = max(map(len, rows))
    for name, value in rows.items():
        console.print(f"{name:<{width}}  {value}".rstrip())
