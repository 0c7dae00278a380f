"""Which files a command reads, and which file it writes for each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gppcs import io
from gppcs.app.printing import print_error
from gppcs.errors import FileFormatError, OutputError, file_path
from gppcs.io import text

LEVEL = "level"  # the name of the attribute
LEVEL_FIELD = "{level}"  # stands for the number of a level in the name of its file


@dataclass(frozen=True)
class Output:
    """The files of one cloud, and where its result goes: to one file, or to one for each level, coarse to fine."""

    sources: list[Path]
    targets: list[Path]
    makes_folders: bool = False
    format: str | None = None  # otherwise, the names tell it

    @property
    def input(self) -> str | list[str]:
        """The name of the file, or those of several."""
        names = list(map(str, self.sources))
        return names if len(names) > 1 else names[0]

    @property
    def input_title(self) -> str:
        """The name of the first file, and how many others there are."""
        return f"{self.sources[0]}{f' and {len(self.sources) - 1} more' if len(self.sources) > 1 else ''}"

    @property
    def title(self) -> str:
        """The names of the files."""
        return f"{self.input_title} → {', '.join(map(str, self.targets))}"

    def check(self, force: bool) -> None:
        """Check before long work that the sources exist and that gppcs can write the targets."""
        for source in self.sources:
            if not io.is_standard(source):
                source.stat()  # a missing input is reported before its name is taken for that of the output
        for target in self.targets:
            io.format_to_write(target, self.format)
            io.check_writable(target, force, self.makes_folders)


def check_output(output: Path, inputs: Sequence[Path], force: bool, suffixes: Sequence[str] = ()) -> None:
    """Check that the one file of a command can be written, has a fitting name and is no input; call it before work."""
    io.check_distinct([output], inputs)
    if suffixes and not io.is_standard(output) and io.inner_name(output).suffix.lower() not in suffixes:
        raise OutputError(f"{output}: expected a name that ends in {suffixes[0]}; choose another")
    io.check_writable(output, force)


def outputs_of(inputs: Sequence[Path], output: str, format: str | None = None, levels: int = 0) -> list[Output]:  # noqa: A002
    """Return where results go: that of each input to a folder, else that of all as one cloud to a file."""
    sources = sources_of(inputs)
    if LEVEL_FIELD in output:
        if not levels:
            raise OutputError(f"{output}: expected {LEVEL_FIELD} with `levels`; choose another name")
        targets = [file_path(output.replace(LEVEL_FIELD, str(number))) for number in range(levels)]
        return [Output(sources, targets, makes_folders=True, format=format)]
    if not _means_folder(output, sources != list(inputs) or len(sources) > 1):
        return [Output(sources, [file_path(output)], format=format)]
    by_name: dict[str, Path] = {}
    for source in sources:
        if (other := by_name.setdefault(source.name, source)) is not source:
            raise OutputError(
                f"{output}: expected inputs with different names, found {other} and {source}; rename one, or choose "
                "a folder for each"
            )
    return [Output([source], [Path(output, source.name)], makes_folders=True, format=format) for source in sources]


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
