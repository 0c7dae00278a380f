"""The plan for what is asked for, also if only the points tell how many are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from gppcs.amounts import accuracy
from gppcs.amounts.guide import ChunkGuide
from gppcs.clouds.expressions import Expression
from gppcs.clouds.lengths import Length, metres_of
from gppcs.engine.stages import Stages
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods import Method
from gppcs.simplification import takes_all_points
from gppcs.streaming.cluster import Cluster
from gppcs.streaming.outliers import OutlierSearch
from gppcs.streaming.passes import Accuracy, count_in_passes
from gppcs.streaming.plan import FEWEST_ROWS, Besides, Plan, default_limit, plan

GUESS = 0.1  # Share of the points that are kept, if only the work tells their number.


class Planned(NamedTuple):
    """What `plan_for` returns.

    Attributes
    ----------
    plan : Plan
    options : dict
        Arguments of `simplify_in_passes` that say how many points are kept, and which.
    """

    plan: Plan
    options: dict[str, Any]


def plan_for(
    files: CloudFiles,
    method: Method,
    asked: Mapping[str, Any],
    limit: int | None,
    whole: str | None,
    cluster: Cluster | None,
    stages: Stages,
    search: OutlierSearch | None = None,
) -> Planned:
    """Decide how a cloud is simplified. If that takes it, count in passes over the files how many points are kept.

    Parameters
    ----------
    files : CloudFiles
    method : Method
    asked : mapping of str to object
        At least the arguments of `gppcs.simplify` that say what is kept, `measure`, `unit` and `invalid`.
    limit : int, optional
        Bytes of memory that the process may hold; by default half of what is free.
    whole : str, optional
        What needs all points in memory besides the method and the arguments, as messages name it.
    cluster : Cluster, optional
        Where to work.
    stages : Stages
        Times the passes.
    search : OutlierSearch, optional
        If it is given, the outliers that it finds are left out.

    Returns
    -------
    Planned

    Raises
    ------
    ClusterError, FileFormatError, InputError, OSError, ParameterError
        As for `simplify_files`.
    """
    _check_asked(files, asked)
    allowed, limit = limit, limit or default_limit()  # what is free changes while this works
    wanted = {name: asked[name] for name in ("ratio", "n_points", "keep", "weight")}
    besides = Besides(
        keep=asked["keep"] is not None,
        weights=asked["weight"] is not None,
        gaps=asked["max_gap"] is not None,
        accuracy=asked["tolerance"] is not None,
        outliers=search is not None,
    )

    def made(share: float | None, count: int | None) -> Plan:
        return plan(files, method, share, count, limit, whole, cluster is not None, besides)

    whole = whole or takes_all_points(method, asked)
    counted = wanted["ratio"] is not None or wanted["n_points"] is not None
    try:
        first = made(wanted["ratio"], wanted["n_points"]) if counted else made(GUESS, None)
        if whole or first.in_memory:
            return Planned(first, {})
    except InputError:  # if only the work tells the number of points, it may be smaller
        if whole or counted or (besides.accuracy and files.head().whole):
            raise
    metres = metres_of(asked["unit"], files.head().cloud.header)
    if asked["max_gap"] is not None:
        wanted |= {"max_gap": Length.of("max_gap", asked["max_gap"]), "metres": metres}
    if search is not None:
        wanted |= {"search": search}
    if counted:
        return Planned(first, wanted)
    if besides.accuracy:
        in_passes = partial(plan, files, method, None, limit=limit, shared=True, besides=besides)
        # Small chunks leave the most room for longer rankings.
        begun = replace(in_passes(accuracy.FIRST), rows=FEWEST_ROWS)
        measure: accuracy.Measure = asked["measure"] or "p95"
        most = _most_ranked(begun, in_passes)
        aim = Accuracy(Length.of("tolerance", asked["tolerance"]), measure, most, allowed)
        return Planned(begun, wanted | {"accuracy": aim, "metres": metres})
    count = count_in_passes(files, made(None, 1), method, asked, metres, stages, cluster, search)
    return Planned(made(None, count), wanted | {"n_points": count, "repeats": False})


def _check_asked(files: CloudFiles, asked: Mapping[str, Any]) -> None:
    """Check by the first points that the cloud has the attributes that are named, and the unit that lengths need."""
    keep, weight = (asked[name] if isinstance(asked[name], str) else None for name in ("keep", "weight"))
    lengths = [Length.of(name, asked[name]) for name in ("tolerance", "spacing", "max_gap") if asked[name] is not None]
    if keep is None and weight is None and not lengths:
        return
    cloud = files.head().cloud
    if len(cloud):
        ChunkGuide(None if keep is None else Expression.of(keep), weight).of_chunk(cloud)
    metres = metres_of(asked["unit"], cloud.header)
    for length in lengths:
        length.in_cloud(1.0, metres)


def _most_ranked(begun: Plan, in_passes: Callable[[int], Plan]) -> int:
    """Return how many points can be ranked, up to a fifth; `in_passes` raises an error if they are too many."""
    most, step = begun.kept, 2.0
    while step > 1.1:
        try:
            more = min(math.ceil(most * step), begun.points)
            in_passes(more)
        except InputError:
            step **= 0.5
            continue
        if more == most:
            break
        most = more
    return most
