"""Packages that are optional: each is imported where it is used, with an error that names its extra."""

from __future__ import annotations

import functools
import importlib
import subprocess
import sys
from typing import Any

from gppcs.errors import MissingExtraError

# In a process of its own, since without OpenGL the process ends here, with no chance to say why.
PROBE = "import pyvista; p = pyvista.Plotter(off_screen=True); p.add_mesh(pyvista.Cube()); p.screenshot()"


def require_matplotlib() -> None:
    """Make sure that a picture can be drawn, before long work is done for it.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    try:
        importlib.import_module("matplotlib")
    except ImportError as error:
        raise MissingExtraError("a picture needs matplotlib: pip install 'gppcs[picture]'") from error


def require_pymeshlab() -> Any:
    """Import PyMeshLab.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    import numba

    numba.get_num_threads()  # starts them: later, Numba would meet PyMeshLab's TBB and warn that it is too old
    try:
        import pymeshlab
    except ImportError as error:
        raise MissingExtraError(
            "meshes need PyMeshLab, which is not installed: pip install 'gppcs[evaluate]'"
        ) from error
    return pymeshlab


def require_pyvista() -> None:
    """Make sure that meshes can be drawn, before long work is done for it.

    Raises
    ------
    MissingExtraError
        If PyVista is not installed, or finds no OpenGL.
    """
    try:
        importlib.import_module("pyvista")
    except ImportError as error:
        raise MissingExtraError("a picture of meshes needs PyVista: pip install 'gppcs[view]'") from error
    if not _opengl_works():
        raise MissingExtraError(
            "a picture of meshes needs OpenGL, in software if there is no graphics card, and PyVista found none; "
            "on Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri libx11-6"
        )


@functools.cache
def _opengl_works() -> bool:
    return subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=False).returncode == 0
