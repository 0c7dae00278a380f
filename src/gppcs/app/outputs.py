"""Which files a command reads, with a note on what of them it does not use, and which file it writes for each."""

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gppcs import io
from gppcs.amounts.options import Options, Order
from gppcs.app.printing import print_error
from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.errors import FileFormatError, OutputError, file_path
from gppcs.io import text
from gppcs.io.mesh_files import mesh_of
from gppcs.io.remote import address_of
from gppcs.methods.method import SCORES
from gppcs.result import Result
from gppcs.steps import check_addable

LEVEL_FIELD = "{level}"  # stands for the number of a level in the name of its file


@dataclass(frozen=True)
class Output:
    """A cloud in files, and where its result goes: to one file, or to one for each level or input."""

    source: io.CloudFiles
    targets: list[Path]  # of levels from coarse to fine
    makes_folders: bool = False
    by_input: bool = False  # whether there is a target for the points of each input
    suffix: str | None = None  # of the format; otherwise, the names tell it
    asked_order: Order | None = None  # of the points; otherwise, the formats tell it
    force: bool = False
    lossy: bool = False

    @property
    def input(self) -> str | list[str]:
        """The name of the file, or those of several."""
        names = list(map(str, self.source.paths))
        return names if len(names) > 1 else names[0]

    @property
    def input_title(self) -> str:
        """The name of the first file, and how many others there are."""
        first, *more = self.source.paths
        return f"{first} and {len(more)} more" if more else str(first)

    @property
    def title(self) -> str:
        """The names of the files."""
        if self.by_input:
            return f"{len(self.targets)} files → {self.targets[0].parent}"
        return f"{self.input_title} → {', '.join(map(str, self.targets))}"

    @cached_property
    def formats(self) -> list[io.Format]:
        """The format of each target."""
        return [io.format_to_write(target, self.suffix) for target in self.targets]

    @property
    def orders(self) -> list[Order]:
        """The order of the points in each target."""
        return [self.asked_order or ("input" if kind.name in ("LAS", "LAZ") else "importance") for kind in self.formats]

    def check(self) -> None:
        """Check before long work that the sources exist and that gppcs can write the targets."""
        for source in self.source.paths:
            if not (io.is_standard(source) or address_of(source)):
                source.stat()  # a missing input is reported before its name is taken for that of the output
        goes_on = False
        if self.by_input:
            from gppcs.streaming.folder import is_begun  # only here: most commands need nothing of it

            goes_on = is_begun(self.targets[0].parent)
        for target, _ in zip(self.targets, self.formats, strict=True):
            io.check_writable(target, self.force or goes_on, self.makes_folders)

    def check_storable(self, options: Options) -> None:
        """Check that the targets can hold the first points with the attributes that the options add."""
        cloud = self.source.preview
        check_addable(cloud, options)
        if options.mark is None:
            cloud = cloud[cloud.is_finite()]  # only these are kept
        rows = np.arange(len(cloud))
        added = (NORMALS if options.normals else ()) + (SCORES if options.scores else ())
        zeros = dict.fromkeys(added, np.zeros(len(rows), np.float32))
        cloud = replace(cloud, attributes={**cloud.attributes, **zeros})
        all_kept = Result(rows, cloud, options.algorithm, {}, {}, ranks=rows, is_ranking=True, points_in=len(rows))
        if options.mark is None:
            levels = options.levels if len(self.targets) == 1 else None
            cloud = all_kept.with_attributes(index=options.index, rank=options.rank, levels=levels).cloud
        else:
            cloud = all_kept.marked(cloud, options.mark)
        for kind, target in dict(zip(self.formats, self.targets, strict=True)).items():
            io.check_storable(target, cloud, kind, self.lossy)

    def write(self, clouds: Sequence[PointCloud], is_ranked: bool) -> list[str]:
        """Write all targets, which replace others only when all are complete; return what they do not hold."""
        dropped: list[str] = []
        with ExitStack() as stack:
            for target, kind, cloud in zip(self.targets, self.formats, clouds, strict=True):
                if self.makes_folders:
                    target.parent.mkdir(parents=True, exist_ok=True)
                file = stack.enter_context(io.whole_output(target, self.force))
                dropped = io.store_in(file, target, cloud, kind.ranked() if is_ranked else kind, self.lossy)
        return dropped


