"""Who works on the parts of a cloud: threads of this process, other processes, or an executor that is handed in."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from multiprocessing import get_context
from typing import Any

from gppcs.engine.extras import require_distributed
from gppcs.engine.threads import set_threads, work_alone
from gppcs.errors import ClusterError, ParameterError, shown
from gppcs.spatial.boxes import Each

TIMEOUT = "10s"  # For a Dask scheduler to answer, and for its first worker to be there.


@contextmanager
def each_by(executor: Executor | None, threads: int) -> Iterator[Each]:
    """Yield a function like `map` that works on several parts at once: in so many threads, or by an executor."""
    if executor is None:
        with ThreadPoolExecutor(threads, initializer=work_alone) as own:
            try:
                # A single part is worked on in this thread, which has helpers.
                yield lambda task, parts: own.map(task, parts) if len(parts) > 1 else map(task, parts)
            except BaseException:
                own.shutdown(cancel_futures=True)
                raise
        return
    if not isinstance(executor, Executor):
        raise ParameterError(f"expected an executor with `map`, such as client.get_executor(), found {shown(executor)}")
    with _told_of_lost_workers():
        yield lambda task, parts: executor.map(partial(_alone, task), parts)


def executor_of(workers: str | None) -> AbstractContextManager[Executor | None]:
    """Start so many processes, or find the workers of the scheduler at an address; None stands for no workers."""
    if workers is None:
        return nullcontext()
    if "://" in workers:
        return scheduler_at(workers)
    if not workers.isascii() or not workers.isdigit() or not int(workers):
        raise ParameterError(
            "expected --workers as a number from 1 on, or as the address of a Dask scheduler such as "
            f"tcp://10.0.0.5:8786, found {shown(workers)}"
        )
    return ProcessPoolExecutor(int(workers), get_context("spawn"))


@contextmanager
def scheduler_at(address: str) -> Iterator[Executor]:
    """Connect to the workers of a Dask scheduler."""
    distributed = require_distributed()
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # its tracebacks: we tell of lost workers in a line
    try:
        client = distributed.Client(address, timeout=TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(
            f"expected a Dask scheduler at {address}, found none that answers within {TIMEOUT}; "
            "start one by `dask scheduler`, or check the address"
        ) from error
    with client:
        _check_versions(client)
        yield client.get_executor(pure=False)


def _alone(function: Callable[[Any], Any], item: Any) -> Any:
    """Work on one part in one thread: the other cores work on other parts."""
    set_threads(1)
    return function(item)


@contextmanager
def _told_of_lost_workers() -> Iterator[None]:
    """Turn the errors of lost workers and schedulers into ours."""
    try:
        yield
    except BrokenProcessPool as error:
        raise ClusterError("a worker process ended at once; give each more memory, or start fewer") from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] != "distributed":
            raise
        raise ClusterError(
            f"the workers or their scheduler were lost ({type(error).__name__}: {error}); check them and start anew"
        ) from error


def _check_versions(client: Any) -> None:
    """Check that there are workers, and that all have this version of gppcs."""

    def version() -> str | None:  # a function in a function is sent as code, so it also runs where there is no gppcs
        from importlib import import_module, util

        return import_module("gppcs").__version__ if util.find_spec("gppcs") else None

    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except TimeoutError as error:
        raise ClusterError(
            f"expected at least one worker, found none within {TIMEOUT}; start some by `dask worker ADDRESS`"
        ) from error
    own = version()
    others = {address: found for address, found in sorted(client.run(version).items()) if found != own}
    if others:
        named = ", ".join(f"gppcs {found or 'not at all'} at {address}" for address, found in others.items())
        raise ClusterError(f"expected gppcs {own} at all workers, found {named}; install that version there")
