"""The options of files that may be larger than memory, and what `--dry-run` prints."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs.app import panels
from gppcs.errors import ParameterError

if TYPE_CHECKING:
    from gppcs.streaming.cluster import Cluster
    from gppcs.streaming.plan import Plan

Merge = Annotated[
    bool,
    typer.Option(
        "--merge",
        help="Take all inputs as one cloud, in the order in which they are given.",
        rich_help_panel=panels.INPUT,
    ),
]
AssumeSameCrs = Annotated[
    bool,
    typer.Option(
        "--assume-same-crs",
        help="If several files are one cloud, give all of them the coordinate system of the first file. Without this "
        "option, files with different coordinate systems are an error.",
        rich_help_panel=panels.INPUT,
    ),
]
Memory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="How much memory to use, such as 2GB; half of what is free by default. A larger cloud is read in several "
        "passes (method gp), to the same result; and if more points are kept than these can hold, in tiles.",
        rich_help_panel=panels.LARGE,
    ),
]
Scratch = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Existing folder for the temporary files of tiles and outliers; by default that of the system.",
        rich_help_panel=panels.LARGE,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        metavar="COUNT",
        min=1,
        help="Share the work among this many processes of this machine (needs Dask). Each takes one file, or a part of "
        "one, at a time.",
        rich_help_panel=panels.LARGE,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Work on the workers of a Dask scheduler, such as tcp://10.0.0.5:8786.",
        rich_help_panel=panels.LARGE,
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="If the work in passes or tiles is interrupted, keep what is done in the folder of --scratch; go on from "
        "what an interrupted run kept.",
        rich_help_panel=panels.LARGE,
    ),
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help="Print what would be done, in how much memory and about how long, and do nothing.",
        rich_help_panel=panels.LARGE,
    ),
]


@contextmanager
def cluster_of(workers: int | None, scheduler: str | None) -> Iterator[Cluster | None]:
    """Start or find the workers that the options name.

    Parameters
    ----------
    workers : int or None
    scheduler : str or None

    Yields
    ------
    Cluster or None
        None if neither is given.

    Raises
    ------
    ClusterError
        If they cannot be used.
    MissingExtraError
        If Dask is not installed.
    ParameterError
        If both are given.
    """
    from gppcs.streaming.cluster import local_cluster, scheduler_at

    if workers is not None and scheduler is not None:
        raise ParameterError("expected either --workers or --scheduler, found both")
    if workers is not None:
        with local_cluster(workers) as cluster:
            yield cluster
    elif scheduler is not None:
        with scheduler_at(scheduler) as cluster:
            yield cluster
    else:
        yield None


def plan_record(plan: Plan, seconds: float | None) -> dict[str, Any]:
    """Return a plan as the record that `--json` prints.

    Parameters
    ----------
    plan : Plan
    seconds : float or None
        How long it takes, if that is known.

    Returns
    -------
    dict of str to value
    """
    return {
        "points_in": plan.points,
        "points_out": plan.kept,
        "way": plan.way.value,
        "in_memory": plan.in_memory,
        "passes": plan.passes,
        "memory": plan.memory,
        "memory_limit": plan.limit,
        "disk": plan.disk,
        "seconds": seconds,
    }


def print_plan(sources: list[Path], target: Path, plan: Plan, seconds: float | None) -> None:
    """Print a plan as a table.

    Parameters
    ----------
    sources : list of path
    target : path
    plan : Plan
    seconds : float or None
        How long it takes, if that is known.
    """
    from gppcs.app.console import print_table
    from gppcs.streaming.sizes import size_of

    limit = "unknown" if plan.limit is None else size_of(plan.limit)
    print_table(
        f"{titled(sources)} → {target}: nothing is done",
        {
            "points": f"about {plan.points:,} in, {plan.kept:,} out",
            "way": _way(plan),
            "memory": f"about {size_of(plan.memory)}, of {limit} allowed",
            **({"temporary files": f"about {size_of(plan.disk)}"} if plan.disk else {}),
            "time": "unknown for this method" if seconds is None else f"about {_duration(seconds)}",
        },
    )


def _way(plan: Plan) -> str:
    from gppcs.streaming.plan import Way

    return {
        Way.MEMORY: "in memory",
        Way.PASSES: f"in {plan.passes} passes over the files, or a few more",
        Way.TILES: f"in {plan.passes} passes over the files, and in tiles on disk",
    }[plan.way]


def titled(sources: list[Path]) -> str:
    """Return the inputs of a run in a few words.

    Parameters
    ----------
    sources : list of path

    Returns
    -------
    str
    """
    return str(sources[0]) if len(sources) == 1 else f"{sources[0]} and {len(sources) - 1} more"


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
