"""Other processes compile parts of a pipeline at the same time, into the folder of compiled kernels."""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeAlias

from gppcs.engine import kernel_cache, timer
from gppcs.engine.memory import available_memory
from gppcs.engine.threads import number_of_threads, set_threads

Part: TypeAlias = tuple[Callable[..., object], *tuple[Any, ...]]  # a function of a module; its arguments, as in JSON

MEMORY = 500_000_000  # Bytes that a process that compiles may take, with a margin.

_is_helper = False
_blocks: list[tuple[tuple[Part, ...], contextlib.ExitStack]] = []  # the one that runs, until it has called helpers


def may_start_processes() -> bool:
    """Return whether this process has cores for others, and is no worker and no application that embeds Python."""
    is_worker = _is_helper or multiprocessing.parent_process() is not None or "PYTEST_XDIST_WORKER" in os.environ
    is_python = Path(sys.executable or "").name.lower().startswith("python") and not hasattr(sys, "frozen")
    return is_python and not is_worker and number_of_threads() > 1


@contextlib.contextmanager
def helped(*parts: Part) -> Iterator[None]:
    """While the block runs, let idle cores compile what these parts call, from the first kernel on that is missing."""
    with contextlib.ExitStack() as stack:
        if not _blocks:
            _blocks.append((parts, stack))
            stack.callback(_blocks.clear)
        yield


def call_helpers() -> None:
    """Start a helper on each other core for the block that runs, unless another process has some already."""
    if not _blocks or not may_start_processes():
        return
    parts, stack = _blocks.pop()
    count = min(len(parts), _within_memory(number_of_threads() - 1))
    if stack.enter_context(kernel_cache.lock("helpers", 0.0)):
        for first in range(count):
            with contextlib.suppress(OSError):  # no process can start
                stack.enter_context(_Helper()).send(*parts[first::count])


def run_all(parts: Sequence[Part]) -> Iterator[int]:
    """Run parts in other processes, one on each core, or else in this one; yield how many kernels each compiled."""
    idle: SimpleQueue[_Helper] = SimpleQueue()

    def run_in_helper(part: Part) -> int | None:
        helper = idle.get()
        try:
            helper.send(part)
            return helper.answer()
        except (OSError, ValueError):  # it has died
            return None
        finally:
            idle.put(helper)

    count = _within_memory(number_of_threads()) if may_start_processes() else 0
    with ThreadPoolExecutor(max(1, count)) as pool, contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # no process can start
            for _ in range(count):
                idle.put(stack.enter_context(_Helper()))
        if idle.empty():
            yield from map(_run, parts)
            return
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        started = {pool.submit(run_in_helper, part): part for part in parts}
        for future in as_completed(started):
            compiled = future.result()
            timer.compile_timer.kernels += compiled or 0
            yield _run(started[future]) if compiled is None else compiled


def _within_memory(count: int) -> int:
    """Return how many of some processes have room in memory; all if the system does not tell."""
    available = available_memory()
    return count if available is None else min(count, available // MEMORY)


class _Helper:
    """A process that runs parts, one after another."""

    def __init__(self) -> None:
        code = f"import sys\nsys.path[:] = {sys.path}\nfrom gppcs.engine.helpers import serve\nserve()"
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)
        self._process = subprocess.Popen([sys.executable, "-c", code], **pipes, text=True, creationflags=hidden)

    def __enter__(self) -> _Helper:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        with contextlib.suppress(OSError):  # what it was sent stays unread
            self._process.communicate()

    def send(self, *parts: Part) -> None:
        """Let it run parts."""
        assert self._process.stdin
        for function, *arguments in parts:
            self._process.stdin.write(json.dumps([function.__module__, function.__name__, *arguments]) + "\n")
        self._process.stdin.flush()

    def answer(self) -> int:
        """Return how many kernels the next part has compiled."""
        assert self._process.stdout
        return int(self._process.stdout.readline())


def serve() -> None:
    """Run parts as they come in."""
    global _is_helper
    _is_helper = True
    set_threads(1)
    gc.set_threshold(1_000_000)  # to collect garbage takes a tenth of the time of compilation
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        for line in sys.stdin:
            module, name, *arguments = json.loads(line)
            count = _run((getattr(importlib.import_module(module), name), *arguments))
            print(count, file=sys.__stdout__, flush=True)


def _run(part: Part) -> int:
    """Run a part; return how many kernels that compiled."""
    from gppcs.engine.kernels import number_compiled

    function, *arguments = part
    before = number_compiled()
    function(*arguments)
    return number_compiled() - before
