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
    """The output file of each input.

    Attributes
    ----------
    targets : dict of path to path
        Output files by input, in the order of the inputs.
    makes_folders : bool
        Whether the folders of the output files are made if they are missing.
    format : str, optional
        Suffix of the format of all output files. By default, their names tell.
    ascii : bool, optional
        Whether they are text, if their format has a choice.
    """

    targets: dict[Path, Path]
    makes_folders: bool
    format: str | None = None
    ascii: bool | None = None

    def check(self, target: Path, force: bool) -> None:
        """Check that an output file can be written, in a format that gppcs writes. Call it before long work."""
        from gppcs import io

        io.format_to_write(target, self.format, self.ascii)
        if not io.is_standard(target):
            io.check_writable(target, force, makes_folders=self.makes_folders)

    def make_folder(self, target: Path) -> None:
        """Make the folder of an output file if it is missing. Call it right before the file is written."""
        if self.makes_folders:
            target.parent.mkdir(parents=True, exist_ok=True)


def outputs_of(
    inputs: Sequence[Path],
    output: str,
    format: str | None = None,  # noqa: A002
    ascii: bool | None = None,  # noqa: A002
) -> Outputs:
    """Return the output file of each input."""
    sources = sources_of(inputs)
    several = len(sources) > 1 or any(path.is_dir() or _is_list(path) for path in inputs)
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
        return Outputs({sources[0]: file_path(output)}, makes_folders=False, format=format, ascii=ascii)
    _check_different(output, sources, targets)
    return Outputs(dict(zip(sources, targets, strict=True)), makes_folders=True, format=format, ascii=ascii)


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


def _is_list(path: Path) -> bool:
    from gppcs.io import VPC

    return path.suffix.lower() == VPC


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
    try:
        parts = list(Formatter().parse(pattern))
    except ValueError:
        raise OutputError(
            f"{pattern}: expected a pattern such as '{{stem}}_small.ply', found single braces; "
            "write {{ and }} for braces in a name"
        ) from None
    filled = ""
    for text, field, details, conversion in parts:
        filled += text
        if field is not None and (field not in FIELDS or details or conversion):
            raise OutputError(
                f"{pattern}: expected the fields {', '.join(f'{{{name}}}' for name in FIELDS)}, "
                f"found {{{field}{f'!{conversion}' if conversion else ''}{f':{details}' if details else ''}}}"
            )
        if field is not None:
            filled += _names(source)[field]
    return file_path(filled)


def _names(source: Path) -> dict[str, str]:
    """Return what stands for each of `FIELDS`. The suffix of a compression belongs to the suffix of a file."""
    from gppcs.io import inner_name

    inner = inner_name(source)
    suffix = source.name[len(inner.stem) :]
    return {"stem": inner.stem, "name": source.name, "suffix": suffix, "parent": str(source.parent)}


def _check_different(output: str, sources: list[Path], targets: list[Path]) -> None:
    """Raise an error if two inputs have one output file."""
    known: dict[Path, Path] = {}
    for source, target in zip(sources, targets, strict=True):
        if target in known:
            raise OutputError(
                f"{output}: expected inputs with different names, found that {known[target]} and {source} both go to "
                f"{target}; rename one, or write a pattern with {{parent}}, {{stem}} and {{suffix}}"
            )
        known[target] = source
