"""Who works on the parts of a cloud: threads of this process, or workers of the user."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

from gppcs.engine.extras import require_distributed
from gppcs.engine.threads import set_threads, sharing_cores
from gppcs.errors import GppcsError
from gppcs.spatial.boxes import MapParts


@contextmanager
def map_over_parts(workers: str | Executor | None, threads: int) -> Iterator[MapParts]:
    """Yield a function like `map` that works on several parts at once: in so many threads, or by workers."""
    try:
        with _executor(workers, threads) as executor:
            yield lambda task, parts: executor.map(partial(_worked_on, task, _this_process()), parts)
    except Exception as error:
        if isinstance(error, BrokenExecutor) or type(error).__module__.startswith("distributed"):
            name = type(error).__name__
            raise GppcsError(
                f"the workers were lost ({name}: {error}); give each more memory, or start fewer"
            ) from error
        raise


@contextmanager
def _executor(workers: str | Executor | None, threads: int) -> Iterator[Executor]:
    """Yield an executor; one that is started here ends with the block, and does no more after an error."""
    if isinstance(workers, Executor):
        yield workers
    elif workers is not None:
        with require_distributed().Client(workers) as client:
            yield client.get_executor(pure=False)
    else:
        with ThreadPoolExecutor(threads) as pool:
            try:
                yield pool
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _this_process() -> tuple[str, int]:
    """Return what tells this process from others, also from those of other machines."""
    return platform.node(), os.getpid()


def _worked_on(task: Callable[[Any], Any], home: tuple[str, int], part: Any) -> Any:
    """Work on a part with a share of the cores; another process than `home` works in one thread, as others do."""
    if _this_process() != home:
        set_threads(1)
    with sharing_cores():
        return task(part)
