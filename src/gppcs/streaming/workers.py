"""Who works on the parts of a cloud: threads of this process, other processes, or an executor of the user."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from typing import Any

from gppcs.engine.extras import require_distributed
from gppcs.engine.threads import set_threads, work_alone
from gppcs.errors import GppcsError
from gppcs.spatial.boxes import MapParts


@contextmanager
def map_over_parts(workers: int | str | Executor | None, threads: int) -> Iterator[MapParts]:
    """Yield a function like `map` that works on several parts at once: in so many threads, or by workers."""
    if workers is None:
        with ThreadPoolExecutor(threads, initializer=work_alone) as pool:
            try:
                # A single part is worked on in this thread, which has helpers.
                yield lambda task, parts: pool.map(task, parts) if len(parts) > 1 else map(task, parts)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
        return
    try:
        with _executor(workers) as executor:
            yield lambda task, parts: executor.map(partial(_in_one_thread, task), parts)
    except Exception as error:
        if isinstance(error, BrokenExecutor) or type(error).__module__.startswith("distributed"):
            name = type(error).__name__
            raise GppcsError(
                f"the workers were lost ({name}: {error}); give each more memory, or start fewer"
            ) from error
        raise


@contextmanager
def _executor(workers: int | str | Executor) -> Iterator[Executor]:
    """Yield an executor; one that is started here ends with the block."""
    if isinstance(workers, Executor):
        yield workers
    elif isinstance(workers, str) and "://" in workers:
        with require_distributed().Client(workers) as client:
            yield client.get_executor(pure=False)
    else:
        with ProcessPoolExecutor(int(workers), get_context("spawn")) as executor:
            yield executor


def _in_one_thread(function: Callable[[Any], Any], part: Any) -> Any:
    """Work on a part in one thread: the other cores work on other parts."""
    set_threads(1)
    return function(part)
