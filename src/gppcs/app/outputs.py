"""Which files a command reads, and which file it writes for each: a file, a folder, or a pattern of names."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

from gppcs.app.printing import print_error
from gppcs.errors import FileFormatError, OutputError, file_path

FIELDS = ("stem", "name", "suffix", "parent")  # of a pattern, named as in `pathlib.Path`


@dataclass(frozen=True)
class Outputs:
    """The output files by input, in the order of the inputs, whose names tell the format unless it is given."""

    targets: dict[Path, Path]
    makes_folders: bool
    format: str | None = None

    def check(self, target: Path, force: bool) -> None:
        """Check that an output file can be written, in a format that gppcs writes. Call it before long work."""
        from gppcs import io

        io.format_to_write(target, self.format)
        if not io.is_standard(target):
            io.check_writable(target, force, makes_folders=self.makes_folders)

    def make_folder(self, target: Path) -> None:
        """Make the folder of an output file if it is missing. Call it right before the file is written."""
        if self.makes_folders:
            target.parent.mkdir(parents=True, exist_ok=True)


def check_output(output: Path, suffixes: Sequence[str], inputs: Sequence[Path], force: bool) -> None:
    """Check that the one file of a command can be written, has a fitting name and is no input; call it before work."""
    from gppcs import io

    io.check_distinct([output], inputs)
    if not io.is_standard(output) and io.inner_name(output).suffix.lower() not in suffixes:
        raise OutputError(f"{output}: expected a name that ends in {suffixes[0]}; choose another")
    io.check_output(output, force)


def outputs_of(inputs: Sequence[Path], output: str, format: str | None = None) -> Outputs:  # noqa: A002
    """Return the output file of each input."""
    sources = sources_of(inputs)
    several = sources != list(inputs) or len(sources) > 1
    if "{" in output or "}" in output:
        targets = [_filled(output, source) for source in sources]
    elif _means_folder(output, several):
        targets = [Path(output, source.name) for source in sources]
    elif several:
        raise OutputError(
            f"{output}: expected a folder for the results of {len(sources)} inputs, found the name of a file; "
            "end it with a slash, or write a pattern such as '{stem}_small.ply'"
        )
    else:
        return Outputs({sources[0]: file_path(output)}, makes_folders=False, format=format)
    known: dict[Path, Path] = {}
    for source, target in zip(sources, targets, strict=True):
        if (other := known.setdefault(target, source)) is not source:
            raise OutputError(
                f"{output}: expected inputs with different names, found that {other} and {source} both go to "
                f"{target}; rename one, or write a pattern with {{parent}}, {{stem}} and {{suffix}}"
            )
    return Outputs(dict(zip(sources, targets, strict=True)), makes_folders=True, format=format)


def sources_of(inputs: Sequence[Path]) -> list[Path]:
    """Return the files that the inputs of a command stand for."""
    from gppcs.io import files_of

    files = []
    for path in inputs:
        if path.is_dir():
            files += [file for file in _files_in(path) if not _is_other_text(file)]
        else:
            files += files_of(path)
    return files


def _is_other_text(path: Path) -> bool:
    """Tell whether a file in a folder is a text without points, such as notes, and say so."""
    from gppcs.io.cloud_files import CloudFiles
    from gppcs.io.text import FORMATS

    if not any(known.has_suffix(path.suffix) for known in FORMATS):
        return False
    try:
        with CloudFiles([path]) as files:
            files.head()
    except FileFormatError as error:
        print_error(f"note: {error.command}; this file is passed over")
        return True
    return False


def _files_in(folder: Path) -> list[Path]:
    from gppcs.io import COMPRESSIONS, FORMATS

    suffixes = tuple(
        suffix + compression for known in FORMATS for suffix in known.suffixes for compression in ("", *COMPRESSIONS)
    )
    files = sorted(
        path
        for path in folder.iterdir()
        if path.name.lower().endswith(suffixes) and not path.name.startswith(".") and path.is_file()
    )
    if not files:
        raise FileFormatError(
            f"{folder}: expected a folder with files of formats that gppcs reads, such as .ply, found none"
        )
    return files


def _means_folder(output: str, several: bool) -> bool:
    slashes = tuple(filter(None, (os.sep, os.altsep)))
    if output.endswith(slashes) and Path(output).is_file():
        raise OutputError(f"{output}: expected a folder, found a file; choose another name")
    return Path(output).is_dir() or output.endswith(slashes) or (several and not Path(output).suffix)


def _filled(pattern: str, source: Path) -> Path:
    """Return a pattern with the names of an input in its fields."""
    from gppcs.io import inner_name

    stem = inner_name(source).stem  # the suffix of a compression belongs to the suffix
    names = (stem, source.name, source.name[len(stem) :], str(source.parent))
    try:
        parts = list(Formatter().parse(pattern))
    except ValueError:
        raise OutputError(
            f"{pattern}: expected a pattern such as '{{stem}}_small.ply', found single braces; "
            "write {{ and }} for braces in a name"
        ) from None
    filled = ""
    for text, name, details, conversion in parts:
        filled += text
        if name is None:
            continue
        field = name + (f"!{conversion}" if conversion else "") + (f":{details}" if details else "")
        if field not in FIELDS:
            known = ", ".join(f"{{{each}}}" for each in FIELDS)
            raise OutputError(f"{pattern}: expected the fields {known}, found {{{field}}}")
        filled += names[FIELDS.index(field)]
    return file_path(filled)
