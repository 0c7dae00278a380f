"""The entry point of the command `gppcs`: prepares for Ctrl-C before it imports the program, which takes longer."""

from __future__ import annotations

import gc
import os
import sys

from gppcs.app import stopping

GC_THRESHOLD = 1_000_000  # objects between two garbage collections; Python's default of 700 slows imports


def main() -> None:
    """Run the program with the arguments in `sys.argv`."""
    stopping.catch_signals()
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed, as by 2>&-
            setattr(sys, stream, open(os.devnull, "w"))  # noqa: SIM115
    try:
        os.getcwd()
    except FileNotFoundError:  # it was deleted; Numba imports coverage where that is installed, which needs one
        sys.modules["coverage"] = None  # type: ignore[assignment]
    try:
        gc.set_threshold(GC_THRESHOLD)
        from gppcs.app.program import run

        code = run(sys.argv[1:])
    except stopping.Stopped:
        stopping.end()
    sys.exit(code)
