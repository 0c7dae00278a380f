"""Time the stages of a run, and the compilation of kernels apart, and report progress to a listener."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter
from typing import Protocol, runtime_checkable

from gppcs.errors import ParameterError, shown

COMPILATION = "compilation"  # the stage to which all compilation of kernels counts
NOTICE = "compiling the kernels for this task, once; this can take a minute"
PASSING_NOTICE = (
    "compiling its kernels, for this run only, since neither its folder nor the user's cache folder can be "
    "written; set NUMBA_CACHE_DIR to a folder that can"
)


def in_words(seconds: Mapping[str, float]) -> str:
    """Return how long a run took, and apart from that the compilation."""
    compilation = seconds.get(COMPILATION, 0.0)
    words = f"{sum(seconds.values()) - compilation:.3g} s"
    return f"{words} and {compilation:.3g} s of compilation" if compilation else words


@runtime_checkable
class Listener(Protocol):
    """The interface of an object that receives the progress of a run, such as a progress bar.

    Examples
    --------
    >>> import gppcs
    >>> class Printer:
    ...     def started(self, stage, total):
    ...         print(f"{stage}: {total} steps")
    ...     def advanced(self, steps):
    ...         print(f"{steps} done")
    ...     def finished(self):
    ...         print("over")
    >>> listener = Printer()
    >>> with gppcs.Timer(listener)("sum", total=2) as advanced:
    ...     advanced(2)
    sum: 2 steps
    2 done
    over
    """

    def started(self, stage: str, total: int | None) -> None:
        """Receive the start of a stage.

        Parameters
        ----------
        stage : str
            Name of the stage.
        total : int or None
            Its number of steps; None if unknown.
        """

    def advanced(self, steps: int) -> None:
        """Receive the progress of the current stage.

        Parameters
        ----------
        steps : int
            Number of steps done since the last call.
        """

    def finished(self) -> None:
        """Receive the end of the current stage."""


class Timer:
    """Measures the wall time of each stage of one run.

    Parameters
    ----------
    listener : Listener, optional
        Receives the progress of the run.

    Raises
    ------
    ParameterError
        If the listener lacks one of the methods of `Listener`.

    Attributes
    ----------
    listener : Listener or None
    seconds : dict of str to float
        Wall time in seconds by name of the stage, in the order of the run. Stages of the same name add up. If kernels
        were compiled meanwhile, that time is in an entry of its own, `compilation`, and not in those of the stages.

    Examples
    --------
    >>> import gppcs
    >>> timer = gppcs.Timer()
    >>> with timer("sum", total=2) as advanced:
    ...     advanced(2)
    >>> list(timer.seconds)
    ['sum']
    """

    def __init__(self, listener: Listener | None = None) -> None:
        if listener is not None and not isinstance(listener, Listener):
            raise ParameterError(
                f"expected a listener with the methods started, advanced and finished, found {shown(listener)}"
            )
        self.seconds: dict[str, float] = {}
        self.listener = listener

    @contextmanager
    def __call__(self, name: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
        """Run the body of a `with` statement as a stage."""
        listener = self.listener
        if listener:
            listener.started(name, total)
        compiled, start = compile_timer.seconds, perf_counter()
        try:
            yield listener.advanced if listener else _ignore
        finally:
            elapsed, compilation = perf_counter() - start, compile_timer.seconds - compiled
            self.seconds[name] = self.seconds.get(name, 0.0) + max(0.0, elapsed - compilation)
            if compilation:
                self.seconds[COMPILATION] = self.seconds.get(COMPILATION, 0.0) + compilation
            if listener:
                listener.finished()


def timer_of(timer: Timer | None) -> Timer:
    """Return the timer that a caller gave, or a new one without a listener."""
    if timer is not None and not isinstance(timer, Timer):
        raise ParameterError(f"expected timer to be a gppcs.Timer or None, found {shown(timer)}")
    return Timer() if timer is None else timer


def _ignore(steps: int) -> None:
    pass


class CompileTimer:
    """Measures the time in which at least one kernel is being compiled, without the garbage collector."""

    def __init__(self) -> None:
        self.seconds = 0.0  # of all compilations in this process, in any of its threads, that have ended
        self._depth = 0  # one kernel may need another; Numba lets only one thread compile at a time
        self._start = 0.0
        self._collected = self._told = False

    def start(self) -> None:
        """Note that a compilation starts; the garbage collector, which would take a tenth of the time, is off."""
        from gppcs.engine.kernel_cache import folder_to_write  # only now, as it slows the start

        if not self._told:
            self._told = True
            _tell(NOTICE if folder_to_write() else PASSING_NOTICE)
        if self._depth == 0:
            self._start = perf_counter()
            self._collected = gc.isenabled()
            gc.disable()
        self._depth += 1

    def stop(self) -> None:
        """Note that the compilation of a kernel has ended, and switch the collector on again if it was."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += perf_counter() - self._start
            if self._collected:
                gc.enable()


compile_timer = CompileTimer()


def _tell(notice: str) -> None:
    """Log a notice; in an interactive session or notebook, print it on stderr as well."""
    import logging

    logging.getLogger("gppcs").info(notice)
    if hasattr(sys, "ps1"):  # IPython and notebooks have it too
        print(f"gppcs: {notice}", file=sys.stderr)  # noqa: T201
