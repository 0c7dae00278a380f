"""Compile functions with Numba, and keep the compiled code for as long as nothing changes that it depends on."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from platform import machine
from types import CodeType, FunctionType, ModuleType
from typing import Any

from gppcs.engine import kernel_cache, timer
from gppcs.errors import ParameterError

try:
    import numba as nb
except ValueError as error:
    raise ParameterError(f"Numba cannot start: {error}; check the environment variable NUMBA_NUM_THREADS") from error
from llvmlite.binding import get_host_cpu_features, parse_assembly
from numba.core import event
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from gppcs.engine.inner_kernels import InnerKernel, KernelCompiler, rebuilt, reduced

# The processor for which shipped code is compiled: of x86-64, any since 2013 with these features.
X86 = "+avx,+avx2,+bmi,+bmi2,+cmov,+cx16,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse3,+sse4.1,+sse4.2,+ssse3,+xsave"
SHIPPED_FOR, FEATURES = ("x86-64-v3", X86) if machine().lower() in ("x86_64", "amd64") else ("generic", "")


def kernel(function: Callable[..., Any] | None = None, /, *, allocates: bool = True, **options: Any) -> Any:
    """Compile a function when it is first called with arguments of new types, or load the code that was kept."""
    if function is None:
        return lambda function: kernel(function, allocates=allocates, **options)
    # Less code compiles sooner: nobody calls kernels from C, and none needs ZeroDivisionError.
    every: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy", "_nrt": allocates}
    compiled: Any = nb.njit(**every, **options, pipeline_class=KernelCompiler)(function)
    if compiled is not function:  # as it is with NUMBA_DISABLE_JIT
        compiled._cache = _KernelCache(function, every | options)
        cache = _InnerCache(function, every | options)
        inner = functools.cache(lambda: InnerKernel(function, compiled.targetoptions, cache))
        compiled.get_call_template = lambda args, kws: inner().get_call_template(args, kws)
        compiled.get_overload = lambda sig: inner().get_overload(sig)
    return compiled


class _KernelCache(NullCache):
    """Keeps the code of one kernel. Numba's cache misses changes of what is called, and mixes up files of processes."""

    SUFFIX = ".nbc"

    def __init__(self, function: Any, options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._digest: str | None = None
        self._folder: Path | None = None

    @property
    def cache_path(self) -> str | None:
        """The folder that the code came from or went to last; None if there was none."""
        return str(self._folder) if self._folder else None

    @property
    def digest(self) -> str:
        """A digest of all that the code depends on, but for the types of the arguments and the processor."""
        if self._digest is None:
            self._digest = ""  # for a kernel that calls itself
            options = [
                (name, sorted(value) if isinstance(value, set) else value) for name, value in self._options.items()
            ]
            content = "\n".join([repr(sorted(options)), *_dependencies(self._function)])
            self._digest = hashlib.sha256(content.encode()).hexdigest()
        return self._digest

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the code for some types of arguments, or None if there is none."""
        rtsys.initialize(target_context)  # all that code needs to run; to compile, Numba loads much more
        name = self._name(sig, target_context.codegen().magic_tuple())
        paths = [folder / name for folder in kernel_cache.folders()]
        if shipped := _shipped():
            paths.insert(0, shipped / self._name(sig, SHIPPED_FOR))
        for path in paths:
            if code := kernel_cache.read(path):
                self._folder = path.parent
                return self._rebuilt(target_context, *pickle.loads(code))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the code for some types of arguments, if it can be written."""
        folder = kernel_cache.folder_to_write()
        if folder is None or data.lifted or data.library.has_dynamic_globals:
            return
        processor = data.library.codegen.magic_tuple()
        name = self._name(sig, SHIPPED_FOR if SHIPPED_FOR in processor else processor)
        with contextlib.suppress(OSError):  # the disk is full, or the folder was removed: it is compiled next time too
            kernel_cache.write(folder / name, dumps(self._reduced(data)))
            self._folder = folder

    def _name(self, sig: Any, processor: Any) -> str:
        """Return a name that differs for each function, combination of types, and processor."""
        types = sig if isinstance(sig, tuple) else sig.args
        key = repr((self.digest, list(map(_described, types)), processor))
        function = self._function
        return f"{function.__module__}.{function.__name__}-{hashlib.sha256(key.encode()).hexdigest()[:24]}{self.SUFFIX}"

    def _reduced(self, result: Any) -> tuple[Any, ...]:
        """Return what runs the kernel, not what compiles others or lets Numba call Python: to load that takes long."""
        library, description = result.library, result.fndesc
        description.typemap = description.calltypes = None  # which only the compilation of this kernel needs
        defined = parse_assembly(f'define void @"{description.llvm_cpython_wrapper_name}"() {{ ret void }}')
        code = library.name, "object", (library._get_compiled_object(), defined.as_bitcode())
        return code, description, result.environment, result.signature, False, (), "", result.reload_init, ()

    _rebuilt: Callable[..., CompileResult] = CompileResult._rebuild


class _InnerCache(_KernelCache):
    """Keeps the code of one kernel for kernels that call it, so that another one of these compiles sooner."""

    SUFFIX = ".inner.nbc"
    _reduced = staticmethod(reduced)
    _rebuilt = staticmethod(rebuilt)


@functools.cache
def _shipped() -> Path | None:
    """Return the folder of the code that came with the package, if this processor runs it."""
    folder = kernel_cache.SHIPPED / kernel_cache.environment()
    if not folder.is_dir():
        return None
    features = get_host_cpu_features()
    return folder if all(features.get(feature[1:]) for feature in filter(None, FEATURES.split(","))) else None


def _described(numba_type: Any) -> Any:
    """Return what code depends on of the type of an argument: also the class and the fields of a named tuple in it."""
    if parts := getattr(numba_type, "types", None):
        named = getattr(numba_type, "instance_class", None), getattr(numba_type, "fields", None)
        return str(numba_type), named, list(map(_described, parts))
    return str(numba_type)


def _dependencies(function: FunctionType) -> Iterator[str]:
    """Yield all that the code of a function depends on: its own code, and the values that it finds by their names."""
    values = [cell.cell_contents for cell in function.__closure__ or ()]
    yield repr(function.__defaults__)
    waiting = [function.__code__]
    while waiting:
        code = waiting.pop()
        inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        constants = [
            None if constant == function.__doc__ else constant for constant in code.co_consts if constant not in inner
        ]
        waiting += inner
        yield repr((code.co_code, constants, code.co_names, code.co_varnames))
        values += [function.__globals__[name] for name in code.co_names if name in function.__globals__]
    yield from map(_value, values)


def _value(value: Any) -> str:
    """Return what code depends on of a value that is not an argument."""
    if isinstance(value, Dispatcher):
        kept: Any = vars(value).get("_cache")
        return kept.digest if isinstance(kept, _KernelCache) else repr(value.py_func.__code__.co_code)
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, type) or callable(value):
        return f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', '')}"
    if hasattr(value, "tobytes"):
        return f"{value.dtype} {value.shape} {value.tobytes()!r}"
    return repr(value)


class _Listener(event.Listener):
    """Hears of each compilation by Numba, and passes on those of kernels of the package."""

    def on_start(self, event: Any) -> None:
        if isinstance(event.data["dispatcher"]._cache, _KernelCache):
            timer.compile_timer.start()

    def on_end(self, event: Any) -> None:
        if isinstance(event.data["dispatcher"]._cache, _KernelCache):
            timer.compile_timer.stop()


event.register("numba:compile", _Listener())
