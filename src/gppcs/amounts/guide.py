"""The class `Guide`: which points are kept whatever happens, and where more or fewer are wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.expressions import Expression
from gppcs.errors import InputError, ParameterError, nearest_name, shown

LEAST_WEIGHT = 1e-4  # As a share of the largest. A smaller one counts as this: wider spacings would only take time.


@dataclass(frozen=True, eq=False)
class Guide:
    """What users know of the points that the method does not.

    Attributes
    ----------
    keep : (K,) array, int64
        Rows that are kept whatever happens, ascending.
    weights : (N,) array or None
        Multiplies the density of the points that are kept. Points of weight 0 are not kept, unless they are in `keep`.
    """

    keep: NDArray[np.int64]
    weights: NDArray[np.float64] | None

    @classmethod
    def of(cls, cloud: PointCloud, rows: NDArray[np.int64] | None, keep: Any, weight: Any) -> Guide | None:
        """Check the arguments `keep` and `weight` of `gppcs.simplify`.

        Parameters
        ----------
        cloud : PointCloud
        rows : (N,) array or None
            The rows of the cloud among which is chosen, ascending; None for all.
        keep, weight
            As for `gppcs.simplify`.

        Returns
        -------
        Guide or None
            For the points in `rows`. None if nothing is kept and all weights are equal.

        Raises
        ------
        InputError
            If no point meets the condition `keep`; if a weight is negative or not finite, or none is above 0; or if the
            cloud has no attribute of a name.
        ParameterError
            If an argument is of another kind or length.
        """
        if keep is None and weight is None:
            return None
        n = len(cloud)
        mask = np.zeros(n, dtype=np.bool_) if keep is None else _mask(cloud, keep)
        weights = None if weight is None else _weights(cloud, weight)
        if rows is not None:
            mask, weights = mask[rows], None if weights is None else weights[rows]
        if isinstance(keep, str) and not mask.any():
            raise nothing_to_keep(keep)
        if weights is not None:
            weights = _checked(weights)
        return None if weights is None and not mask.any() else cls(np.flatnonzero(mask), weights)

    def order(self, n: int) -> NDArray[np.int64]:
        """Return the rows among which is chosen.

        Parameters
        ----------
        n : int
            N, the number of points.

        Returns
        -------
        (n,) array, int64
            First those to keep, then those that have a weight.
        """
        free = np.ones(n, dtype=np.bool_) if self.weights is None else self.weights > 0.0
        free[self.keep] = False
        return np.concatenate([self.keep, np.flatnonzero(free)])


def check_guided_amount(spacing: Any, keep: Any, weight: Any) -> None:
    """Check that no spacing is asked for together with points to keep or weights.

    Parameters
    ----------
    spacing, keep, weight
        As for `gppcs.simplify`.

    Raises
    ------
    ParameterError
        If it is.
    """
    if spacing is not None and (keep is not None or weight is not None):
        raise ParameterError("expected a number, a share or a tolerance with points to keep or weights")


def nothing_to_keep(condition: str) -> InputError:
    """Return the error for a condition of points to keep that none meets.

    Parameters
    ----------
    condition : str

    Returns
    -------
    InputError
    """
    found = f"expected points with {condition.strip()} to keep, found none; change the condition or omit"
    return InputError(f"{found} keep", command=f"{found} --keep")


def _mask(cloud: PointCloud, keep: Any) -> NDArray[np.bool_]:
    """Return which points are to be kept."""
    if isinstance(keep, str):
        return Expression.of(keep).mask(cloud)
    expected = f"expected keep to be a condition, a mask of the {len(cloud):,} points, or rows"
    try:
        given = np.asarray(keep)
    except ValueError:
        raise ParameterError(f"{expected}, found {shown(keep)}") from None
    if given.dtype == np.bool_ and given.shape == (len(cloud),):
        return given
    if given.ndim != 1 or not (np.issubdtype(given.dtype, np.integer) or given.size == 0):
        raise ParameterError(f"{expected}, found {shown(keep)}")
    bad = (given < 0) | (given >= len(cloud))
    if bad.any():
        raise ParameterError(f"{expected} from 0 to {len(cloud) - 1}, found {given[bad][0]}")
    mask = np.zeros(len(cloud), dtype=np.bool_)
    mask[given.astype(np.int64)] = True
    return mask


def _weights(cloud: PointCloud, weight: Any) -> NDArray[np.float64]:
    """Return the weight of each point."""
    if isinstance(weight, str):
        if weight not in cloud.attributes:
            near = nearest_name(weight, cloud.attributes) if cloud.attributes else "; it has none at all"
            raise InputError(f"the cloud has no attribute {shown(weight)} to weigh its points by{near}")
        weight = cloud.attributes[weight]
    expected = f"expected weight to be an attribute, or a number for each of the {len(cloud):,} points"
    try:
        given = np.asarray(weight)
    except ValueError:
        raise ParameterError(f"{expected}, found {shown(weight)}") from None
    if given.shape != (len(cloud),) or given.dtype.kind not in "biuf":
        raise ParameterError(f"{expected}, found {shown(weight)}")
    with np.errstate(over="ignore"):  # an infinite weight gets an error of its own
        return given.astype(np.float64)


def _checked(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return weights as shares of the largest one, but 0 or at least `LEAST_WEIGHT`."""
    bad = np.flatnonzero(~((weights >= 0.0) & np.isfinite(weights)))
    if len(bad):
        raise InputError(
            f"expected finite weights from 0 on, found {weights[bad[0]]:g} at index {bad[0]} and {len(bad) - 1} more"
        )
    if not weights.any():
        raise InputError("expected a weight above 0 of at least one point, found 0 of all")
    return np.where(weights > 0.0, np.maximum(weights / weights.max(), LEAST_WEIGHT), 0.0)
