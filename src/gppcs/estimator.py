"""A transformer of scikit-learn that simplifies clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from gppcs.clouds.columns import unmasked
from gppcs.engine.extras import require_sklearn
from gppcs.methods import DEFAULT
from gppcs.simplification import simplify

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gppcs.methods import Method

try:
    from sklearn.base import BaseEstimator, TransformerMixin
    from sklearn.utils.validation import check_is_fitted, validate_data

    class _Transformer(TransformerMixin, BaseEstimator):  # type: ignore[misc]
        pass
except ImportError:  # then the class can be seen, such as by `help(gppcs)`, and its use says what is missing
    _Transformer = object  # type: ignore[assignment, misc]


class Simplifier(_Transformer):
    """A transformer of scikit-learn (extra `sklearn`) that keeps the rows of a table that simplify a cloud.

    Rows are points. The first three columns are coordinates; missing ones count as 0. Other columns go along.
    `transform` returns fewer rows than it gets, in the order chosen: it suits a pipeline without targets. So it cannot
    pass those of scikit-learn's checks that ask for each row again: `check_transformer_general`,
    `check_transformer_data_not_an_array`, `check_methods_sample_order_invariance`, `check_methods_subset_invariance`.

    Parameters
    ----------
    n_points : int or str, optional
        How many points to keep, as for `gppcs.simplify`. Give it or `ratio`.
    ratio : float or str, optional
        Which share of the points to keep, as for `gppcs.simplify`.
    method : str or Method
        A name from `gppcs.METHODS`, or an instance of a method with your own parameters.

    Attributes
    ----------
    indices_ : (M,) array, int64
        The rows that were kept of the table given to `fit`, most important first.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.

    Examples
    --------
    >>> table = gppcs.sample("bracket", n_points=2000).points
    >>> from gppcs.estimator import Simplifier
    >>> Simplifier(n_points=100, method="fps").fit_transform(table).shape
    (100, 3)
    """

    def __init__(
        self,
        n_points: int | str | None = None,
        *,
        ratio: float | str | None = None,
        method: str | Method = DEFAULT.name,
    ) -> None:
        require_sklearn()
        self.n_points, self.ratio, self.method = n_points, ratio, method

    def fit(self, X: ArrayLike, y: None = None) -> Self:
        """Choose the rows of a table, (N, k)."""
        self.fit_transform(X)
        return self

    def fit_transform(self, X: ArrayLike, y: None = None) -> NDArray[np.floating]:
        """Simplify a table, (N, k), once, and keep its `indices_`; return what `transform` does."""
        self.indices_, kept = self._simplified(X, first=True)
        return kept

    def transform(self, X: ArrayLike) -> NDArray[np.floating]:
        """Return the rows, (M, k), that are kept of a table (N, k), with new coordinates if the method moves points."""
        check_is_fitted(self)
        return self._simplified(X, first=False)[1]

    def _simplified(self, X: ArrayLike, first: bool) -> tuple[NDArray[np.int64], NDArray[np.floating]]:
        """Return the rows that are kept of a table, and what they hold."""
        unmasked_table = unmasked(X) if isinstance(X, np.ma.MaskedArray) else X
        table = validate_data(self, unmasked_table, dtype=[np.float64, np.float32], reset=first)
        columns = min(table.shape[1], 3)
        points = np.pad(table[:, :columns], ((0, 0), (0, 3 - columns)))
        result = simplify(points, n_points=self.n_points, ratio=self.ratio, method=self.method)
        kept = table[result.indices]
        kept[:, :columns] = result.cloud.points[:, :columns]
        return result.indices, kept

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.transformer_tags.preserves_dtype = ["float64", "float32"]
        return tags
