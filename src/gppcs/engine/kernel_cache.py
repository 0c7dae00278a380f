"""Choose the folder of the compiled kernels, by the sources that they depend on.

Compiled kernels are read from all of these folders, and written to the first that can be written:

1. the folder that NUMBA_CACHE_DIR names,
2. `__pycache__` in the folder of the package,
3. the user's cache folder.

In each there is a folder of this installation. It holds one folder for the present sources, whose name is their digest.
That holds one folder for each version of Python and Numba. When a new digest gets its folder, those of other digests
are removed. A process that still runs the older code then compiles what it needs for itself and keeps none of it.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from glob import glob
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1]
KERNELS = b"\nfrom gppcs.engine.kernels import "  # a line of every module with kernels


def are_kept() -> bool:
    """Return whether compiled kernels are still there after this process ends."""
    return folder_to_write() is not None


@functools.cache
def folders() -> list[Path]:
    """Return the folders in which compiled kernels may be, in the order in which they are tried."""
    import numba

    environment = f"{sys.implementation.cache_tag}-numba-{numba.__version__}"
    return [folder / _sources().digest / environment for folder in _folders_of_installation()]


@functools.cache
def folder_to_write() -> Path | None:
    """Return the folder that compiled kernels are written to, after removing those of other sources beside it."""
    for folder in folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        for other in folder.parent.parent.iterdir():
            if other != folder.parent:
                shutil.rmtree(other, ignore_errors=True)
        return folder
    return None


def sources_have_changed() -> bool:
    """Return whether a source was written since this process first used kernels, which may thus be older than it."""
    return any(_stamp(path) != stamp for path, stamp in _sources().stamps.items())


class _Sources(NamedTuple):
    """The files that kernels depend on.

    Attributes
    ----------
    digest : str
        Of their names and contents.
    stamps : mapping of str to tuple
        Path of each file; its time and size.
    """

    digest: str
    stamps: Mapping[str, tuple[int, int] | None]


@functools.cache
def _sources() -> _Sources:
    """Read the files that kernels depend on."""
    files = sorted(glob("**/*.py", root_dir=PACKAGE, recursive=True))
    paths = {name: os.path.join(PACKAGE, name) for name in files} or {"": _container()}
    stamps = {name: _stamp(path) for name, path in paths.items()}  # first, to tell of a change before a file is read
    contents = {name: Path(path).read_bytes() for name, path in paths.items()}
    used = _used_by_kernels(contents) if files else list(contents)
    digest = hashlib.sha256()
    for name in used:
        digest.update(f"{name} {len(contents[name])}\n".encode() + contents[name])
    return _Sources(digest.hexdigest()[:32], {paths[name]: stamps[name] for name in used})


def _used_by_kernels(contents: Mapping[str, bytes]) -> list[str]:
    """Return the files with kernels, all of the package that these import, and the one that states the version.

    A module without kernels may give them a constant.
    """
    modules = {_module(name): name for name in contents}
    within: dict[str, list[str]] = {}  # each package's modules: one may be imported from it, by a name not looked at
    for module in modules:
        within.setdefault(module.rpartition(".")[0], []).append(module)
    waiting = [module for module, name in modules.items() if KERNELS in contents[name]]
    used = {"gppcs"}  # has the version; what else it imports matters to no kernel
    while waiting:
        module = waiting.pop()
        if module in modules and module not in used:
            used.add(module)
            for imported in _imports(contents[modules[module]].decode()):
                waiting += [imported, *within.get(imported, [])]
    return [name for module, name in modules.items() if module in used]


def _imports(source: str) -> list[str]:
    """Return the modules of the package that a source imports, anywhere in it."""
    lines = (line.split() for line in source.splitlines() if " gppcs" in line)
    return [words[1] for words in lines if words[0] in ("from", "import")]


def _module(file: str) -> str:
    """Return the full name of the module in a file of the package."""
    parts = ("gppcs", *file.removesuffix(".py").split(os.sep))
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _container() -> str:
    """Return the file that the package is in if its sources are not files: an archive or a frozen program."""
    return next((str(folder) for folder in PACKAGE.parents if folder.is_file()), sys.executable)


def _stamp(path: str) -> tuple[int, int] | None:
    """Return the time and size of a file, None if it is gone."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


def _folders_of_installation() -> Iterator[Path]:
    """Yield the folders that may hold those of each digest, in the order in which they are tried."""
    from numba import config
    from numba.misc.appdirs import user_cache_dir

    installation = hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:16]  # others may share a folder
    if named := config.CACHE_DIR:  # type: ignore[attr-defined]
        yield Path(named, "gppcs", installation).absolute()
    yield PACKAGE / "__pycache__" / "kernels"
    yield Path(user_cache_dir("gppcs", appauthor=False), installation)
