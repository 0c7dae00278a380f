"""Measure the memory that this process has held and may still take; write sizes."""

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

STATUS = Path("/proc/self/status")  # on Linux, this file holds the peak as VmHWM


def peak_memory() -> int | None:
    """Return the peak resident memory of this process, where the system tells it."""
    with suppress(OSError, IndexError):  # preferred to getrusage, which includes the peak of the parent process
        return int(STATUS.read_text().split("VmHWM:")[1].split()[0]) * 1024
    with suppress(Exception):  # without /proc, psutil raises errors of its own
        import psutil

        return getattr(psutil.Process().memory_info(), "peak_wset", None)  # on Windows
    return None


def available_memory(root: Path = Path("/")) -> int | None:
    """Return how much memory this process, or its container, may take without swapping; None if that is unknown."""
    limits = list(_left_to_groups(root))
    with suppress(OSError, RuntimeError):
        import psutil

        limits.append(psutil.virtual_memory().available)
    return max(0, min(limits)) if limits else None


def size_of(memory: int) -> str:
    """Return a number of bytes as messages show it."""
    if memory < 1e6:
        return f"{memory:,} B"
    if memory < 1e9:
        return f"{math.ceil(memory / 1e6)} MB"
    return f"{memory / 1e9:.2g} GB" if memory < 1e10 else f"{memory / 1e9:,.0f} GB"


def control_groups(controller: str, root: Path = Path("/")) -> Iterator[Path]:
    """Yield the folders of the control groups, version 2 or 1, that this process belongs to, with all their parents."""
    mounted = root / "sys/fs/cgroup"
    try:
        groups = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for _, controllers, path in (group.split(":", 2) for group in groups if group.count(":") >= 2):
        if not controllers or controller in controllers.split(","):
            group = mounted / controllers / path.lstrip("/")
            yield from (group, *(parent for parent in group.parents if mounted in (parent, *parent.parents)))


def _left_to_groups(root: Path) -> Iterator[int]:
    """Yield how much memory each control group with a limit has left. Cached files can be dropped, so they are free."""
    for group in control_groups("memory", root):
        for limit, usage, cached in (
            ("memory.max", "memory.current", "inactive_file"),
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
        ):
            with suppress(OSError, ValueError, KeyError):  # the files of the other version; "max" stands for no limit
                statistics = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
                maximum, used = (int((group / file).read_text()) for file in (limit, usage))
                yield maximum - used + int(statistics[cached])
