"""The order of the points of a result."""

from __future__ import annotations

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.lookup import numbers_in
from gppcs.engine.arrays import Ints


def check_order(cloud: PointCloud, order: str) -> None:
    """Check that a cloud, of which some points suffice, has what an order needs."""
    if order == "gps_time":
        numbers_in(cloud, order, "to order its points by")


def in_order(kept: PointCloud, indices: Ints, order: str) -> Ints:
    """Return the positions, (M,), of kept points in another order than that of importance, by indices in the input."""
    keys = [indices] if order == "input" else [indices, numbers_in(kept, order, "to order its points by")]
    return np.lexsort(keys)
