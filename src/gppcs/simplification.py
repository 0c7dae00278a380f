"""From a cloud as it came to one of exactly the size asked for: what all methods have in common."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.engine.stages import Stages
from gppcs.errors import InputError, ParameterError, whole_number
from gppcs.methods import DEFAULT, Method, Selection, method_named


@dataclass(frozen=True)
class Result:
    """A simplified cloud and how it came about.

    Attributes
    ----------
    indices : (M,) array, int64
        The rows of the input that were chosen: unique, in the order chosen.
    cloud : PointCloud
        Those points, in that order, with every attribute; a method that moves points puts them where it moved them.
    method : Method
        The method with all its parameters.
    seconds : mapping of stage to float
        Wall time, in the order the stages were run.
    diagnostics : mapping of name to float
        What the method found out on the way.
    """

    indices: NDArray[np.int64]
    cloud: PointCloud
    method: Method
    seconds: Mapping[str, float]
    diagnostics: Mapping[str, float]

    def __repr__(self) -> str:
        return f"Result({len(self.indices):,} points by {self.method.label} in {sum(self.seconds.values()):.3g} s)"


def simplify(
    cloud: PointCloud | ArrayLike,
    *,
    ratio: float | None = None,
    n_points: int | None = None,
    method: str | Method = DEFAULT,
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    normals: bool = False,
    scores: bool = False,
    stages: Stages | None = None,
) -> Result:
    """Choose exactly M points of a cloud.

    Parameters
    ----------
    cloud : PointCloud or (N, 3) array-like
        Never changed. Points that repeat an earlier one exactly count as points, but are chosen last.
    ratio : float
        M as a share of the points, above 0 and at most 1; M is rounded, and at least 1.
    n_points : int
        M itself; where the cloud has no more points, all are returned, in their order. Exactly one of `ratio`
        and `n_points` must be given.
    method : str or Method
        A name from `gppcs.METHODS`, or a method with parameters of its own.
    seed : int, optional
        In place of the method's seed; methods without chance take no notice.
    invalid : "error" or "drop"
        What to do where coordinates are NaN or infinite.
    normals : bool
        Whether the points kept are to carry the normals `nx`, `ny`, `nz` that `gppcs.estimate_normals` finds for them
        in the whole cloud, in place of any that they had. A surface rebuilt with these lies closer to the original
        than one with normals estimated from the points kept alone.
    scores : bool
        Whether the points kept are to carry what the method found out about each, its `attributes`; zero for points
        that it did not have to choose, such as repeats.
    stages : Stages, optional
        Times the stages; one with a listener tells it of their progress.

    Returns
    -------
    Result
        The same for the same input, whatever the number of threads, and for points moved or scaled by numbers
        that leave their differences what they were.

    Raises
    ------
    InputError
        If the cloud is empty, misshapen or has coordinates that are not finite.
    ParameterError
        If a parameter is out of its range.
    """
    from gppcs.spatial.scaling import normalised

    stages = stages or Stages()
    with stages("preparation"):
        cloud = PointCloud.of(cloud)
        chosen_method = method_named(method) if isinstance(method, str) else method
        if not isinstance(chosen_method, Method):
            raise ParameterError(f"expected the name of a method or a method such as SpectralGP(), found {method!r}")
        if scores and not chosen_method.attributes:
            raise ParameterError(f"method {chosen_method.name!r} gives its points no scores")
        if scores and (taken := sorted(set(chosen_method.attributes) & set(cloud.attributes))):
            raise InputError(
                f"the cloud has an attribute {taken[0]!r} already, which scores would replace: do without scores"
            )
        if seed is not None and any(field.name == "seed" for field in dataclasses.fields(chosen_method)):
            chosen_method = chosen_method.replaced({"seed": seed})
        rows = _usable_rows(cloud, invalid)
        count = _target(len(cloud) if rows is None else len(rows), ratio, n_points)
        points, corner, exponent = normalised(cloud.points if rows is None else cloud.points[rows])
    selection = _choose(points, count, chosen_method, stages)
    indices = selection.indices if rows is None else rows[selection.indices]
    kept = cloud.take(indices)
    if selection.points is not None:
        kept = _moved(kept, np.ldexp(selection.points, exponent) + corner)
    if normals:
        with stages("normals"):
            kept = _with_normals(kept, points, selection)
    if scores:
        kept = _with_scores(kept, chosen_method, selection)
    return Result(indices, kept, chosen_method, stages.seconds, selection.diagnostics)


def _moved(cloud: PointCloud, points: NDArray[np.float64]) -> PointCloud:
    """Return the cloud with its points elsewhere; whole numbers cannot hold the new coordinates."""
    kept = cloud.coordinate_dtype if np.issubdtype(cloud.coordinate_dtype, np.floating) else np.dtype(np.float64)
    return dataclasses.replace(cloud, points=points, coordinate_dtype=kept)


def _with_normals(kept: PointCloud, points: NDArray[np.float64], selection: Selection) -> PointCloud:
    """Return the points kept with the normals of the whole cloud where they are."""
    from gppcs.surface.normals import estimate_normals

    places = points[selection.indices] if selection.points is None else selection.points
    columns = np.ascontiguousarray(estimate_normals(points, places).T, dtype=np.float32)
    carried = dict(zip(NORMALS, columns, strict=True))
    return dataclasses.replace(kept, attributes={**kept.attributes, **carried})


def _with_scores(kept: PointCloud, method: Method, selection: Selection) -> PointCloud:
    """Return the points kept with the method's attributes."""
    carried = {name: np.zeros(len(kept), dtype=np.float32) for name in method.attributes}
    for name, values in selection.attributes.items():
        carried[name][:] = values
    return dataclasses.replace(kept, attributes={**kept.attributes, **carried})


