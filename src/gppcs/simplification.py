"""Simplify a cloud to the points asked for: the steps that all methods share."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.amounts.choice import choose_amount
from gppcs.amounts.guide import Guide
from gppcs.amounts.request import Request, require
from gppcs.clouds.cloud import CloudLike, PointCloud, with_normals
from gppcs.clouds.quantities import Scale, count_of, metres_of
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import Timer, in_words, timer_of
from gppcs.errors import InputError, ParameterError, one_of
from gppcs.io.reading import as_cloud
from gppcs.methods import DEFAULT, Feature, Method, Selection
from gppcs.methods.method import SCORES


@dataclass(frozen=True, eq=False)
class Result(ComparedByValue):
    """A simplified cloud, with the method and the times of the run.

    Attributes
    ----------
    indices : (M,) array, int64
        The rows of the kept points in the input: unique, in the order chosen.
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
        The rows of the points that were left out as outliers, ascending. None if none were looked for.
    ranked : bool
        Whether the first points are a simplification to fewer points: if the method ranks its points, and not all but
        repeats were kept.

    Examples
    --------
    >>> import gppcs
    >>> result = gppcs.simplify(gppcs.sample("sphere", n_points=1000), n_points=100, method="random")
    >>> isinstance(result, gppcs.Result)
    True
    >>> result.indices.shape, len(result.cloud), str(result.method)
    ((100,), 100, 'random')
    """

    indices: NDArray[np.int64]
    cloud: PointCloud
    method: Method
    seconds: Mapping[str, float]
    diagnostics: Mapping[str, float]
    outliers: NDArray[np.int64] | None = None
    ranked: bool = field(default=True, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"Result({len(self.indices):,} points by {self.method} in {in_words(self.seconds)})"

    def prefix(self, n_points: int) -> Result:
        """Return the first points, which are a simplification to fewer points.

        Parameters
        ----------
        n_points : int
            From 1 to the number of points of the result.

        Returns
        -------
        Result
            With the diagnostics and times of the whole run.

        Raises
        ------
        ParameterError
            If the method does not rank its points, or there are fewer.

        Examples
        --------
        >>> result = gppcs.simplify(gppcs.sample("bracket", n_points=2000), n_points=200, method="fps")
        >>> len(result.prefix(50).cloud)
        50
        """
        count = count_of("n_points", n_points)
        if count > len(self.indices):
            raise ParameterError(f"expected at most {len(self.indices):,} points, as the result has, found {count:,}")
        self._require_ranking()
        return replace(self, indices=self.indices[:count], cloud=self.cloud.take(np.arange(count)))

    def _require_ranking(self) -> None:
        """Raise an error if the first points are no simplification."""
        require(self.method, Feature.RANKING)
        if not self.ranked:
            raise ParameterError("all points were kept, in the order of the cloud, which is no ranking; ask for fewer")


def simplify(
    cloud: CloudLike,
    *,
    ratio: float | str | None = None,
    n_points: int | str | None = None,
    tolerance: float | str | None = None,
    spacing: float | str | None = None,
    max_gap: float | str | None = None,
    unit: str | None = None,
    keep: str | ArrayLike | None = None,
    weight: str | ArrayLike | None = None,
    detail: str | Mapping[str, float] | None = None,
    quota: Mapping[str, float | str] | None = None,
    group: str | None = None,
    method: str | Method = DEFAULT,
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    normals: bool = False,
    scores: bool = False,
    drop_outliers: bool = False,
    denoise: bool = False,
    timer: Timer | None = None,
) -> Result:
    """Choose M points of a cloud: a number, or as many as an accuracy, a spacing or a largest gap takes.

    A length is a number in the unit of the coordinates, or a text: with a unit, such as "0.5mm", or a share of the
    diagonal of the bounding box, such as "0.02%".

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.from_object` takes
        The original points; they are not changed. A point that exactly repeats an earlier one counts as a point, but
        such points are chosen last.
    ratio : float or str, optional
        M / N, above 0 and at most 1, such as 0.03 or "3%". M is rounded, and is at least 1. Give one of `ratio`,
        `n_points`, `tolerance` and `spacing`, or `max_gap`.
    n_points : int or str, optional
        M, at least 1, such as 5000 or "5k". If the cloud has no more than M points, all are returned in their order.
    tolerance : length, optional
        The fewest points, up to 2 %, from whose local surface no original point is farther than this. Outliers, as
        `gppcs.find_outliers` finds them, do not count. The points are the first ones of a ranking, if the method ranks
        its points. The diagnostics tell the `largest_error`, and how many `points_set_aside` there are. A text such as
        "2mm:p95" bounds another error of all points instead: ":mean", ":rms", ":p95" (95 % of the points are as near)
        or ":max", the figures `surface_mean` to `surface_max` of `gppcs.Report`.
    spacing : length, optional
        As many points as have this spacing. What that means, `gppcs.METHODS[name].supports` says: for "gp" the mean
        spacing on the measured surface.
    max_gap : length, optional
        Then points are added, each the farthest from all others, until no original point is farther than this from a
        kept one. Without any other amount, as many points are chosen before as an even cover would need.
    unit : str, optional
        In which unit the coordinates are: "m", "mm", "ft" and so on. A length with a unit needs it, unless the
        coordinate system of the cloud tells.
    keep : str, (N,) array-like of bool, or array-like of int, optional
        Points that are kept whatever happens: a condition such as "classification == 6", a mask or rows. They count in
        M and come first in the result. The others are chosen where these are not (method "gp").
    weight : str or (N,) array-like, optional
        Multiplies the density of the kept points: an attribute or a number for each point, finite and not negative. No
        point of weight 0 is kept, but those in `keep` (method "gp").
    detail : str or mapping of str to float, optional
        Attributes that count beside the shape, with their weights from 0 to 1000, such as {"rgb": 1, "intensity":
        0.5}; a name alone has the weight 1. "rgb" stands for red, green and blue. A change by the whole range counts as
        much as a sharp edge; noise of an attribute counts for nothing (method "gp").
    quota : mapping of str to int, float or str, optional
        How many of the kept points meet a condition: exact numbers such as {"classification == 6": 500}, or shares of
        the M kept points such as {"classification == 6": "10%"}. Points that meet no condition share the rest. No point
        may meet two (methods that rank their points).
    group : str, optional
        An attribute whose equal values make groups that are kept or dropped whole, such as "gps_time", the pulses of a
        laser; where there is a "scanner_channel", each channel has its own. M is then as near to the number asked for
        as whole groups allow. The diagnostics tell how many `groups` are kept (methods that rank their points).
    method : str or Method
        A name from `gppcs.METHODS`, or an instance of a method with your own parameters.
    seed : int, optional
        Replaces the seed of the method. Methods without a seed ignore it.
    invalid : "error" or "drop"
        What to do with points whose coordinates are NaN or infinite: raise an error, or leave them out.
    normals : bool
        Whether to add normals as attributes `nx`, `ny` and `nz`, replacing any that exist. They come from
        `gppcs.estimate_normals` on the whole cloud. A surface rebuilt with them lies closer to the
        original than a surface rebuilt with normals estimated from the kept points alone.
    scores : bool
        Whether to add the method's own `attributes` of each kept point. They are zero for points that the method did
        not choose itself, such as repeats.
    drop_outliers : bool
        Whether to leave out, before all else, the points that `gppcs.find_outliers` finds, also if they are in `keep`.
        They do not count in N. The result has their rows.
    denoise : bool
        Whether to move the kept points onto the surface that all points observe with noise: the same as the parameter
        `denoise` of the method. They have the attributes of the points at `indices`, but normals of that surface. Where
        no noise is found, they stay. It does not go with `tolerance`, `max_gap`, `keep`, `quota` and `group` (method
        "gp").
    timer : Timer, optional
        Measures the time of each stage, and reports progress to its listener.

    Returns
    -------
    Result
        The same input gives the same result, for any number of threads. So does a shifted or scaled input, if
        rounding does not change the differences of its coordinates.

    Raises
    ------
    InputError
        If the cloud is empty, has a wrong shape or has coordinates that are not finite; if `scores` would replace an
        attribute of the cloud; if `keep` means more than M points, or is a condition that none meets; if a weight is
        negative or not finite; or if a length has a unit and that of the cloud is not known.
    ParameterError
        If a parameter is outside its range, the method does not exist or cannot do what is asked for, or a condition
        cannot be read.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> gppcs.simplify(cloud, ratio=0.1, method="fps").indices.shape
    (200,)
    >>> gppcs.simplify(cloud, n_points=50, method=gppcs.Random(seed=7)).cloud.points.shape
    (50, 3)
    >>> painted = gppcs.simplify(cloud, n_points=50, detail="rgb")
    >>> fine = gppcs.simplify(cloud, tolerance="1%")
    >>> gppcs.evaluate(cloud, fine.cloud).surface_max <= 0.01 * gppcs.info(cloud).diagonal
    True
    """
    request = Request.of(
        ratio=ratio, n_points=n_points, tolerance=tolerance, spacing=spacing, max_gap=max_gap,
        unit=unit, keep=keep, weight=weight, detail=detail, quota=quota, group=group, method=method, seed=seed,
        invalid=invalid, normals=normals, scores=scores, drop_outliers=drop_outliers, denoise=denoise,
    )  # fmt: skip
    return simplify_cloud(cloud, request, timer_of(timer))


def result_of(
    selection: Selection, kept: PointCloud, method: Method, timer: Timer, outliers: NDArray[np.int64] | None
) -> Result:
    """Return the result of a run that kept some points, and left out outliers if some were looked for."""
    ranked = Feature.RANKING in method.supports and selection.ranked
    told = {} if outliers is None else {"outliers": float(len(outliers))}
    figures = {**selection.diagnostics, **told}
    return Result(selection.indices, kept, method, timer.seconds, figures, outliers, ranked)


def simplify_cloud(cloud: CloudLike, request: Request, timer: Timer) -> Result:
    """Simplify a cloud in memory."""
    from gppcs.spatial.scaling import Frame, bounds

    outliers, method = None, request.method
    with timer("preparation"):
        cloud = as_cloud(cloud)
        if request.scores:
            check_scores(cloud)
        points = cloud.points
        low, high = bounds(points)
        rows = None if np.isfinite([low, high]).all() else _finite_rows(cloud, request.invalid)
    if request.drop_outliers:
        from gppcs.surface.outliers import find_outliers

        with timer("outliers"):
            outliers = np.flatnonzero(find_outliers(cloud))
        if len(outliers):
            rows = np.setdiff1d(np.arange(len(cloud)) if rows is None else rows, outliers, assume_unique=True)
    with timer("preparation"):
        guide = Guide.of(cloud, rows, request) if request.guided else None
        if rows is not None:
            points = points[rows]
            low, high = bounds(points)
        frame = Frame.around(low, high)
        points = frame.local(points)
        diagonal = float(np.linalg.norm(frame.local(high[np.newaxis])))
        scale = Scale(diagonal, metres_of(request.unit, cloud.header), frame.exponent)
    selection = choose_amount(points, request.amount, scale, guide, method, timer)
    kept = cloud.take(selection.indices if rows is None else rows[selection.indices])
    if selection.points is not None:
        kept = kept.moved(np.ldexp(selection.points, frame.exponent) + frame.corner)
        if request.denoise:
            steps = np.ldexp(selection.points - points[selection.indices], frame.exponent)
            selection = _with_shifts(selection, steps)
    elif request.denoise:
        raise InputError(
            f"expected fewer points to keep than there are different ones with a weight above 0, found "
            f"{len(selection.indices)}: denoising fits the kept points to the others; keep fewer"
        )
    if selection.normals is not None and (own := kept.normals()) is not None:
        kept = with_normals(kept, _with_signs(selection.normals, own))
    if request.normals:
        with timer("normals"):
            kept = _with_estimated_normals(kept, points, selection)
    if request.scores:
        kept = with_scores(kept, selection)
    if rows is not None:
        selection = replace(selection, indices=rows[selection.indices])
    return result_of(selection, kept, method, timer, outliers)


def _with_estimated_normals(kept: PointCloud, points: NDArray[np.float64], selection: Selection) -> PointCloud:
    """Return the kept points with normals estimated in the whole cloud, `points`, (N, 3)."""
    from gppcs.surface.normals import estimate_normals

    places = points[selection.indices] if selection.points is None else selection.points
    estimated = estimate_normals(points, places)
    return with_normals(kept, estimated if selection.normals is None else _with_signs(selection.normals, estimated))


def _with_shifts(selection: Selection, steps: NDArray[np.float64]) -> Selection:
    """Return a selection that also tells how far its points have moved, given the steps, (M, 3)."""
    shifts = np.sqrt(np.einsum("ij,ij->i", steps, steps))
    found = {"moved_mean": float(shifts.mean()), "moved_largest": float(shifts.max())}
    return dataclasses.replace(selection, diagnostics={**selection.diagnostics, **found})


def _with_signs(normals: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return normals, (M, 3), with the signs of others, (M, 3)."""
    return np.where(np.einsum("ij,ij->i", normals, others)[:, None] < 0.0, -normals, normals)


def with_scores(kept: PointCloud, selection: Selection) -> PointCloud:
    """Return the kept points with the method's attributes."""
    carried = {name: np.zeros(len(kept), dtype=np.float32) for name in SCORES}
    for name, values in selection.attributes.items():
        carried[name][:] = values
    return dataclasses.replace(kept, attributes={**kept.attributes, **carried})


def check_scores(cloud: PointCloud) -> None:
    """Check that scores can be added to a cloud."""
    if taken := sorted(set(SCORES) & set(cloud.attributes)):
        raise InputError(
            f"the cloud already has an attribute {taken[0]!r}, which the scores would replace: "
            "rename it, or ask for no scores"
        )


def _finite_rows(cloud: PointCloud, invalid: str) -> NDArray[np.int64]:
    """Return the rows with finite coordinates; raise an error if there are none, or others that are not dropped."""
    bad = cloud.non_finite()
    check_usable(len(cloud), len(bad), int(bad[0]) if len(bad) else 0, invalid)
    return np.delete(np.arange(len(cloud)), bad)


def check_usable(n: int, bad: int, first: int, invalid: str) -> None:
    """Check that a cloud has points, and that those that are not finite may be dropped."""
    one_of("invalid", invalid, ("error", "drop"))
    if n == 0:
        raise InputError("the cloud is empty: expected at least one point")
    if bad and invalid == "error":
        found = f"{bad} of {n} points have coordinates that are NaN or infinite, the first at index {first}"
        raise InputError(f"{found}; drop them with invalid='drop'")
    if bad == n:
        raise InputError(f"none of the {n} points has finite coordinates")
