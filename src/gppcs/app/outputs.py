"""Which files a command reads, and which file it writes for each: a file, a folder, or a pattern of names."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

from gppcs import io
from gppcs.app.printing import print_error
from gppcs.errors import FileFormatError, OutputError, file_path
from gppcs.io import text

FIELDS = ("stem", "name", "suffix", "parent")  # of a pattern, named as in `pathlib.Path`
LEVEL = "level"  # the field for the number of a level, and the name of the attribute


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
    """Return where results go: that of each input to a folder or by a pattern, else that of all as one cloud."""
    sources = sources_of(inputs)
    fields = _fields_of(output, (*FIELDS, LEVEL) if levels else FIELDS)
    is_folder = not fields and _means_folder(output.format(), sources != list(inputs) or len(sources) > 1)
    clouds = [[source] for source in sources] if is_folder or fields - {LEVEL} else [sources]

    def target(source: Path, number: int) -> Path:
        if is_folder:
            return Path(output.format(), source.name)
        name, stem = source.name, io.inner_name(source).stem  # the suffix of a compression belongs to the suffix
        values = {"stem": stem, "name": name, "suffix": name[len(stem) :], "parent": source.parent}
        return file_path(output.format(**values, level=number))

    outputs = []
    first_source: dict[Path, Path] = {}
    for cloud in clouds:
        targets = [target(cloud[0], number) for number in range(levels if LEVEL in fields else 1)]
        if (other := first_source.setdefault(targets[0], cloud[0])) is not cloud[0]:
            raise OutputError(
                f"{output}: expected inputs with different names, found that {other} and {cloud[0]} both go to "
                f"{targets[0]}; rename one, or write a pattern with {{parent}}, {{stem}} and {{suffix}}"
            )
        outputs.append(Output(cloud, targets, is_folder or bool(fields), format))
    return outputs


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
    """Return whether a name without fields is that of a folder."""
    slashes = tuple(filter(None, (os.sep, os.altsep)))
    if output.endswith(slashes) and Path(output).is_file():
        raise OutputError(f"{output}: expected a folder, found a file; choose another name")
    is_bare = not Path(output).suffix and output != "-"  # which is standard output
    return Path(output).is_dir() or output.endswith(slashes) or (is_one_of_several and is_bare)


def _fields_of(pattern: str, fields: Sequence[str]) -> set[str]:
    """Return the names of the fields in a pattern, after checking that these exist."""
    try:
        parts = list(Formatter().parse(pattern))
    except ValueError:
        rule = "write {{ and }} for braces in a name"
        raise OutputError(f"{pattern}: expected a pattern of names, found single braces; {rule}") from None
    for _, name, details, conversion in parts:
        field = f"{name}" + (f"!{conversion}" if conversion else "") + (f":{details}" if details else "")
        if name is not None and field not in fields:
            expected = ", ".join(f"{{{name}}}" for name in fields)
            raise OutputError(f"{pattern}: expected the fields {expected}, found {{{field}}}")
    return {name for _, name, _, _ in parts if name}
