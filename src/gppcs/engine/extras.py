"""Optional packages: each function checks for one and raises an error that names the extra or package to install."""

from __future__ import annotations

import functools
import importlib
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from gppcs.errors import MissingExtraError

# What `pip install 'gppcs[extra]'` would install. That line works only if gppcs is on a package index.
EXTRAS = {
    "arrow": ("pyarrow>=20",),
    "cgal": ("cgal>=6.0.1",),
    "dask": ("distributed>=2024.8",),
    "e57": ("pye57>=0.4.13",),
    "picture": ("matplotlib>=3.9",),
    "evaluate": ("pymeshlab>=2025.7",),
    "sklearn": ("scikit-learn>=1.6",),
    "view": ("matplotlib>=3.9", "pyvista>=0.48", "vtk>=9.6"),
}

# This code runs in a separate process: without OpenGL, VTK ends the process instead of raising an error.
PROBE = "import pyvista; p = pyvista.Plotter(off_screen=True); p.add_mesh(pyvista.Cube()); p.screenshot()"


def _imported(module: str, need: str, extra: str) -> Any:
    """Import a module of an extra, or say why this fails, with the line that installs its packages."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        packages = " ".join(f"'{requirement}'" for requirement in EXTRAS[extra])
        fault = "is not installed"
        if not isinstance(error, ModuleNotFoundError):  # a library of the system is missing, or versions do not fit
            reason = str(error).partition("\n")[0]
            fault = f"cannot be imported ({reason})"
        raise MissingExtraError(f"{need}, which {fault} (the extra {extra}): pip install {packages}") from error


require_matplotlib = partial(_imported, "matplotlib", "a picture needs matplotlib", "picture")
require_pyarrow = partial(_imported, "pyarrow", "Parquet and Feather files need PyArrow", "arrow")
require_distributed = partial(
    _imported, "distributed", "work on several processes or machines needs Dask's distributed", "dask"
)
require_pye57 = partial(_imported, "pye57", "E57 files need pye57", "e57")
require_pymeshlab = partial(_imported, "pymeshlab", "rebuilt and compared meshes need PyMeshLab", "evaluate")
require_sklearn = partial(_imported, "sklearn", "a transformer of scikit-learn needs it", "sklearn")


def require_cgal(module: str) -> Any:
    """Import a part of CGAL's Python package."""
    return _imported(f"CGAL.CGAL_{module}", "the advancing front needs CGAL", "cgal")


def require_pyvista() -> None:
    """Check that PyVista can draw meshes, so that a long run does not fail at its end."""
    _imported("pyvista", "a picture of meshes needs PyVista", "view")
    if not _opengl_works():
        raise MissingExtraError(
            "a picture of meshes needs OpenGL, and PyVista found none; software rendering suffices, "
            "on Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri libx11-6"
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
        raise MissingExtraError("\n".join(missing))


def require_library(name: str, title: str) -> Any:
    """Import a library whose objects a cloud becomes. No extra brings these: who wants such objects has the library."""
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:  # the second if a library of the system is missing
        reason = str(error).partition("\n")[0]
        raise MissingExtraError(
            f"an object of {title} needs {title}, which cannot be imported ({reason}): pip install {name}"
        ) from error


@functools.cache
def _opengl_works() -> bool:
    return subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=False).returncode == 0
