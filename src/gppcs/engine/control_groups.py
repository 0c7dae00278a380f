"""Find the control groups (Linux containers) that limit this process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path


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
