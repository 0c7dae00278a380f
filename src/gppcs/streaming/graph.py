"""Runs a graph of tasks: on threads of this process, on an executor of the user, or on a cluster by Dask."""

import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import Executor
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from functools import partial
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
        call: Any = Call(function, platform.node(), os.getpid(), own_version())
        wait: Any = futures.wait
        submit = self.executor.submit
        if not isinstance(self.executor, Executor):
            from distributed import wait

            submit = partial(submit, pure=False, retries=RETRIES)
            call = submit(copy, call)  # is sent once, and again if it is lost
        results, running = dict[int, Any](), dict[Any, int]()
        graph = TopologicalSorter(dict(enumerate(after or [()] * len(arguments))))
        graph.prepare()
        try:
            while graph.is_active():
                for number in graph.get_ready():
                    running[submit(Call.__call__, call, arguments[number])] = number
                for future in wait(list(running), return_when=futures.FIRST_COMPLETED).done:
                    number = running.pop(future)
                    results[number] = future.result()
                    graph.done(number)
                    on_progress(1)
        finally:  # after an error, no task may work on in folders that go
            if isinstance(self.executor, Executor):  # a client cancels its own when it is closed
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

    def __call__(self, argument: Any) -> Any:
        """Call the function."""
        if self.version != own_version():
            raise GppcsError(
                f"expected workers with gppcs {self.version}, found {own_version()}; install the same version"
            )
        is_own = (self.node, self.process) == (platform.node(), os.getpid())
        with sharing_cores() if is_own else on_one_thread():
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
            with futures.ThreadPoolExecutor(threads) as pool:
                yield Engine(pool)
    except Exception as error:
        is_lost = isinstance(error, futures.BrokenExecutor | futures.CancelledError)
        if is_lost or type(error).__module__.startswith("distributed"):
            name = type(error).__name__
            raise GppcsError(
                f"the workers were lost ({name}: {error}); give each more memory, or start fewer"
            ) from error
        raise


def own_version() -> str:
    """Return the version of gppcs that runs."""
    version: str = sys.modules["gppcs"].__version__
    return version