def _choose(points: NDArray[np.float64], count: int, method: Method, stages: Stages) -> Selection:
    """Let the method choose among points without repeats; add repeats only where these do not suffice."""
    if count >= len(points):
        return Selection(np.arange(len(points)))
    from gppcs.spatial.cells import first_occurrences

    with stages("repeats"):
        first = first_occurrences(points)
        distinct = None if first.all() else np.flatnonzero(first)
    if distinct is None:
        return method(points, count, stages)
    if count >= len(distinct):
        return Selection(np.concatenate([distinct, np.flatnonzero(~first)[: count - len(distinct)]]))
    selection = method(points[distinct], count, stages)
    return dataclasses.replace(selection, indices=distinct[selection.indices])


def _usable_rows(cloud: PointCloud, invalid: str) -> NDArray[np.int64] | None:
    """Return the rows with finite coordinates, None if all have; refuse the others, unless they are to be dropped."""
    from gppcs.spatial.scaling import bounds

    if invalid not in ("error", "drop"):
        raise ParameterError(f"expected invalid to be 'error' or 'drop', found {invalid!r}")
    if len(cloud) == 0:
        raise InputError("the cloud is empty: expected at least one point")
    if np.isfinite(bounds(cloud.points)).all():
        return None
    bad = cloud.non_finite()
    if invalid == "error":
        raise InputError(
            f"{len(bad)} of {len(cloud)} points have coordinates that are NaN or infinite, the first at index "
            f"{bad[0]}; drop them with --invalid drop (invalid='drop')"
        )
    if len(bad) == len(cloud):
        raise InputError(f"none of the {len(cloud)} points has finite coordinates")
    return cloud.finite_rows()


def _target(n: int, ratio: float | None, n_points: int | None) -> int:
    """Return M."""
    if (ratio is None) == (n_points is None):
        found = "neither" if ratio is None else "both"
        raise ParameterError(f"expected either a ratio or a number of points, found {found}")
    if ratio is not None:
        try:
            inside = 0 < ratio <= 1
        except TypeError:
            inside = False
        if not inside:
            raise ParameterError(f"expected a ratio above 0 and at most 1, found {ratio!r}")
        return max(1, round(ratio * n))
    return min(whole_number("the number of points", n_points, 1), n)
