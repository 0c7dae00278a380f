"""How kernels compile by private parts of Numba; `kernels.py` says for which of its versions.

Kernels are optimised, and made machine code, only within those that Python calls: by itself, Numba does both for every
kernel, and adds a wrapper for Python, although most are called by kernels only. That, passes that change nothing in
kernels, and comparisons of options took half of the time of compilation. Compiled code is kept for as long as nothing
changes that it depends on: Numba's cache misses changes of what is called, and mixes up files of processes.
"""

# mypy: ignore-errors
# as Numba declares few of its types

from __future__ import annotations

import contextlib
import functools
import hashlib
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from platform import machine
from types import CodeType, FunctionType, ModuleType
from typing import Any, ClassVar

import numba as nb
from llvmlite.binding import get_host_cpu_features, parse_assembly, parse_bitcode
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, Flags
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.core.types import Omitted, none, unliteral
from numba.core.typing.typeof import typeof

from gppcs.engine import kernel_cache, timer
from gppcs.engine.helpers import call_helpers

# The processor for which shipped code is compiled: of x86-64, any since 2013 with these features.
X86 = "+avx,+avx2,+bmi,+bmi2,+cmov,+cx16,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse3,+sse4.1,+sse4.2,+ssse3,+xsave"
SHIPPED_FOR, FEATURES = ("x86-64-v3", X86) if machine().lower() in ("x86_64", "amd64") else ("generic", "")

# Passes for contexts, literals, and branches by constants, none of which kernels have, except branches on None.
NEEDLESS_PASSES = {
    "LiteralPropagation",
    "Rewrite dynamic raises",
    "dead_branch_prune",
    "find_literally",
    "inline_overloads",
    "literal_unroll",
    "rewrite_semantic_constants",
    "with_lifting",
}


