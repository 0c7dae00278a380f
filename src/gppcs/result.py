"""The class `Result`: a simplified cloud, and the forms in which it can be taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from gppcs.amounts.options import require
from gppcs.amounts.order import level_sizes
from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.clouds.objects import single_or_double
from gppcs.clouds.quantities import count_of
from gppcs.engine.arrays import Ints
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import in_words
from gppcs.errors import InputError, ParameterError, flag
from gppcs.methods import Feature, Method


@dataclass(frozen=True, eq=False)
class Result(ComparedByValue):
    """A simplified cloud, with the method and the times of the run.

    It can be used wherever a cloud can, as in `gppcs.evaluate(cloud, result)` and `gppcs.write("small.ply", result)`:
    `len(result)` is M, and `np.asarray(result)` is `result.points`.

    Attributes
    ----------
    indices : (M,) array, int64
        The indices of the kept points in the input: unique, in the order chosen, or that of the option `order`.
    cloud : PointCloud
        The kept points in that order, with all their attributes. If the method moves points, these are the moved ones.
    method : Method
        The method with all its parameters.
    seconds : mapping of str to float
        Wall time of each stage in seconds, in the order of the run. If kernels were compiled meanwhile, that time is in
        an entry of its own, `compilation`.
    diagnostics : mapping of str to float
        Figures that the method reports about its run, such as fitted hyperparameters.
    outliers : (n,) array, int64, or None
        The indices of the points that were dropped as outliers, ascending. None if none were looked for.
    ranks : (M,) array, int64
        The place of each kept point in the order chosen, whatever the option `order` is.
    is_ranking : bool
        Whether the first points chosen are a simplification to fewer points: if the method ranks its points, without
        quotas, and not all but repeats were kept.
    points_in : int
        Number of points among which was chosen: those of the input that were not dropped; 0 if that is not known.

    Examples
    --------
    >>> import gppcs
    >>> result = gppcs.simplify(gppcs.sample("sphere", n_points=1000), n_points=100, method="random")
    >>> isinstance(result, gppcs.Result)
    True
    >>> result.points.shape, len(result), str(result.method)
    ((100, 3), 100, 'random')
    """

    indices: Ints
    cloud: PointCloud
    method: Method
    seconds: Mapping[str, float]
    diagnostics: Mapping[str, float]
    outliers: Ints | None = None
    ranks: Ints = field(default_factory=lambda: np.empty(0, np.int64), repr=False, compare=False)
    is_ranking: bool = field(default=False, repr=False, compare=False)
    points_in: int = field(default=0, repr=False, compare=False)

    @property
    def points(self) -> NDArray[np.floating[Any]]:
        """The coordinates of the kept points, (M, 3): float32 if those of the input were, otherwise float64."""
        return single_or_double(self.cloud)

    @property
    def ranked(self) -> bool:
        """Whether the first points are a simplification to fewer points."""
        return self.is_ranking and bool((np.diff(self.ranks) > 0).all())

    def __len__(self) -> int:
        return len(self.indices)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False:
            raise ValueError("expected that a copy may be made of the points of a Result, found copy=False")
        return np.asarray(self.points, dtype)  # which are a copy

    def __repr__(self) -> str:
        return f"Result({len(self):,} points by {self.method} in {in_words(self.seconds)})"

    def prefix(self, n_points: int) -> Result:
        """Return the `n_points` most important points in the order of the result, a simplification to fewer points.

        Diagnostics and times are those of the whole run.

        Examples
        --------
        >>> result = gppcs.simplify(gppcs.sample("bracket", n_points=2000), n_points=200, method="fps")
        >>> len(result.prefix(50))
        50
        """
        count = count_of("n_points", n_points)
        if count > len(self):
            raise ParameterError(f"expected at most {len(self):,} points, as the result has, found {count:,}")
        self._require_ranking()
        if count == len(self):
            return self
        rows = np.flatnonzero(self.ranks < count)
        return replace(self, indices=self.indices[rows], cloud=self.cloud.take(rows), ranks=self.ranks[rows])

    def levels(self, sizes: str | Sequence[float | int | str]) -> list[Result]:
        """Return the most important points for each of several sizes, from coarse to fine.

        Sizes are fractions of the points among which was chosen, or numbers, such as "10%,3%,1%" or [500, 50]; of
        those that the result does not have, all its points are taken.

        Examples
        --------
        >>> result = gppcs.simplify(gppcs.sample("bracket", n_points=2000), ratio="10%", method="fps")
        >>> [len(level) for level in result.levels("10%,3%,1%")]
        [20, 60, 200]
        """
        return [self.prefix(count) for count in self._counts(sizes)]

    def with_attributes(
        self, *, index: bool = False, rank: bool = False, levels: str | Sequence[float | int | str] | None = None
    ) -> Result:
        """Return the result with further attributes of its points, which may be written to a file.

        They are `index`, that of each point in the input; `rank`, its place in the order of importance; and `level`,
        the number of the first of the `levels`, from coarse to fine, to which it belongs.

        Examples
        --------
        >>> result = gppcs.simplify(gppcs.sample("bracket", n_points=2000), n_points=200, method="fps")
        >>> result.with_attributes(rank=True, levels=[200, 50]).cloud.attributes["level"][[49, 50]].tolist()
        [0, 1]
        """
        attributes: dict[str, Any] = {"index": self.indices} if flag("index", index) else {}
        if flag("rank", rank):
            require(self.method, Feature.RANKING)
            attributes["rank"] = self.ranks.astype(np.uint32)
        if levels is not None:
            attributes["level"] = np.searchsorted(self._counts(levels), self.ranks, side="right").astype(np.uint8)
        return replace(self, cloud=_with_new(self.cloud, attributes)) if attributes else self

    def marked(self, cloud: CloudLike, name: str = "kept") -> PointCloud:
        """Return the input, a cloud of N points, with an attribute that is 1 for kept points and 0 for others.

        Examples
        --------
        >>> cloud = gppcs.sample("bracket", n_points=2000)
        >>> int(gppcs.simplify(cloud, n_points=200, method="fps").marked(cloud).attributes["kept"].sum())
        200
        """
        cloud = PointCloud.from_object(cloud)
        if self.method.moves_points or self.indices.max(initial=-1) >= len(cloud):
            raise InputError("expected the input, whose points were not moved, found another cloud or a moved one")
        is_kept = np.zeros(len(cloud), np.uint8)
        is_kept[self.indices] = 1
        return _with_new(cloud, {name: is_kept})

    def _require_ranking(self) -> None:
        """Check that the first points chosen are a simplification to fewer points."""
        require(self.method, Feature.RANKING)
        if not self.is_ranking:
            raise ParameterError(
                f"expected points in an order of importance, found none, as all points of {self.points_in:,} but "
                "repeats were kept, or numbers of some by quotas; ask for fewer, without quotas"
            )

    def _counts(self, levels: str | Sequence[float | int | str]) -> list[int]:
        """Return the number of points of each level, from coarse to fine."""
        self._require_ranking()
        n, kept = self.points_in, len(self)
        counts = [min(max(1, round(size * n if size < 1 else size)), kept) for size in level_sizes(levels)]
        n_keep = self.diagnostics.get("points_to_keep", 0)
        if counts[0] < n_keep:
            raise InputError(
                f"expected a coarsest level of at least {n_keep:,.0f} points, those to keep, found {counts[0]:,}"
            )
        return counts


class BatchResult(tuple[Result, ...]):
    """The results of several clouds, in their order.

    Examples
    --------
    >>> batch = np.random.default_rng(0).random((4, 500, 3))
    >>> results = gppcs.simplify_batch(batch, n_points=50, method="fps")
    >>> len(results), results.indices.shape, results.points.shape
    (4, (4, 50), (4, 50, 3))
    """

    @property
    def indices(self) -> Ints:
        """The indices of the kept points in their clouds, (B, M); an InputError if their numbers differ."""
        return self._stacked([result.indices for result in self])

    @property
    def points(self) -> NDArray[np.floating[Any]]:
        """The coordinates of the kept points, (B, M, 3); an InputError if their numbers differ."""
        return self._stacked([result.points for result in self])

    def _stacked(self, arrays: list[NDArray[Any]]) -> NDArray[Any]:
        if len(counts := {len(result) for result in self}) != 1:
            actual = ", ".join(map(str, sorted(counts))) or "no cloud"
            raise InputError(f"expected as many kept points of each cloud, found {actual}; take those of each result")
        return np.stack(arrays)


def _with_new(cloud: PointCloud, attributes: Mapping[str, Any]) -> PointCloud:
    """Return a cloud with attributes that it does not have yet."""
    for name in attributes:
        if name in cloud.attributes:
            raise InputError(f"expected a new attribute, found {name!r}, which the cloud has; choose another name")
    return replace(cloud, attributes={**cloud.attributes, **attributes})
