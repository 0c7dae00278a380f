"""What clouds and files need of the rooms above them: reading, ranking and drawing. The package names the functions."""

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
rank: Callable[[PointCloud, str, int], NDArray[np.int64]]  # the rows that a method chooses first
html_of: Callable[[Any], str]
show: Callable[..., None]
