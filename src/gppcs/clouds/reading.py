"""How a path becomes a cloud. Reading files is the work of a room above this one, so the package names the reader."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud

read: Callable[[str | os.PathLike[str]], PointCloud]  # set by the package `gppcs`
