"""Optional packages: imported by one function, whose error names the extra or package to install."""

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

from gppcs.errors import MissingExtraError


def require(module: str, need: str, package: str | None = None, extra: str | None = None) -> Any:
    """Import a module of an optional package, or raise an error that says why this fails and what installs it."""
    try:
        return importlib.import_module(module)
    except (ImportError, OSError) as error:  # the second if a library of the system is missing
        fault = "is not installed"
        if not isinstance(error, ModuleNotFoundError):
            reason = str(error).partition("\n")[0]
            fault = f"cannot be imported ({reason})"
        of_extra = f" (the extra {extra})" if extra else ""
        raise MissingExtraError(f"{need}, which {fault}{of_extra}: pip install {package or module}") from error


require_matplotlib = partial(require, "matplotlib", "a picture needs matplotlib", extra="picture")
require_pyarrow = partial(require, "pyarrow", "Parquet and Feather files need PyArrow", extra="arrow")
require_distributed = partial(require, "distributed", "a Dask scheduler as workers needs distributed", extra="dask")
require_pymeshlab = partial(require, "pymeshlab", "rebuilt and compared meshes need PyMeshLab", extra="evaluate")
require_pye57 = partial(require, "pye57", "E57 files need pye57", extra="e57")
require_sklearn = partial(
    require, "sklearn", "gppcs.estimator.Simplifier needs scikit-learn", "scikit-learn", extra="sklearn"
)


def require_all(*checks: Callable[[], object]) -> None:
    """Check for several packages, and raise one error that names all that are missing."""
    missing = []
    for check in checks:
        try:
            check()
        except MissingExtraError as error:
            missing.append(str(error))
    if missing:
        raise MissingExtraError("; ".join(missing))
