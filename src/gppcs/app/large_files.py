"""Large files: the workers that `--workers` names, and what `--dry-run` prints."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gppcs.errors import ParameterError, shown

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from gppcs.streaming.plan import Plan


def executor_of(workers: str | None) -> AbstractContextManager[Executor | None]:
    """Start or find the workers that the option names, if any."""
    from gppcs.streaming.workers import processes, scheduler_at

    if workers is None:
        return nullcontext()
    if "://" in workers:
        return scheduler_at(workers)
    if not workers.isascii() or not workers.isdigit() or not int(workers):
        raise ParameterError(
            "expected --workers as a number from 1 on, or as the address of a Dask scheduler such as "
            f"tcp://10.0.0.5:8786, found {shown(workers)}"
        )
    return processes(int(workers))


def plan_record(plan: Plan) -> dict[str, Any]:
    """Return a plan as the record that `--json` prints."""
    return {
        "points_in": plan.points,
        "points_out": plan.kept,
        "way": plan.way,
        "in_memory": plan.in_memory,
        "readings": plan.readings,
        "memory": plan.memory,
        "memory_limit": plan.limit,
        "disk": plan.disk,
    }


def print_plan(sources: list[Path], target: Path, plan: Plan) -> None:
    """Print a plan as a table."""
    from gppcs.app.console import print_table
    from gppcs.streaming.sizes import size_of

    limit = "unknown" if plan.limit is None else size_of(plan.limit)
    print_table(
        f"{titled(sources)} → {target}: nothing is done",
        {
            "points": f"{'' if plan.exact else 'about '}{plan.points:,} in, {plan.kept:,} out",
            "way": plan.way,
            "memory": f"about {size_of(plan.memory)}, of {limit} allowed",
            **({"temporary files": f"about {size_of(plan.disk)}"} if plan.disk else {}),
        },
    )


def titled(sources: list[Path]) -> str:
    """Return the inputs of a run in a few words."""
    return str(sources[0]) if len(sources) == 1 else f"{sources[0]} and {len(sources) - 1} more"
