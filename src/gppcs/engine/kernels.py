"""Compile functions with Numba, and keep the compiled code until a source that it depends on changes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import stat
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gppcs.errors import ParameterError, shown

try:
    import numba as nb
except ValueError as error:  # which does not name the variable
    if (threads := os.environ.get("NUMBA_NUM_THREADS")) is None:
        raise
    raise ParameterError(
        f"expected the environment variable NUMBA_NUM_THREADS to be a whole number from 1 on, found {shown(threads)}; "
        "unset it, as gppcs has threads of its own"
    ) from error
from numba.core import event
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.core.types import unliteral

from gppcs.engine.compiling import compilation_ended, compilation_started
from gppcs.engine.kernel_cache import folder_to_write, folders, sources_have_changed

CHECKSUM_BYTES = 16
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def kernel(function: Callable[..., Any] | None = None, /, *, allocates: bool = True, **options: Any) -> Any:
    """Compile a function when it is first called with arguments of new types, or load the code that was kept."""
    if function is None:
        return lambda function: kernel(function, allocates=allocates, **options)
    # Less code compiles sooner: nobody calls kernels from C, and none needs ZeroDivisionError.
    every: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy", "_nrt": allocates}
    compiled: Any = nb.njit(**every, **options)(function)
    if compiled is not function:  # as it is with NUMBA_DISABLE_JIT
        compiled._cache = _KernelCache(function)
        compiled._compiler.fold_argument_types = _without_literals(compiled._compiler.fold_argument_types)
    return compiled


def _without_literals(fold: Callable[..., Any]) -> Callable[..., Any]:
    """Let a call with a constant use the code for all values: Numba would compile a kernel anew for each constant."""

    def fold_to_types(args: Any, kws: Any) -> Any:
        signature, types = fold(args, kws)
        return signature, tuple(map(unliteral, types))

    return fold_to_types


class _KernelCache(NullCache):
    """Keeps the compiled code of one kernel: a file for each combination of types of its arguments.

    Numba's own cache looks only at the file that a function stands in, not at those of the functions that it calls.
    It also names files by numbers from an index, so that two processes that write at once can mix up their files.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._folders = folders()  # now, not at the first call: until then the sources may change
        self._folder: Path | None = None

    @property
    def cache_path(self) -> str | None:
        """The folder that the code came from or went to last; None if there was none."""
        return str(self._folder) if self._folder else None

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the code for some types of arguments, or None if there is none."""
        target_context.refresh()
        name = self._file_name(sig, target_context.codegen())
        for folder in self._folders:
            content = _read_own(folder / name)
            checksum, code = content[:CHECKSUM_BYTES], content[CHECKSUM_BYTES:]
            if code and checksum == _checksum(code):  # else the machine stopped before the file was on the disk
                self._folder = folder
                return CompileResult._rebuild(target_context, *pickle.loads(code))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the code for some types of arguments, if it can be written and the sources are still the same."""
        folder = folder_to_write()
        if folder is None or data.lifted or data.library.has_dynamic_globals or sources_have_changed():
            return
        code = dumps(data._reduce())
        with contextlib.suppress(OSError):  # the disk is full, or the folder was removed: it is compiled next time too
            _write_whole(folder / self._file_name(sig, data.library.codegen), _checksum(code) + code)
            self._folder = folder

    def _file_name(self, sig: Any, codegen: Any) -> str:
        """Return a name that differs for each function, combination of types, and processor."""
        function = self._function
        closure = [cell.cell_contents for cell in function.__closure__ or ()]
        key = (function.__code__.co_firstlineno, sig, codegen.magic_tuple())
        digest = hashlib.sha256(repr(key).encode() + function.__code__.co_code + dumps(closure)).hexdigest()
        return f"{function.__module__}.{function.__name__}-{digest[:24]}.nbc"


def _read_own(path: Path) -> bytes:
    """Read a file that only this user or the administrator can have written: unpickling runs code. Others are empty."""
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if hasattr(os, "geteuid") and (status.st_uid not in (0, os.geteuid()) or status.st_mode & OTHERS_WRITE):
                return b""
            return file.read()
    except OSError:
        return b""


def _checksum(code: bytes) -> bytes:
    return hashlib.blake2b(code, digest_size=CHECKSUM_BYTES).digest()


def _write_whole(path: Path, content: bytes) -> None:
    """Write a file so that no other process ever reads a part of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}.part")
    try:
        part.write_bytes(content)
        part.chmod(0o644)  # whatever the umask; see `_read_own`
        os.replace(part, path)
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


class _Listener(event.Listener):
    """Hears of each compilation by Numba, and passes on those of kernels of the package."""

    def on_start(self, event: Any) -> None:
        if isinstance(event.data["dispatcher"]._cache, _KernelCache):
            compilation_started()

    def on_end(self, event: Any) -> None:
        if isinstance(event.data["dispatcher"]._cache, _KernelCache):
            compilation_ended()


event.register("numba:compile", _Listener())
