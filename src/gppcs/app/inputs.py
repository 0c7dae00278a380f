"""What commands read, with a note on what of a file they do not use."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from gppcs import io
from gppcs.app.printing import print_error
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.errors import FileFormatError
from gppcs.io.mesh_files import mesh_of


def read_each(
    paths: Sequence[Path], input_format: str | None, columns: Sequence[str] | None, use_faces: bool = False
) -> list[tuple[PointCloud, Mesh | None]]:
    """Read clouds, with their meshes if these are used; the names of columns are for tables alone."""
    with ExitStack() as stack:
        opened = [stack.enter_context(io.CloudFiles([path], input_format, columns, if_needed=True)) for path in paths]
        if columns is not None and not any("columns" in kind.options for files in opened for kind in files.formats()):
            raise FileFormatError("expected a text table, whose columns can be named, found other files only")
        inputs = []
        for path, files in zip(paths, opened, strict=True):
            cloud = files.read()
            mesh = mesh_of(path, files.n_faces) if use_faces else None
            inputs.append((cloud, mesh))
            note_unused(path, files, are_faces_used=mesh is not None)
        return inputs


def note_unused(name: str | Path, files: io.CloudFiles, are_faces_used: bool = False) -> None:
    """Print on stderr what of the files, which have been read, is not used."""
    faces = [f"faces ({files.n_faces:,})"] if files.n_faces and not are_faces_used else []
    if names := [*faces, *files.skipped()]:
        print_error(f"note: {name}: not used: {', '.join(names)}")


def note_empty(name: str | Path, files: io.CloudFiles, n_points: int) -> None:
    """Print on stderr if a result has no points."""
    if not n_points:
        print_error(f"note: {name}: the result is empty, as it has no {files.query.text if files.query else 'points'}")
