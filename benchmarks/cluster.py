"""Measure what the passes over files cost on one worker of a cluster, and what they send.

The tasks of the workers run here one after another, on one thread. What they take and return is measured as it would be
sent.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import gppcs
import report
from gppcs.engine.stages import Stages
from gppcs.engine.threads import set_threads
from gppcs.io.cloud_files import CloudFiles
from gppcs.streaming.passes import simplify_in_passes
from gppcs.streaming.plan import Plan, Way
from tiles import side_by_side

FILES, POINTS = 10, 1_000_000  # Points of a file.
KEPT = 0.002
PASSES = {"_overview": "bounds", "_taken": "sample", "_greatest": "candidates", "_kept": "kept points"}


class Measured:
    """Does the tasks of a cluster in this process; notes seconds and bytes of each pass."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PASSES.values(), 0.0)
        self.to_workers = dict.fromkeys(PASSES.values(), 0)
        self.from_workers = dict.fromkeys(PASSES.values(), 0)
        self.between_workers = dict.fromkeys(PASSES.values(), 0)

    def each(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """As `Cluster.each`."""
        for item in items:
            yield self._done(function, item, self.from_workers)

    def merged(
        self,
        find: Callable[[Any], Any],
        items: Sequence[Any],
        merge: Callable[[Any, Any], Any],
        advanced: Callable[[], None],
    ) -> Any:
        """As `Cluster.merged`."""
        level = []
        for item in items:
            level.append(self._done(find, item, self.between_workers))
            advanced()
        while len(level) > 1:
            after = [merge(one, other) for one, other in zip(level[::2], level[1::2], strict=False)]
            self.between_workers[PASSES[find.__name__]] += sum(map(_size, after))
            level = after + level[len(level) & ~1 :]
        self.from_workers[PASSES[find.__name__]] += _size(level[0])
        return level[0]

    def _done(self, function: Callable[[Any], Any], item: Any, returned: dict[str, int]) -> Any:
        sent = pickle.dumps(item)
        start = perf_counter()
        result = function(pickle.loads(sent))
        self.seconds[PASSES[function.__name__]] += perf_counter() - start
        self.to_workers[PASSES[function.__name__]] += len(sent)
        returned[PASSES[function.__name__]] += _size(result)
        return result


def _size(value: Any) -> int:
    return len(pickle.dumps(value))


def written(folder: Path, suffix: str) -> list[Path]:
    """Write the files of a scene."""
    paths = [folder / f"{number}{suffix}" for number in range(FILES)]
    for number, path in enumerate(paths):
        points = np.round(side_by_side(POINTS, number)[0], 4)
        gppcs.write(path, gppcs.PointCloud(points, {"intensity": np.arange(len(points), dtype=np.uint16)}))
    return paths


def measured(paths: list[Path]) -> tuple[Measured, float]:
    """Return what a run costs, and the seconds of what the client does itself."""
    tasks, stages = Measured(), Stages()
    n = round(KEPT * FILES * POINTS)
    with CloudFiles(paths) as files:
        made = Plan(Way.PASSES, FILES * POINTS, n, 0, None, POINTS)
        simplify_in_passes(files, made, gppcs.LocalGP(), None, n, "error", False, stages, None, tasks)  # type: ignore[arg-type]
    return tasks, sum(stages.seconds.values()) - sum(tasks.seconds.values())


def main() -> None:
    """Write the table."""
    set_threads(1)
    rows, millions = [], FILES * POINTS / 1e6
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".ply", ".laz"):
            paths = written(Path(folder), suffix)
            measured(paths)  # compiles or loads the kernels
            tasks, client = measured(paths)
            for name in PASSES.values():
                sent = (tasks.to_workers, tasks.from_workers, tasks.between_workers)
                cells = [f"{each[name] / 1e6 / millions:.3f}" for each in sent]
                rows.append((suffix[1:].upper(), name, f"{tasks.seconds[name] / millions:.3f}", *cells))
            rows.append((suffix[1:].upper(), "in the client", f"{client / millions:.3f}", "", "", ""))
    report.write(
        "cluster",
        f"What the passes of gp cost on one thread, for each million points, {100 * KEPT:g} % of which are kept",
        (
            "format", "pass", "seconds", "MB from the client to workers", "MB from workers to the client",
            "MB between workers, at most",
        ),
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
