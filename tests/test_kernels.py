"""What holds for all Numba kernels."""

import ast
from pathlib import Path

import gppcs

SOURCE = Path(gppcs.__file__).parent


def kernels():
    """Each kernel's name with the options of its decorator and the names of what it calls."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        for function in ast.walk(ast.parse(path.read_text())):
            for decorator in getattr(function, "decorator_list", []):
                if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "nb.njit":
                    options = {keyword.arg: ast.unparse(keyword.value) for keyword in decorator.keywords}
                    calls = [node.func for node in ast.walk(function) if isinstance(node, ast.Call)]
                    found[function.name, path.stem] = options, {ast.unparse(call) for call in calls}
    return found


def test_rounding_does_not_depend_on_which_kernel_is_compiled_first():
    """Numba lets a kernel without `fastmath` take over that of the first kernel to call it, and keeps it on disk."""
    found = kernels()
    assert len(found) > 50
    unclear = []
    for (name, module), (own, _) in found.items():
        callers = {options.get("fastmath", "False") for options, calls in found.values() if name in calls}
        if len(callers) > 1 and "fastmath" not in own and "inline" not in own:
            unclear.append(f"{module}.{name}: add fastmath=False")
    assert not unclear
