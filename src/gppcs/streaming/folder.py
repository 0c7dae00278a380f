"""Files in, files out: the kept points of each file of a cloud go to a file of its name, and a crash costs little."""

import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gppcs.amounts.options import Options
from gppcs.amounts.order import in_order
from gppcs.clouds.cloud import PointCloud
from gppcs.engine.arrays import Ints
from gppcs.errors import FileFormatError, InputError, OutputError, ParameterError
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.files import format_to_write
from gppcs.io.remote import address_of
from gppcs.io.streams import whole_output
from gppcs.io.vpc import vpc_of
from gppcs.io.writing import store_in
from gppcs.methods.method import with_scores
from gppcs.spatial.scaling import bounds
from gppcs.streaming.graph import own_version
from gppcs.streaming.output import take
from gppcs.streaming.passes import Choice
from gppcs.streaming.rows import Rows
from gppcs.streaming.source import Part

if sys.platform != "win32":
    import fcntl

REMEDY = "give the same ones, or begin anew with `force`"
WORK = ".gppcs"  # The folder, inside that of the results, for what a run that is begun again needs.
INDEX = "index.vpc"
MANIFEST = "manifest.json"  # of the run that works in such a folder


class Written(NamedTuple):
    """A file that holds the kept points of another."""

    target: Path
    n_points: int
    lower: list[float]  # corner of the box of its points; infinite without points
    upper: list[float]


@dataclass(frozen=True)
class Target:
    """How the points of a cloud are written."""

    path: Path
    format: str | None = None
    order: str = "importance"
    lossy: bool = False

    def write(self, cloud: PointCloud, indices: Ints) -> Written:
        """Write the kept points of a file, with these indices, (n,)."""
        if self.order != "importance":
            cloud = cloud.take(in_order(cloud, indices, self.order))
        with whole_output(self.path, force=True) as file:
            store_in(file, self.path, cloud, format_to_write(self.path, self.format), self.lossy)
        return Written(self.path, len(cloud), *(corner.tolist() for corner in bounds(cloud.points)))


@contextmanager
def run_in_folder(files: CloudFiles, options: Options, targets: Sequence[Target], force: bool) -> Iterator[Path]:
    """Yield the folder for temporary files of a run: a new one, or that of the same run, if it was stopped.

    It stays if the run is stopped again, but not if the input or the options are to blame.
    """
    work = targets[0].path.parent / WORK
    is_new = not work.parent.exists()
    with _written(work.parent):
        work.parent.mkdir(parents=True, exist_ok=True)
    with _without_others(work.parent):
        try:
            _begin(work, files, options, targets, force)
            yield work
        except (InputError, ParameterError, FileFormatError):
            shutil.rmtree(work, ignore_errors=True)
            if is_new:
                with suppress(OSError):  # something else is in it
                    work.parent.rmdir()
            raise
        shutil.rmtree(work)


@contextmanager
def _written(folder: Path) -> Iterator[None]:
    """Raise an error of the system as one that names the folder."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{folder}: expected a folder to write to, but {error.strerror}") from error


@contextmanager
def _without_others(folder: Path) -> Iterator[None]:
    """Lock a folder, where the system and the file system can, so that no other run writes to it; not even a like one.

    The system drops the lock with the process.
    """
    if sys.platform == "win32":
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:  # file systems without locks have others
            if isinstance(error, BlockingIOError):
                raise OutputError(
                    f"{folder}: another run writes to it; wait for it, or choose another folder"
                ) from None
        yield
    finally:
        os.close(descriptor)


def is_begun(folder: Path) -> bool:
    """Return whether a run that was stopped can go on in the folder of its results."""
    return (folder / WORK / MANIFEST).exists()


def _begin(work: Path, files: CloudFiles, options: Options, targets: Sequence[Target], force: bool) -> None:
    """Make the folder of a run, or check that it is that of the same run."""
    path = work / MANIFEST
    manifest = {
        "version": own_version(),
        "options": _described(options),
        "reading": files.described,
        "outputs": [repr(target) for target in targets],
        "inputs": [_state_of(path) for path in files.paths],
    }
    if is_begun(work.parent) and not force:
        before = json.loads(path.read_text(encoding="utf-8"))
        for name, value in manifest.items():
            if before.get(name) != value:
                raise OutputError(f"{work}: expected the {name} with which this run began, found other ones; {REMEDY}")
        return
    existing = [file for file in (*(target.path for target in targets), work.parent / INDEX) if file.exists()]
    if existing and not force:
        raise OutputError(f"{existing[0]}: the file exists; choose another folder, or overwrite it with `force`")
    with _written(work.parent):
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        with whole_output(path) as file:
            file.write(json.dumps(manifest).encode())


def _state_of(path: Path) -> list[str | int]:
    """Return what tells a file from others, and from itself before a change; the address of a server's file."""
    if address := address_of(path):
        return [address]
    return [str(path.resolve()), path.stat().st_size, path.stat().st_mtime_ns]


def _described(options: Options) -> str:
    """Return what the result depends on of the options: of arrays, a digest of their values."""
    described = []
    for option in fields(options):
        value = getattr(options, option.name)
        if option.name in ("keep", "weight") and not isinstance(value, str | None):
            value = hashlib.sha256(np.asarray(value).tobytes()).hexdigest()
        if option.name not in ("memory", "workers", "scratch"):
            described.append(f"{option.name}={value!r}")
    return ", ".join(described)


def write_file(choice: Choice, task: tuple[Sequence[Part], Target]) -> Written:
    """Write the kept points in the parts of a file, unless an earlier run did so."""
    parts, target = task
    record = choice.tiling.folder / f"{target.path.name}.json"
    if record.exists() and target.path.exists():
        return Written(target.path, *json.loads(record.read_text(encoding="utf-8")))
    kept = _kept_in(choice, parts)
    cloud = take(parts, kept)
    if choice.tiling.options.scores:
        cloud = with_scores(cloud, kept.scores)
    written = target.write(cloud, kept.indices)
    with whole_output(record, force=True) as file:
        file.write(json.dumps(written[1:]).encode())
    return written


def _kept_in(choice: Choice, parts: Sequence[Part]) -> Rows:
    """Return the kept points of the parts of a file."""
    first, last = parts[0], parts[-1]
    lower, upper = (np.array([getattr(part, name) for part in parts]) for name in ("lower", "upper"))
    numbers = choice.tiling.meeting(lower.min(axis=0), upper.max(axis=0))
    return choice.all_kept(numbers or [0], first.first, last.first + (last.count or 0))


def write_index(folder: Path, written: Sequence[Written]) -> None:
    """Write a virtual point cloud of all files beside them."""
    text = vpc_of([(file.target.name, file.n_points, file.lower, file.upper) for file in written])
    with whole_output(folder / INDEX, force=True) as file:
        file.write(text.encode())
