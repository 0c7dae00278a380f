"""Ends the program on Ctrl-C, SIGTERM and SIGHUP with one line on stderr and without unfinished files.

The first signal raises `Stopped`, so that everything is tidied up on the way out. A second signal ends the process at
once. So does a `Stopped` that nobody catches, or that code written in C swallows.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from types import FrameType, TracebackType
from typing import NoReturn

from gppcs.engine import unfinished

WORDS = {
    "SIGINT": "interrupted",
    "SIGTERM": "terminated",
    "SIGHUP": "stopped, since the terminal was closed",  # Windows has no such signal
}

_received: int | None = None  # the first signal
_told = False


class Stopped(BaseException):
    """A signal has asked the program to stop. No `except Exception` catches it."""


def catch_signals() -> None:
    """Let Ctrl-C, SIGTERM and SIGHUP stop this process, except those that it was started to ignore, as by nohup."""
    for number in (getattr(signal, name) for name in WORDS if hasattr(signal, name)):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _on_signal)
    sys.excepthook = _on_uncaught
    sys.unraisablehook = _on_swallowed


def end() -> NoReturn:
    """End the process after a signal, with the exit code that shells expect: 128 and the number of the signal.

    Unfinished files are removed, and one line on stderr says why the program stops. Python does not tidy up after
    itself: if the signal came in the middle of the compiler, that can crash.
    """
    with suppress(OSError, ValueError):  # nobody may read it any more
        sys.stdout.flush()
    _end_at_once()


def _end_at_once() -> NoReturn:
    global _told
    assert _received is not None
    unfinished.remove_all()
    if not _told:
        _told = True
        with suppress(OSError):  # the terminal may be gone
            # Not by `print`: the signal may have come in the middle of one, and Python refuses a second inside it.
            os.write(2, f"gppcs: {WORDS[signal.Signals(_received).name]}\n".encode())
    os._exit(128 + _received)


def _on_signal(number: int, frame: FrameType | None) -> None:
    global _received
    if _received is not None:
        _end_at_once()
    _received = number
    raise Stopped


def _on_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if _received is not None:  # `Stopped`, or what a library made of it
        _end_at_once()
    sys.__excepthook__(kind, error, trace)


def _on_swallowed(fault: sys.UnraisableHookArgs) -> None:
    if isinstance(fault.exc_value, Stopped):
        _end_at_once()
    sys.__unraisablehook__(fault)
