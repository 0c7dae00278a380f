"""Which kernels `gp` calls, with the types of their arguments, in the order of first use. Run it to write the list."""

import json

from numba.core import types
from numba.core.registry import CPUDispatcher

from gppcs.app.compilation import compile_method
from gppcs.engine.ahead import KERNELS, METHOD


def described(type_):
    """A type as it stands in the file; see `gppcs.engine.ahead`."""
    if isinstance(type_, types.Array):
        assert type_ == types.Array(type_.dtype, type_.ndim, type_.layout)
        return [described(type_.dtype), type_.ndim, type_.layout]
    if isinstance(type_, types.BaseNamedTuple):
        fields = type_.instance_class
        return {f"{fields.__module__}.{fields.__qualname__}": [described(field) for field in type_]}
    assert isinstance(type_, (types.Number, types.Boolean)), type_
    return str(type_)


def kernels_of_gp():
    """Run the method on a small scan, in a process that has not called its kernels, and note their first calls."""
    found = []
    compile_for = CPUDispatcher._compile_for_args

    def noted(kernel, *arguments, **keywords):
        function = kernel.py_func
        types = [described(kernel.typeof_pyval(argument)) for argument in arguments]
        called = [f"{function.__module__}.{function.__name__}", types]
        if called not in found:  # several threads may wait for the same kernel
            found.append(called)
        return compile_for(kernel, *arguments, **keywords)

    CPUDispatcher._compile_for_args = noted
    compile_method(METHOD)
    return found


def as_text(kernels):
    return "[\n" + ",\n".join(f"  {json.dumps(kernel)}" for kernel in kernels) + "\n]\n"


if __name__ == "__main__":
    text = as_text(kernels_of_gp())  # before the file is opened, as it may be in use
    KERNELS.write_text(text)
