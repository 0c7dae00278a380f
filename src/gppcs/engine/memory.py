"""Measure the peak memory of this process."""

from __future__ import annotations

import sys
from pathlib import Path

STATUS = Path("/proc/self/status")  # on Linux, this file holds the peak as VmHWM


def peak_memory() -> int | None:
    """Return the peak resident memory of this process.

    Returns
    -------
    int or None
        Bytes; None if the platform does not report it.
    """
    try:
        status = STATUS.read_text()
    except OSError:
        status = ""
    if "VmHWM:" in status:  # preferred to getrusage, which includes the peak of the program that started this one
        return int(status.split("VmHWM:")[1].split()[0]) * 1024
    try:
        import resource
    except ImportError:  # on Windows
        return None
    unit = {"darwin": 1}.get(sys.platform, 1024)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
