"""Compile kernels for kernels that call them: optimised, and made machine code, only within those that Python calls.

By itself, Numba does both for every kernel, and adds a wrapper for Python, although most are called by kernels only.
That, passes that change nothing in kernels, and comparisons of options took half of the time of compilation.
"""

# mypy: ignore-errors
# as Numba declares few of its types

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import count
from typing import Any, ClassVar

from llvmlite.binding import parse_bitcode
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, Flags
from numba.core.registry import CPUDispatcher
from numba.core.types import Omitted, unliteral
from numba.core.typing.typeof import typeof

# Passes for contexts, literals, and branches by constants, none of which kernels have.
NEEDLESS_PASSES = {
    "LiteralPropagation",
    "Rewrite dynamic raises",
    "dead_branch_prune",
    "find_literally",
    "inline_inlinables",
    "inline_overloads",
    "literal_unroll",
    "rewrite_semantic_constants",
    "with_lifting",
}

# Numba numbers functions in each process anew, and links those that have the same name and number as if they were one.
FunctionIdentity._unique_ids = count(int.from_bytes(os.urandom(6), "little"))


class _Options(Flags):
    """Options of a compilation. Numba compares them at each call that it types: equal ones become the same object."""

    _instances: ClassVar[dict[str, _Options]] = {}
    __hash__, __eq__ = object.__hash__, object.__eq__

    def copy(self) -> _Options:
        """Return the options that functions of Numba take over, the same for inner and outer kernels."""
        options = _Options(self)
        options.no_compile = options.no_cpython_wrapper = False
        return self._instances.setdefault(options.summary(), options)


class KernelCompiler(Compiler):
    """The steps of compilation that kernels need."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags = _Options(self.state.flags)

    def define_pipelines(self) -> list[Any]:
        """Return Numba's steps without those that change nothing in kernels."""
        (steps,) = super().define_pipelines()
        steps.passes = [(step, name) for step, name in steps.passes if step._name not in NEEDLESS_PASSES]
        return [steps]


class _InnerCompiler(KernelCompiler):
    """The steps of compilation for kernels that other kernels call."""

    def __init__(self, typing: Any, target: Any, library: Any, *arguments: Any) -> None:
        super().__init__(typing, target, _InnerLibrary(target.codegen(), "inner"), *arguments)
        self.state.flags.no_compile = self.state.flags.no_cpython_wrapper = True


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

    def linked(self) -> bytes:
        """Return the code together with that of all kernels that it calls."""
        module = self._final_module.clone()
        for library in dict.fromkeys(self._linking_libraries):
            module.link_in(library._get_module_for_linking(), preserve=True)
        return module.as_bitcode()


class InnerKernel(CPUDispatcher):
    """The code of a kernel for all types of arguments with which other kernels call it."""

    def __init__(self, function: Callable[..., Any], targetoptions: dict[str, Any], cache: Any) -> None:
        super().__init__(function, targetoptions=targetoptions, pipeline_class=_InnerCompiler)
        self._compiler.fold_argument_types = _without_values(self._compiler.fold_argument_types)
        self._cache = cache

    def add_overload(self, cres: CompileResult) -> None:
        """Let callers link the code, and that of all kernels that it calls."""
        key = object()  # instead of a function that Python could call
        libraries = [cres.library, *cres.library._linking_libraries]
        self.targetctx.insert_user_function(key, cres.fndesc, libraries)
        self.overloads[tuple(cres.signature.args)] = cres._replace(entry_point=key)


def reduced(result: CompileResult) -> tuple[Any, ...]:
    """Return what callers need of a compiled kernel, as it can be kept."""
    description = result.fndesc
    description.typemap = description.calltypes = None  # which only the compilation of this kernel needs
    return result.library.linked(), description, result.signature


def rebuilt(target: Any, code: bytes, description: Any, signature: Any) -> CompileResult:
    """Return the compiled kernel of which `reduced` kept that."""
    library = _InnerLibrary(target.codegen(), "inner")
    library._final_module = parse_bitcode(code)
    library.finalize()
    parts = {"library": library, "fndesc": description, "signature": signature, "objectmode": False}
    return CompileResult(**dict.fromkeys(CompileResult._fields) | parts)


def _without_values(fold: Callable[..., Any]) -> Callable[..., Any]:
    """Let a call with a constant, or a default, use the code for all values: Numba would compile one for each."""

    def fold_to_types(args: Any, kws: Any) -> Any:
        signature, types = fold(args, kws)
        return signature, tuple(typeof(t.value) if isinstance(t, Omitted) else unliteral(t) for t in types)

    return fold_to_types
