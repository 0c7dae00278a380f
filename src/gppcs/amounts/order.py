"""The order of the points of a result, and the sizes of its levels."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.lookup import numbers_in
from gppcs.clouds.quantities import size_of
from gppcs.engine.arrays import Ints
from gppcs.errors import ParameterError, shown


def check_order(cloud: PointCloud, order: str) -> None:
    """Check that a cloud, of which some points suffice, has what an order needs."""
    if order == "gps_time":
        numbers_in(cloud, order, "to order its points by")


def in_order(cloud: PointCloud, indices: Ints, order: str, rows: Ints | slice = slice(None)) -> Ints:
    """Return the positions, (M,), in another order than that of importance, of points with indices in the input.

    These points are some rows of a cloud, or all.
    """
    keys = [indices] if order == "input" else [indices, numbers_in(cloud, order, "to order its points by")[rows]]
    return np.lexsort(keys)


def level_sizes(levels: Any) -> tuple[float, ...]:
    """Return the sizes of levels, from coarse to fine: either fractions of the points or numbers."""
    texts = levels.split(",") if isinstance(levels, str) else levels
    if not isinstance(texts, Sequence) or not texts:
        raise ParameterError(f"expected `levels` to be sizes such as 10%,3%,1%, found {shown(levels)}")
    values = [size_of("levels", value) for value in texts]
    sizes = sorted(set(values))
    if len(values) > 256:
        raise ParameterError(f"expected `levels` with at most 256 sizes, found {len(values)}")
    if sizes[0] < 1 <= sizes[-1]:
        raise ParameterError(f"expected `levels` with fractions or with numbers, found both in {shown(levels)}")
    if len(sizes) < len(values):
        raise ParameterError(f"expected `levels` with different sizes, such as 10%,3%,1%, found {shown(levels)}")
    return tuple(sizes)
