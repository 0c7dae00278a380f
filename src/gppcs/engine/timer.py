"""Time the stages of a run, with the compilation of kernels as one of its own, and report progress."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter
from typing import TypeAlias

from gppcs.errors import ParameterError, shown

OnProgress: TypeAlias = Callable[[str, int, int | None], object]  # stage, steps done, their number if known

NOTICE = "compiling the kernels for this task, once; this can take a minute"
COMPILATION = "compilation"  # the stage to which all compilation of kernels counts


def in_words(seconds: Mapping[str, float]) -> str:
    """Return how long a run took, and separately the compilation."""
    compilation = seconds.get(COMPILATION, 0.0)
    run = f"{sum(seconds.values()) - compilation:.3g} s"
    return f"{run} and {compilation:.3g} s of compilation" if compilation else run


class Timer:
    """Measures the wall time of each stage of one run.

    Parameters
    ----------
    on_progress : callable, optional
        Called as `on_progress(stage, done, total)` at the start of each stage, after some of its steps, and at its end,
        when `done` equals `total`. Before, `total` is None if the number of steps is unknown.

    Attributes
    ----------
    on_progress : callable or None
    seconds : dict of str to float
        Wall time in seconds by name of the stage, in the order of the run. Stages of the same name add up. If kernels
        were compiled meanwhile, that time is in an entry of its own, `compilation`, and not in those of the stages.

    Examples
    --------
    >>> timer = gppcs.Timer(print)
    >>> with timer("sum", total=2) as on_progress:
    ...     on_progress(1)
    sum 0 2
    sum 1 2
    sum 2 2
    >>> list(timer.seconds)
    ['sum']
    """

    def __init__(self, on_progress: OnProgress | None = None) -> None:
        if on_progress is not None and not callable(on_progress):
            raise ParameterError(f"expected on_progress to be a function or None, found {shown(on_progress)}")
        self.seconds: dict[str, float] = {}
        self.on_progress = on_progress

    @contextmanager
    def __call__(self, stage: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
        """Run the body of a `with` statement as a stage; what it gets is to be called with numbers of steps done."""
        done = 0

        def advance(steps: int) -> None:
            nonlocal done
            done += steps
            if self.on_progress:
                self.on_progress(stage, done, total)

        advance(0)
        compiled, start = compile_timer.seconds, perf_counter()
        try:
            yield advance
        finally:
            elapsed, compilation = perf_counter() - start, compile_timer.seconds - compiled
            self.seconds[stage] = self.seconds.get(stage, 0.0) + max(0.0, elapsed - compilation)
            if compilation:
                self.seconds[COMPILATION] = self.seconds.get(COMPILATION, 0.0) + compilation
            if self.on_progress and done != total:
                done = done if total is None else total
                self.on_progress(stage, done, done)


def timer_of(timer: Timer | None) -> Timer:
    """Return the timer that a caller passed, or a new one."""
    if timer is not None and not isinstance(timer, Timer):
        raise ParameterError(f"expected timer to be a gppcs.Timer or None, found {shown(timer)}")
    return Timer() if timer is None else timer


class CompileTimer:
    """Measures the time in which at least one kernel is being compiled."""

    def __init__(self) -> None:
        self.kernels = 0  # that were compiled so far
        self.seconds = 0.0  # of all compilations in this process, in any of its threads, that have ended
        self._depth = 0  # one kernel may need another; Numba lets only one thread compile at a time
        self._start = 0.0
        self._is_announced = False

    def start(self) -> None:
        """Note that a compilation starts."""
        if not self._is_announced:
            self._is_announced = True
            _announce()
        if self._depth == 0:
            self._start = perf_counter()
        self._depth += 1

    def stop(self) -> None:
        """Note that the compilation of a kernel has ended."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += perf_counter() - self._start


compile_timer = CompileTimer()


def _announce() -> None:
    """Log that kernels are compiled; in an interactive session or notebook, print it on stderr as well."""
    import logging

    from gppcs.engine.kernel_cache import folder_to_write  # only now, as it slows the start

    notice = NOTICE
    if not folder_to_write():
        notice = "compiling kernels for this run only: no cache folder can be written; set NUMBA_CACHE_DIR to one"
    logging.getLogger("gppcs").info(notice)
    if hasattr(sys, "ps1"):  # IPython and notebooks have it too
        print(f"gppcs: {notice}", file=sys.stderr)  # noqa: T201
