"""How a path becomes a cloud, and a cloud data of laspy.

Files are the work of a room above this one, so the package names the functions.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud

# Set by the package `gppcs`.
read: Callable[[str | os.PathLike[str]], PointCloud]
laspy_of: Callable[[PointCloud], Any]
