"""Runs a graph of tasks: on threads of this process, on an executor of the user, or on a cluster by Dask."""

import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from graphlib import TopologicalSorter
from typing import Any

from gppcs.engine.extras import require_distributed
from gppcs.engine.threads import on_one_thread, sharing_cores
from gppcs.errors import GppcsError

RETRIES = 3  # of a task whose worker is lost


@dataclass(frozen=True)
class Engine:
    """What runs tasks, several at once."""

    executor: Any  # of `concurrent.futures`, or a client of Dask

    def run(
        self,
        function: Callable[[Any], Any],
        arguments: Sequence[Any],
        after: Sequence[Sequence[int]] = (),
        on_progress: Callable[[int], None] = lambda n: None,
    ) -> list[Any]:
        """Call a function with each argument, after the calls with the earlier arguments of some numbers.

        Returns what the calls return, in the order of the arguments.
        """
        before = dict(enumerate(after or [()] * len(arguments)))
        task = Call(function, platform.node(), os.getpid(), own_version())
        if isinstance(self.executor, Executor):
            return self._run_in_order(task, arguments, before, on_progress)
        from distributed import as_completed

        shared = self.executor.submit(copy, task, pure=False, retries=RETRIES)  # is sent once, and again if it is lost
        futures: dict[int, Any] = {}
        for number in TopologicalSorter(before).static_order():
            earlier = [futures[i] for i in before[number]]
            futures[number] = self.executor.submit(
                Call.__call__, shared, arguments[number], earlier, pure=False, retries=RETRIES
            )
        for _ in as_completed(list(futures.values()), with_results=True):  # type: ignore[no-untyped-call]
            on_progress(1)
        return self.executor.gather([futures[number] for number in range(len(arguments))])

    def _run_in_order(
        self,
        task: Callable[[Any], Any],
        arguments: Sequence[Any],
        before: Mapping[int, Sequence[int]],
        on_progress: Callable[[int], None],
    ) -> list[Any]:
        results: dict[int, Any] = {}
        running: dict[Future[Any], int] = {}
        graph = TopologicalSorter(before)
        graph.prepare()
        try:
            while graph.is_active():
                running |= {self.executor.submit(task, arguments[number]): number for number in graph.get_ready()}
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    results[number] = future.result()
                    graph.done(number)
                    on_progress(1)
        finally:  # after an error, no task may work on in folders that go
            for future in running:
                future.cancel()
            wait(running)
        return [results[number] for number in range(len(arguments))]


@dataclass(frozen=True)
class Call:
    """A function that is called with its share of the cores; another process works in one thread, as others do."""

    function: Callable[[Any], Any]
    node: str
    process: int
    version: str

    def __call__(self, argument: Any, earlier: object = None) -> Any:
        """Call the function."""
        if self.version != own_version():
            raise GppcsError(
                f"expected workers with gppcs {self.version}, found {own_version()}; install the same version"
            )
        if (self.node, self.process) == (platform.node(), os.getpid()):
            with sharing_cores():
                return self.function(argument)
        with on_one_thread():
            return self.function(argument)


@contextmanager
def engine(workers: str | Executor | None, threads: int) -> Iterator[Engine]:
    """Yield what runs tasks: so many threads, or the workers of the user."""
    try:
        if isinstance(workers, Executor):
            yield Engine(workers)
        elif workers is not None:
            with require_distributed().Client(workers) as client:
                yield Engine(client)
        else:
            with ThreadPoolExecutor(threads) as pool:
                yield Engine(pool)
    except Exception as error:
        if isinstance(error, BrokenExecutor) or type(error).__module__.startswith("distributed"):
            name = type(error).__name__
            raise GppcsError(
                f"the workers were lost ({name}: {error}); give each more memory, or start fewer"
            ) from error
        raise


def own_version() -> str:
    """Return the version of gppcs that runs."""
    version: str = sys.modules["gppcs"].__version__
    return version