def check_output(output: Path, inputs: Sequence[Path], force: bool, suffixes: Sequence[str] = ()) -> None:
    """Check that the one file of a command can be written, has a fitting name and is no input; call it before work."""
    io.check_distinct([output], inputs)
    if suffixes and not io.is_standard(output) and io.inner_name(output).suffix.lower() not in suffixes:
        raise OutputError(f"{output}: expected a name that ends in {suffixes[0]}; choose another")
    io.check_writable(output, force)


def outputs_of(
    inputs: Sequence[Path], output: str, reading: Mapping[str, Any], levels: int = 0, separately: bool = False
) -> list[Output]:
    """Return where results go: of all inputs as one cloud, or `separately` of each that has a target of its own.

    `reading` has the options of `gppcs.open`.
    """
    sources = sources_of(inputs)
    if LEVEL_FIELD in output:
        if not levels:
            raise OutputError(f"{output}: expected {LEVEL_FIELD} with `levels`; choose another name")
        targets = [file_path(output.replace(LEVEL_FIELD, str(number))) for number in range(levels)]
        return [Output(io.CloudFiles(sources, **reading), targets, makes_folders=True)]
    if not _means_folder(output, sources != list(inputs) or len(sources) > 1):
        return [Output(io.CloudFiles(sources, **reading), [file_path(output)])]
    by_name: dict[str, Path] = {}
    for source in sources:
        if (other := by_name.setdefault(io.without_query(source).name, source)) is not source:
            raise OutputError(
                f"{output}: expected inputs with different names, found {other} and {source}; rename one, or choose "
                "a folder for each"
            )
    targets = [Path(output, name) for name in by_name]
    if len(sources) > 1 and not separately:
        return [Output(io.CloudFiles(sources, **reading), targets, makes_folders=True, by_input=True)]
    return [
        Output(io.CloudFiles(source, **reading), [target], makes_folders=True)
        for source, target in zip(sources, targets, strict=True)
    ]


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


def sources_of(inputs: Sequence[Path]) -> list[Path]:
    """Return the files that the inputs of a command stand for."""
    return [file for path in inputs for file in (_files_in(path) if path.is_dir() else io.files_of(path))]


def _files_in(folder: Path) -> list[Path]:
    """Return the files in a folder that gppcs reads by their names, less texts without points, such as notes."""
    visible = [path for path in sorted(folder.iterdir()) if path.is_file() and not path.name.startswith(".")]
    files = [path for path in visible if any(kind.has_suffix(io.inner_name(path).name) for kind in io.FORMATS)]
    if not files:
        raise FileFormatError(f"{folder}: expected a folder with files that gppcs reads, such as .ply, found none")
    return [file for file in files if not _is_other_text(file)]


def _is_other_text(path: Path) -> bool:
    """Return whether a file is a text without points, with a note that says so."""
    if not any(text_format.has_suffix(path.name) for text_format in text.FORMATS):
        return False
    try:
        with io.CloudFiles([path]) as files:
            _ = files.preview
    except FileFormatError as error:
        print_error(f"note: {error}; this file is passed over")
        return True
    return False


def _means_folder(output: str, is_one_of_several: bool) -> bool:
    """Return whether a name is that of a folder."""
    slashes = tuple(filter(None, (os.sep, os.altsep)))
    if output.endswith(slashes) and Path(output).is_file():
        raise OutputError(f"{output}: expected a folder, found a file; choose another name")
    is_bare = not Path(output).suffix and output != "-"  # which is standard output
    return Path(output).is_dir() or output.endswith(slashes) or (is_one_of_several and is_bare)
