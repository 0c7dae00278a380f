"""The class `Constraints`: what users require of single points, of a cloud in memory or of a chunk of one in files."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.amounts.options import Options
from gppcs.amounts.quotas import quota_labels
from gppcs.clouds.cloud import PointCloud, array_of
from gppcs.clouds.expressions import Expression
from gppcs.clouds.lookup import as_floats, check_named, numbers_in
from gppcs.clouds.ranges import columns_of_detail
from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.errors import InputError, ParameterError, shown

MINIMUM_WEIGHT = 1e-4  # Relative to the largest. Smaller ones count as this: wider spacings would only take time.


@dataclass(frozen=True, eq=False)
class Constraints:
    """What the options require of n points. Methods that only choose a number of points need not know of them."""

    # (K,), ascending: indices of the points that are kept whatever happens.
    keep: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    # (n,), as the user gives them: points of weight 0 are kept only if they are in `keep`.
    weights: Floats | None = None
    # (n, ...), the attributes that count as detail, or that the method reads.
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    labels: NDArray[np.uint8] | None = None  # (n,), the quota of each point; see `quota_labels`

    @classmethod
    def from_cloud(cls, cloud: PointCloud, indices: Ints, options: Options) -> Self:
        """Look up what the options require of the points of a cloud at some indices, (n,)."""
        mask = _keep_mask(cloud, options.keep)
        keep = mask[indices]
        if n_dropped := np.count_nonzero(mask) - np.count_nonzero(keep):
            warnings.warn(f"{n_dropped:,} of the points to keep are dropped: outliers or not finite", stacklevel=2)
        weights, labels, usable = None, None, indices
        if options.weight is not None:
            weights = _weights(cloud, options.weight)[indices]
            _check_weights(weights)
            usable = indices[keep | (weights > 0.0)]
        columns = {name: values[indices] for name, values in required_columns(cloud, options).items()}
        if options.quotas:
            labels = quota_labels(cloud, usable, options.quotas)[indices]
        return cls(np.flatnonzero(keep), weights, columns, labels)

    def usable(self, n: int) -> Ints:
        """Return the indices, ascending, of those of the n points that may be kept."""
        if self.weights is None:
            return np.arange(n)
        mask = self.weights > 0.0
        mask[self.keep] = True
        return np.flatnonzero(mask)

    def n_usable(self, n: int) -> int:
        """Return how many of the n points may be kept."""
        return n if self.weights is None else len(self.usable(n))

    @property
    def max_weight(self) -> float:
        """The largest of the weights; 0 without any."""
        return 0.0 if self.weights is None else float(self.weights.max(initial=0.0))


def _check_weights(weights: Floats) -> None:
    """Check that weights, (n,), are finite and not negative."""
    bad = np.flatnonzero(~((weights >= 0.0) & np.isfinite(weights)))
    if len(bad):
        raise InputError(
            f"expected finite weights from 0 on, found {weights[bad[0]]:g} and {len(bad) - 1:,} more that are not"
        )


def relative_weights(weights: Floats) -> Floats:
    """Return weights, (n,), relative to the largest, 0 or at least `MINIMUM_WEIGHT`."""
    return np.where(weights > 0.0, np.maximum(weights / weights.max(initial=0.0), MINIMUM_WEIGHT), 0.0)


def check_constraints(options: Options, n_keep: int, max_weight: float) -> None:
    """Check that the condition of points to keep is met, and that there are positive weights."""
    if isinstance(options.keep, str) and not n_keep:
        raise InputError(
            f"expected points with {options.keep.strip()} to keep, found none; change the condition or omit `keep`"
        )
    if options.weight is not None and not max_weight:
        raise InputError("expected at least one weight above 0, found only 0")


def check_finite(n: int, n_bad: int, first_bad: int, invalid: str) -> None:
    """Check that a cloud has points, and that those that are not finite may be dropped."""
    if n == 0:
        raise InputError("the cloud is empty: expected at least one point")
    if n_bad and invalid == "error":
        raise InputError(
            f"{n_bad} of {n} points have coordinates that are NaN or infinite, the first at index {first_bad}; drop "
            "them with `invalid='drop'`"
        )
    if n_bad == n:
        raise InputError(f"none of the {n} points has finite coordinates")


def required_columns(cloud: PointCloud, options: Options) -> dict[str, NDArray[Any]]:
    """Return the attributes that count as detail or that the method reads, with their types, (N, ...)."""
    names = columns_of_detail(cloud, options.details)
    attribute = options.algorithm.reads_attribute
    if attribute is not None:
        check_named(attribute, cloud.attributes, "to choose points by")
        names.append(attribute)
    return {name: cloud.attributes[name] for name in names}


def _keep_mask(cloud: PointCloud, keep: Any) -> Flags:
    """Return which points, (N,), are to be kept."""
    if keep is None:
        return np.zeros(len(cloud), dtype=np.bool_)
    return Expression.from_text(keep).mask(cloud) if isinstance(keep, str) else mask_of(keep, len(cloud))


def mask_of(keep: ArrayLike, n: int) -> Flags:
    """Return which of n points are to be kept, (n,), by a mask or indices."""
    expected = f"keep to be a condition, a mask of the {n:,} points, or indices"
    values = array_of(keep, expected)
    if values.dtype == np.bool_ and values.shape == (n,):
        return values
    if values.ndim != 1 or not (np.issubdtype(values.dtype, np.integer) or values.size == 0):
        raise ParameterError(f"expected {expected}, found {shown(keep)}")
    outside = (values < 0) | (values >= n)
    if outside.any():
        raise ParameterError(f"expected {expected} from 0 to {n - 1}, found {values[outside][0]}")
    mask = np.zeros(n, dtype=np.bool_)
    mask[values.astype(np.int64)] = True
    return mask


def _weights(cloud: PointCloud, weight: Any) -> Floats:
    """Return the weight of each point, (N,)."""
    if not isinstance(weight, str):
        return weights_of(weight, len(cloud))
    if weight in cloud.attributes:
        return numbers_in(cloud, weight, "to weigh its points by")
    return Expression.from_text(weight).numbers(cloud)


def weights_of(weight: ArrayLike, n: int) -> Floats:
    """Return the weight of each of n points, (n,)."""
    expected = f"weight to be an attribute, or a number for each of the {n:,} points"
    values = array_of(weight, expected)
    if values.shape != (n,) or values.dtype.kind not in "biuf":
        raise ParameterError(f"expected {expected}, found {shown(weight)}")
    return as_floats(values)
