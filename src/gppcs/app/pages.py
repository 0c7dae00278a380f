"""What the commands share that make a page: names of clouds, surfaces rebuilt from them, and how the page was made."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gppcs import __version__
from gppcs.app.printing import print_error

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.mesh import Mesh

SUFFIXES = (".html", ".htm")  # of pages
MOST_TO_REBUILD = 1_000_000  # points; to rebuild a mesh from a larger cloud would take minutes


def different_names(paths: Sequence[Path]) -> list[str]:
    """Return a different name for each file: its own, or its path if another file has the same name."""
    names = [path.name for path in paths]
    return [str(path) if names.count(path.name) > 1 else path.name for path in paths]


def rebuilt(name: str, cloud: PointCloud, original: PointCloud, advice: str = "") -> Mesh | None:
    """Return a surface rebuilt from a cloud, to be shown. If the cloud is too large, print a note instead."""
    from gppcs.evaluation.comparison import rebuilt_mesh

    if len(cloud) > MOST_TO_REBUILD:
        print_error(f"note: there is no mesh of {name}, as it has more than {MOST_TO_REBUILD:,} points{advice}")
        return None
    return rebuilt_mesh(cloud, original)


def how_made(command: Sequence[str], inputs: Sequence[Path]) -> list[tuple[str, str]]:
    """Return how a page was made, so that anybody can make it again."""
    from gppcs.io import is_standard

    made = how_run(command)
    for name, path in zip(different_names(inputs), inputs, strict=True):
        if not is_standard(path):
            with open(path, "rb") as file:
                made.append((f"SHA-256 of {name}", hashlib.file_digest(file, "sha256").hexdigest()))
    return [*made, ("views", "Coordinates and values in 16 bits of their range, normals in 16 bits.")]


def how_run(command: Sequence[str]) -> list[tuple[str, str]]:
    """Return what has made a page."""
    return [("gppcs", __version__), ("command", shlex.join(command))]
