"""How much memory this process has held at most."""

from __future__ import annotations

import sys
from pathlib import Path

STATUS = Path("/proc/self/status")  # of Linux


def peak_memory() -> int | None:
    """Return the greatest resident size of this process so far, in bytes; None where the platform does not tell."""
    try:
        status = STATUS.read_text()
    except OSError:
        status = ""
    if "VmHWM:" in status:  # and not getrusage, whose peak outlives the exec by which a process came about
        return int(status.split("VmHWM:")[1].split()[0]) * 1024
    try:
        import resource
    except ImportError:  # on Windows
        return None
    unit = {"darwin": 1}.get(sys.platform, 1024)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
