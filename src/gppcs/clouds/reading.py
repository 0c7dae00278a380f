"""How a path becomes a cloud, a cloud data of laspy, and which of its points a method chooses first.

All this is the work of rooms above, so the package names the functions.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud

# Set by the package `gppcs`.
read: Callable[[str | os.PathLike[str]], PointCloud]
laspy_of: Callable[[PointCloud], Any]
rank: Callable[[PointCloud, str, int], NDArray[np.int64]]
