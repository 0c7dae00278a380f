"""What writing COPC files needs of a room above; the package names the function."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud

rank: Callable[[PointCloud, str, int], NDArray[np.int64]]  # the rows that a method chooses first; set by `gppcs`
