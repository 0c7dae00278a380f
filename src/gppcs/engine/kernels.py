"""Compile functions with Numba, and keep the compiled code."""

import logging
import re
from collections.abc import Callable
from typing import Any

from gppcs.errors import ParameterError

try:
    import numba as nb
except ValueError as error:
    raise ParameterError(f"Numba cannot start: {error}; check the environment variable NUMBA_NUM_THREADS") from error

TRIED = (0, 60), (0, 68)  # the first and the last version of Numba whose private parts were tried
IS_TRIED = TRIED[0] <= tuple(map(int, re.findall(r"\d+", nb.__version__)[:2])) <= TRIED[1]

_kernels: list[Any] = []

if not IS_TRIED:
    logging.getLogger("gppcs").warning(
        "Numba %s was not tried: kernels compile in its own way, which takes twice as long as with Numba %d.%d",
        nb.__version__, *TRIED[1],
    )  # fmt: skip


def kernel(function: Callable[..., Any] | None = None, /, *, allocates: bool = True, **options: Any) -> Any:
    """Compile a function when it is first called with arguments of new types, or load the code that was kept."""
    if function is None:
        return lambda function: kernel(function, allocates=allocates, **options)
    every: dict[str, Any] = {"nogil": True, "error_model": "numpy"} | options  # none needs ZeroDivisionError
    if IS_TRIED:
        from gppcs.engine.numba_internals import dispatcher_of

        # Less code compiles sooner: nobody calls kernels from C.
        compiled = dispatcher_of(function, {**every, "no_cfunc_wrapper": True, "_nrt": allocates})
    else:
        try:
            compiled = nb.njit(**every, cache=True)(function)
        except RuntimeError:  # Numba finds no folder for it
            compiled = nb.njit(**every)(function)
    if compiled is not function:
        _kernels.append(compiled)
    return compiled


def number_compiled() -> int:
    """Return how many kernels that Python calls this process has compiled, each for all types of arguments."""
    return sum(sum(kernel.stats.cache_misses.values()) for kernel in _kernels)
