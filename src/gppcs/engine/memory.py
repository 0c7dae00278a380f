"""Measure the memory that this process has held and may still take; find the groups that limit it; write sizes."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

STATUS = Path("/proc/self/status")  # on Linux, this file holds the peak as VmHWM


def peak_memory() -> int | None:
    """Return the peak resident memory of this process."""
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


def available_memory(root: Path = Path("/")) -> int | None:
    """Return how much memory this process may still take without swapping."""
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    free = [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    return max(0, min([*free, *_left_to_groups(root)])) if free else None


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
                most, used = (int((group / file).read_text()) for file in (limit, usage))
                yield most - used + int(statistics[cached])
