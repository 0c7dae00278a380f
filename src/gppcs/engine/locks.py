"""Locks of files, which end with the process that holds them, however it ends."""

from __future__ import annotations

import sys
from typing import IO


def locks(file: IO[str]) -> bool:
    """Lock a file until it is closed or this process ends, unless it is locked."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # the second one on Windows
        return False
    return True
