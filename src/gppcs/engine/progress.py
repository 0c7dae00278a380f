"""A progress bar, in a terminal or in a notebook, and lines for programs that start this one."""

from __future__ import annotations

import os
import sys
import threading
from html import escape
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PATIENCE = 1.0  # seconds after which a stage shows a bar
INTERVAL = 0.2  # seconds between two states of the bar in a notebook
LINES = "GPPCS_PROGRESS"  # the environment variable that asks for lines


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


class ProgressBar:
    """A `Listener` that draws a progress bar for each stage of over a second.

    In a terminal, the bar is on stderr. In a notebook, it is below the cell; a stage that reports no steps has none
    there. Elsewhere there is no bar. Where the environment variable `GPPCS_PROGRESS` is "lines", there are lines on
    stderr instead, such as "progress: normals 24 %".

    Examples
    --------
    >>> import gppcs
    >>> from gppcs.engine.progress import ProgressBar
    >>> timer = gppcs.Timer(ProgressBar())
    >>> len(gppcs.simplify(gppcs.sample("sphere", n_points=1000), n_points=100, method="fps", timer=timer).cloud)
    100
    """

    def __init__(self) -> None:
        self._bar: _TerminalBar | _NotebookBar | _Lines | None = None

    def started(self, stage: str, total: int | None) -> None:
        """Prepare a bar, which appears if the stage takes over a second.

        Parameters
        ----------
        stage : str
            The name of the stage.
        total : int or None
            The number of its steps, if known.
        """
        if os.environ.get(LINES) == "lines":
            self._bar = _Lines(stage, total)
            return
        if in_notebook():
            self._bar = _NotebookBar(stage, total)
            return
        console = Console(stderr=True)
        if sys.stderr.isatty() and not console.is_dumb_terminal:
            self._bar = _TerminalBar(console, stage, total)

    def advanced(self, steps: int) -> None:
        """Move the bar.

        Parameters
        ----------
        steps : int
            Steps done since the last call.
        """
        if self._bar is not None:
            self._bar.advance(steps)

    def finished(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.remove()
            self._bar = None


class _TerminalBar:
    """A bar on stderr."""

    def __init__(self, console: Console, stage: str, total: int | None) -> None:
        name, times = TextColumn("{task.description}"), (TimeElapsedColumn(), TimeRemainingColumn())
        self._progress = Progress(SpinnerColumn(), name, BarColumn(), *times, console=console, transient=True)
        self._task = self._progress.add_task(stage, total=total)
        self._timer = threading.Timer(PATIENCE, self._progress.start)
        self._timer.daemon = True
        self._timer.start()

    def advance(self, steps: int) -> None:
        self._progress.advance(self._task, steps)

    def remove(self) -> None:
        self._timer.cancel()
        self._timer.join()
        self._progress.stop()


class _NotebookBar:
    """A bar below the cell of a notebook."""

    def __init__(self, stage: str, total: int | None) -> None:
        self._stage, self._total, self._done = stage, total, 0
        self._next = perf_counter() + PATIENCE  # when the bar is drawn
        self._handle: Any = None

    def __repr__(self) -> str:
        return self._stage if self._total is None else f"{self._stage}: {self._done:,} of {self._total:,}"

    def _repr_html_(self) -> str:
        value = "" if self._total is None else f' value="{self._done}" max="{self._total}"'
        return f"<label>{escape(self._stage)} <progress{value}></progress></label>"

    def advance(self, steps: int) -> None:
        from IPython.display import display

        self._done += steps
        if perf_counter() < self._next:
            return
        self._next = perf_counter() + INTERVAL
        if self._handle is None:
            self._handle = display(self, display_id=True)
        else:
            self._handle.update(self)

    def remove(self) -> None:
        from IPython.display import HTML

        if self._handle is not None:
            self._handle.update(HTML(""))


class _Lines:
    """Lines on stderr: one at the start of a stage, and one for each per cent of its steps."""

    def __init__(self, stage: str, total: int | None) -> None:
        self._stage, self._total, self._done, self._told = stage, total, 0, 0
        self._tell(f"progress: {stage}")

    def _tell(self, line: str) -> None:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()

    def advance(self, steps: int) -> None:
        self._done += steps
        share = 100 * self._done // self._total if self._total else 0
        if share > self._told:
            self._told = share
            self._tell(f"progress: {self._stage} {share} %")

    def remove(self) -> None:
        pass