def dispatcher_of(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return what compiles a function when it is first called with arguments of new types, or loads what was kept."""
    outer = _KernelCache(function, options)
    dispatcher = nb.njit(**options, pipeline_class=functools.partial(_KernelCompiler, outer))(function)
    if dispatcher is not function:  # as it is with NUMBA_DISABLE_JIT
        _keep(dispatcher, outer)
        inner = functools.cache(lambda: _InnerKernel(dispatcher, _InnerCache(function, options)))
        dispatcher.get_call_template = lambda args, kws: inner().get_call_template(args, kws)
        dispatcher.get_overload = lambda sig: inner().get_overload(sig)
    return dispatcher


def _keep(dispatcher: Any, cache: _KernelCache) -> None:
    """Let a dispatcher keep what it compiles; other processes that need the same wait for it."""
    dispatcher._cache, compile_now = cache, dispatcher._compiler.compile

    def compile_once(types: Any, return_type: Any) -> CompileResult:
        timer.compile_timer.start()
        try:
            call_helpers()
            with kernel_cache.lock(cache.name(types, dispatcher.targetctx)):
                result = cache.load_overload(types, dispatcher.targetctx)
                if result:  # another process has compiled it just now
                    dispatcher._cache_misses[tuple(types)] -= 1
                else:
                    result = compile_now(types, return_type)
                    timer.compile_timer.kernels += 1
                    cache.write(types, result)
                return result
        finally:
            timer.compile_timer.stop()

    dispatcher._compiler.compile = compile_once


class _Options(Flags):
    """Options of a compilation. Numba compares them at each call that it types: equal ones become the same object."""

    _instances: ClassVar[dict[str, _Options]] = {}
    __hash__, __eq__ = object.__hash__, object.__eq__

    def copy(self) -> _Options:
        """Return the options that functions of Numba take over, the same for inner and outer kernels."""
        options = _Options(self)
        options.no_compile = options.no_cpython_wrapper = False
        return self._instances.setdefault(options.summary(), options)


class _KernelCompiler(Compiler):
    """The steps of compilation that kernels need."""

    def __init__(self, cache: _KernelCache, typing: Any, target: Any, _: Any, *arguments: Any) -> None:
        super().__init__(typing, target, self._library(target.codegen(), cache.qualname), *arguments)
        self.state.flags = _Options(self.state.flags)
        self._digest = cache.digest

    def _library(self, codegen: Any, name: str) -> JITCodeLibrary:
        """Return the library for the code of the kernel."""
        library = _OuterLibrary(codegen, name)
        library.enable_object_caching()
        return library

    def define_pipelines(self) -> list[Any]:
        """Return Numba's steps without those that change nothing in kernels."""
        # Numba numbers functions in each process anew, and links those that have the same name and number as one.
        self.state.func_id.unique_id = self._digest[:24]
        self.state.func_id.unique_name = f"{self.state.func_id.func_qualname}${self._digest[:24]}"
        (steps,) = super().define_pipelines()
        needless = NEEDLESS_PASSES - {"dead_branch_prune"} if none in self.state.args else NEEDLESS_PASSES
        steps.passes = [(step, name) for step, name in steps.passes if step._name not in needless]
        return [steps]


class _InnerCompiler(_KernelCompiler):
    """The steps of compilation for kernels that other kernels call."""

    def __init__(self, cache: _KernelCache, typing: Any, target: Any, library: Any, *arguments: Any) -> None:
        super().__init__(cache, typing, target, library, *arguments)
        self.state.flags.no_compile = self.state.flags.no_cpython_wrapper = True

    def _library(self, codegen: Any, name: str) -> JITCodeLibrary:
        """Return the library for the code of the kernel."""
        return _InnerLibrary(codegen, "inner")


class _OuterLibrary(JITCodeLibrary):
    """The code of a kernel that Python calls, together with that of all functions that it calls."""

    def _optimize_final_module(self) -> None:
        """Link what LLVM has left out, as nothing called it when it came: then optimise."""
        module, libraries, before = self._final_module, dict.fromkeys(self._linking_libraries), set()
        while (missing := _names(module, defined=False)) and missing != before:
            before = missing
            for library in libraries:
                linked = library._get_module_for_linking()
                if missing & _names(linked, defined=True):
                    module.link_in(linked, preserve=True)
        super()._optimize_final_module()


def _names(module: Any, defined: bool) -> set[str]:
    """Return the names of the functions that a module defines, or only declares."""
    return {function.name for function in module.functions if function.is_declaration != defined}


class _InnerLibrary(JITCodeLibrary):
    """The code of one inner kernel, without that of the kernels that it calls."""

    def finalize(self) -> None:
        """Leave it to the outer kernel to link what this kernel calls, to optimise it, and to make machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def has_dynamic_globals(self) -> bool:
        """Whether the code, or that of a kernel that it calls, holds addresses of this process."""
        return any(library._dynamic_globals for library in [self, *self._linking_libraries])

    def linked(self, name: str) -> bytes:
        """Return the code of a kernel of this name together with that of all functions that it calls.

        Functions of Numba get a name of their own, as other processes number them in another way.
        """
        module, numbered = self._final_module.clone(), set()
        for library in dict.fromkeys(self._linking_libraries):
            linked = library._get_module_for_linking()
            if not isinstance(library, _InnerLibrary):  # a function of Numba, with its number in this process
                numbered |= {function.name for function in linked.functions if function.name.startswith("_ZN")}
            module.link_in(linked, preserve=True)
        for function in module.functions:
            if function.name in numbered and not function.is_declaration:
                function.name = f"{function.name}${name}"
        return module.as_bitcode()


class _InnerKernel(CPUDispatcher):
    """The code of a kernel for all types of arguments with which other kernels call it."""

    def __init__(self, outer: Any, cache: _InnerCache) -> None:
        compiler = functools.partial(_InnerCompiler, cache)
        super().__init__(outer.py_func, targetoptions=outer.targetoptions, pipeline_class=compiler)
        self._compiler.fold_argument_types = _without_values(self._compiler.fold_argument_types)
        _keep(self, cache)

    def add_overload(self, cres: CompileResult) -> None:
        """Let callers link the code, and that of all kernels that it calls."""
        key = object()  # instead of a function that Python could call
        libraries = [cres.library, *cres.library._linking_libraries]
        self.targetctx.insert_user_function(key, cres.fndesc, libraries)
        self.overloads[tuple(cres.signature.args)] = cres._replace(entry_point=key)


def _without_values(fold: Callable[..., Any]) -> Callable[..., Any]:
    """Let a call with a constant, or a default, use the code for all values: Numba would compile one for each."""

    def fold_to_types(args: Any, kws: Any) -> Any:
        signature, types = fold(args, kws)
        return signature, tuple(typeof(t.value) if isinstance(t, Omitted) else unliteral(t) for t in types)

    return fold_to_types


class _KernelCache(NullCache):
    """Keeps the code of one kernel."""

    SUFFIX = ".nbc"

    def __init__(self, function: Any, options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._digest: str | None = None

    @property
    def qualname(self) -> str:
        """The name of the kernel."""
        return str(self._function.__qualname__)

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
        paths = [folder / self.name(sig, target_context) for folder in kernel_cache.folders()]
        if shipped := _shipped():
            paths.insert(0, shipped / self._name(sig, SHIPPED_FOR))
        code = next(filter(None, map(kernel_cache.read, paths)), None)
        return self._rebuilt(target_context, *pickle.loads(code)) if code else None

    def write(self, types: Any, result: CompileResult) -> None:
        """Write the code for some types of arguments, if it can be written."""
        folder = kernel_cache.folder_to_write()
        if folder is None or result.lifted or result.library.has_dynamic_globals:
            return
        with contextlib.suppress(OSError):  # the disk is full, or the folder was removed: it is compiled next time too
            kernel_cache.write(folder / self.name(types, result.target_context), dumps(self._reduced(result)))

    def name(self, types: Any, target: Any) -> str:
        """Return the name of the file for some types of arguments on this processor."""
        processor = target.codegen().magic_tuple()
        return self._name(types, SHIPPED_FOR if SHIPPED_FOR in processor else processor)

    def _name(self, types: Any, processor: Any) -> str:
        """Return a name that differs for each function, combination of types, and processor."""
        types = types if isinstance(types, tuple) else types.args
        key = repr((self.digest, list(map(_described, types)), processor))
        function = self._function
        return f"{function.__module__}.{function.__name__}-{hashlib.sha256(key.encode()).hexdigest()[:24]}{self.SUFFIX}"

    def _reduced(self, result: CompileResult) -> tuple[Any, ...]:
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

    def _reduced(self, result: CompileResult) -> tuple[Any, ...]:
        """Return what callers need of a compiled kernel, as it can be kept."""
        description = result.fndesc
        description.typemap = description.calltypes = None  # which only the compilation of this kernel needs
        name = hashlib.sha256(self.name(result.signature, result.target_context).encode()).hexdigest()[:24]
        return result.library.linked(name), description, result.signature

    def _rebuilt(self, target: Any, code: bytes, description: Any, signature: Any) -> CompileResult:
        """Return the compiled kernel of which `_reduced` kept that."""
        library = _InnerLibrary(target.codegen(), "inner")
        library._final_module = parse_bitcode(code)
        library.finalize()
        parts = {"library": library, "fndesc": description, "signature": signature, "objectmode": False}
        return CompileResult(**dict.fromkeys(CompileResult._fields) | parts)


@functools.cache
def _shipped() -> Path | None:
    """Return the folder of the code that came with the package, if this processor runs it."""
    folder = kernel_cache.SHIPPED / kernel_cache.environment()
    if not folder.is_dir():
        return None
    features = get_host_cpu_features()
    return folder if all(features.get(feature[1:]) for feature in filter(None, FEATURES.split(","))) else None


def _described(numba_type: Any) -> Any:
    """Return what code depends on of the type of an argument: class and fields of a named tuple, too, within others."""
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
