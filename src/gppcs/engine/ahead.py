"""Compile the kernels of a method in a second process, from the last one on, while this one starts with the first.

Numba lets only one thread compile at a time. Each process finds what the other has kept in the folder of the compiled
kernels. The second process is only a help: whatever happens to it, this one compiles what it lacks.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from gppcs.engine.locks import locks

KERNELS = Path(__file__).with_name("kernels_of_gp.json")  # `make kernels` writes it
METHOD = "gp"  # the method that these kernels are of: the default one, which has the most
LOCK = "ahead.lock"  # in the folder of the compiled kernels; the process that compiles ahead holds it

_expected = 0  # blocks of `compiled_ahead` that have not ended
_started = False


@contextmanager
def compiled_ahead(method: str) -> Iterator[None]:
    """Let a second process compile kernels too, if any is compiled in the block."""
    global _expected
    if method != METHOD:
        yield
        return
    _expected += 1
    try:
        yield
    finally:
        _expected -= 1


def start_if_expected() -> None:
    """Start the second process once, within `compiled_ahead`, if another core may be used and compiled code is kept."""
    from gppcs.engine.kernel_cache import folder_to_write
    from gppcs.engine.threads import number_of_threads

    global _started
    if not _expected or _started or number_of_threads() == 1 or not _is_python():
        return
    _started = True
    if (folder := folder_to_write()) is None:
        return
    path = [entry for entry in sys.path if isinstance(entry, str)]
    code = f"import sys; sys.path[:] = {path!r}; from gppcs.engine.ahead import compile_from_last; "
    with contextlib.suppress(OSError):  # it cannot start
        process = subprocess.Popen(
            [sys.executable, "-c", f"{code}compile_from_last({str(folder / LOCK)!r})"],
            stdin=subprocess.PIPE,  # its end tells that this process has ended, however it did
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        atexit.register(_end, process, os.getpid())


def _is_python() -> bool:
    """Return whether `sys.executable` runs Python. In a program that contains Python, it may be the program itself."""
    return not hasattr(sys, "frozen") and Path(sys.executable or "").name.lower().startswith("python")


def _end(process: subprocess.Popen[bytes], parent: int) -> None:
    """End the second process, unless this is a fork of the one that started it."""
    if os.getpid() == parent:
        process.kill()
        process.communicate()


def compile_from_last(lock: str) -> None:
    """Compile the kernels from the last one on, until all are compiled or the process that waits for them ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        with open(lock, "w") as file:
            if locks(file):
                for name, types in reversed(json.loads(KERNELS.read_text())):
                    module, _, kernel = name.rpartition(".")
                    getattr(import_module(module), kernel).compile(tuple(map(_numba_type, types)))
    finally:  # at once, although the other thread still waits
        os._exit(0)


def _end_with_parent() -> None:
    os.read(0, 1)  # nothing comes but the end
    os._exit(0)


def _numba_type(described: Any) -> Any:
    """Return Numba's type for its description.

    It is the name of a number's type, a list of an array's item type, dimensions and layout, or the name of a named
    tuple with the list of its fields.
    """
    from numba.core import types

    if isinstance(described, str):
        return getattr(types, described)
    if isinstance(described, list):
        item, dimensions, layout = described
        return types.Array(_numba_type(item), dimensions, layout)
    ((name, fields),) = described.items()
    module, _, class_name = name.rpartition(".")
    return types.BaseTuple.from_types(tuple(map(_numba_type, fields)), getattr(import_module(module), class_name))
