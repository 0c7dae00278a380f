"""The entry point of the command `gppcs`: it ends with one line on Ctrl-C, also while it still imports the program."""

from __future__ import annotations

import gc
import os
import signal
import sys
from types import FrameType
from typing import NoReturn


class Stopped(BaseException):
    """A signal asks the program to end; files are tidied up on the way out, as no `except Exception` catches it."""


def main() -> None:
    """Run the program with the arguments in `sys.argv`."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # Windows lacks the last
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # as nohup has it ignored
            signal.signal(number, _stop)
    sys.unraisablehook = _on_swallowed
    prints_results = sys.argv[1:2] in (["info"], ["evaluate"], ["methods"]) or "--dry-run" in sys.argv
    if sys.stdout is None and prints_results:  # as by >&-
        sys.exit("gppcs: expected standard output, where the results go, found that it is closed; leave it open")
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed, as by 2>&-
            setattr(sys, stream, open(os.devnull, "w"))  # noqa: SIM115
    try:
        os.getcwd()
    except FileNotFoundError:  # it was deleted; Numba imports coverage where that is installed, which needs one
        sys.modules["coverage"] = None  # type: ignore[assignment]
    try:
        gc.set_threshold(1_000_000)  # Python's default of 700 objects slows imports
        from gppcs.app.program import run

        code = run(sys.argv[1:])
    except Stopped as stop:
        _end(stop)
    sys.exit(code)


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)


def _on_swallowed(fault: sys.UnraisableHookArgs) -> None:
    """End the program if code in C, such as the compiler, swallows the signal."""
    if isinstance(fault.exc_value, Stopped):
        _end(fault.exc_value)
    sys.__unraisablehook__(fault)


def _end(stop: Stopped) -> NoReturn:
    """End the program at once: threads may still compute, and the compiler may be half way."""
    os.write(2, b"gppcs: interrupted\n")
    os._exit(128 + stop.args[0])
