"""Say once that kernels are being compiled, and measure the time that it takes."""

from __future__ import annotations

import gc
import sys
from time import perf_counter

NOTICE = "compiling the kernels for this task, once; this can take a minute"
PASSING_NOTICE = (
    "compiling its kernels, for this run only, since neither its folder nor the user's cache folder can be "
    "written; set NUMBA_CACHE_DIR to a folder that can"
)


class CompileTimer:
    """Measures the time in which at least one kernel is being compiled, without the garbage collector."""

    def __init__(self) -> None:
        self._depth = 0  # one kernel may need another; Numba lets only one thread compile at a time
        self._state: tuple[float, float | None] = 0.0, None  # seconds before, and start; one value, as threads read it
        self._collected = False

    def start(self) -> None:
        """Note that the compilation of a kernel starts, and switch Python's garbage collector off.

        The compiler keeps so many objects that the collector would take a tenth of the time.
        """
        if self._depth == 0:
            self._state = self._state[0], perf_counter()
            self._collected = gc.isenabled()
            gc.disable()
        self._depth += 1

    def stop(self) -> None:
        """Note that the compilation of a kernel has ended, and switch the collector on again if it was."""
        self._depth -= 1
        if self._depth == 0:
            self._state = self.seconds(), None
            if self._collected:
                gc.enable()

    def seconds(self) -> float:
        """Return for how long this process has compiled kernels, in any of its threads."""
        before, start = self._state
        return before if start is None else before + perf_counter() - start


timer = CompileTimer()
_told = False


def compilation_started() -> None:
    """Note that the compilation of a kernel starts, and tell of the first one in this process."""
    global _told
    from gppcs.engine.kernel_cache import folder_to_write  # only now, as it slows the start

    if not _told:
        _told = True
        _tell(NOTICE if folder_to_write() else PASSING_NOTICE)
    timer.start()


def compilation_ended() -> None:
    """Note that the compilation of a kernel has ended."""
    timer.stop()


def _tell(notice: str) -> None:
    """Log a notice; in an interactive session or notebook, print it on stderr as well."""
    import logging

    logging.getLogger("gppcs").info(notice)
    if hasattr(sys, "ps1"):  # IPython and notebooks have it too
        print(f"gppcs: {notice}", file=sys.stderr)  # noqa: T201
