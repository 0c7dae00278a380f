"""The error of several methods over the number of points."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Literal

from gppcs.amounts.curve import Curve, checked_sizes, measured_curve, usual_sizes
from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.engine.timer import Timer, timer_of
from gppcs.evaluation.comparison import checked_methods
from gppcs.methods import DEFAULT, Method
from gppcs.simplification import Result, simplify

Run = Callable[..., Result]


def curve(
    cloud: CloudLike,
    methods: Iterable[str | Method] = (DEFAULT.name,),
    *,
    sizes: Sequence[float] | None = None,
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    timer: Timer | None = None,
) -> list[Curve]:
    """Measure the error of methods over the number of points that they keep.

    The sizes of a method that ranks its points are the first points of one ranking. Other methods run once for each
    size.

    Parameters
    ----------
    cloud : PointCloud, (N, 3) array-like, path or object that `PointCloud.of` takes
        The original.
    methods : iterable of str or Method
        Names from `gppcs.METHODS`, or methods with other parameters.
    sizes : sequence of float or int, optional
        Numbers of points, and shares of them below 1. By default, from a thousandth to a fifth of the points.
    seed, invalid, timer
        As for `gppcs.simplify`.

    Returns
    -------
    list of Curve
        One for each method, in their order.

    Raises
    ------
    InputError
        If the cloud is empty, malformed or not finite.
    ParameterError
        If a method does not exist, or a size is none.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> fps, random = gppcs.curve(cloud, ["fps", "random"], sizes=[0.05, 0.1])
    >>> (fps.errors["mean"] < random.errors["mean"]).all()
    np.True_
    """
    chosen = checked_methods(methods, None, 1, seed)
    timer = timer_of(timer)
    original = simplify(PointCloud.of(cloud), ratio=1, invalid=invalid).cloud  # without dropped points
    wanted = usual_sizes(len(original)) if sizes is None else checked_sizes(sizes, len(original))
    made = []
    for method in chosen:
        run = partial(simplify, original, method=method, timer=timer)
        rankings: list[Result] = []  # none, where all points but repeats are kept

        def kept(m: int, run: Run = run, rankings: list[Result] = rankings) -> PointCloud:
            result = rankings[0].prefix(m) if rankings else run(n_points=m)
            if result.ranked and not rankings:
                rankings.append(result)
            return result.cloud

        made.append(measured_curve(original, method, wanted, kept, timer))
    return made
