"""Draws progress as a bar, or prints it as lines for programs that start this one."""

import sys
import threading
from typing import TYPE_CHECKING

from gppcs.engine import timer

if TYPE_CHECKING:
    from rich.progress import Progress

PATIENCE = 1.0  # Seconds after which a stage shows a bar.


class ProgressBar:
    """Draws a progress bar for each stage of over a second: in a terminal on stderr, in a notebook below the cell.

    Elsewhere there is no bar. Notebooks need the package ipywidgets for it. Use: `gppcs.Timer(ProgressBar())`.
    """

    def __init__(self) -> None:
        self._stage: str | None = None
        self._bar: Progress | None = None
        self._start = threading.Timer(PATIENCE, lambda: None)

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        """Draw the progress of a stage; see `gppcs.Timer`."""
        if done == total:
            self._close()
            return
        if stage != self._stage:
            self._close()
            self._open(stage, total)
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=done)

    def _open(self, stage: str, total: int | None) -> None:
        self._stage = stage
        if not (sys.stderr.isatty() or "IPython" in sys.modules):
            return  # before Rich is imported, which takes a while
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        console = Console(stderr=True)
        if console.is_jupyter or (sys.stderr.isatty() and not console.is_dumb_terminal):
            name, times = (
                TextColumn("{task.description}{task.fields[compiled]}"),
                (TimeElapsedColumn(), TimeRemainingColumn()),
            )
            self._bar = Progress(SpinnerColumn(), name, BarColumn(), *times, console=console, transient=True)
            self._bar.add_task(stage, total=total, compiled=_Compiled())
            self._start = threading.Timer(PATIENCE, self._bar.start)
            self._start.daemon = True
            self._start.start()

    def _close(self) -> None:
        if self._bar is not None:
            self._start.cancel()
            self._start.join()
            self._bar.stop()
        self._stage = self._bar = None


class _Compiled:
    """How many kernels were compiled since the start of a stage, as the bar shows it."""

    def __init__(self) -> None:
        self._before = timer.compile_timer.kernels

    def __str__(self) -> str:
        count = timer.compile_timer.kernels - self._before
        return f", kernels compiled: {count}" if count else ""


class ProgressLines:
    """Prints a line on stderr at the start of each stage and for each per cent of its steps, as QGIS reads them."""

    def __init__(self) -> None:
        self._stage: str | None = None
        self._percent = 0

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        """Print the progress of a stage; see `gppcs.Timer`."""
        if stage != self._stage:
            self._stage, self._percent = stage, 0
            self._print(stage)
        percent = 100 * done // total if total else 0
        if self._percent < percent < 100:
            self._percent = percent
            self._print(f"{stage} {percent} %")
        if done == total:
            self._stage = None

    def _print(self, text: str) -> None:
        print(f"progress: {text}", file=sys.stderr, flush=True)  # noqa: T201
