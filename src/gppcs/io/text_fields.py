"""Splits the lines of text tables into fields, and keeps columns of text apart from columns of numbers.

Text in double quotes may contain the delimiter; two double quotes in it stand for one. Quotes mark a field as text,
even if it looks like a number, unless the coordinates are in quotes, too.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence

import numpy as np

from gppcs.clouds.columns import Column
from gppcs.errors import FileFormatError, OutputError, shown

_QUOTED = r'"(?:[^"]|"")*+"'
_SPACED = re.compile(rf"{_QUOTED}(?=\s|$)|\S+")
_ENDED = {mark: re.compile(rf"( *{_QUOTED} *(?={mark})|[^{mark}]*){mark}") for mark in (",", ";", "\t")}
MISSING = ("", "NA", "N/A", "null")  # what stands for a number that is missing
_LONGEST = 1000  # characters: NumPy stores all texts of a column as long as the longest
_UNWRITABLE = re.compile("[\0\n\r\ufffd\ud800-\udfff]")  # those, and what stands for bytes that are not UTF-8


def delimiter_of(line: str) -> str | None:
    """Return what separates the fields of a line."""
    bare = re.sub(_QUOTED, '""', line).strip(" \r\n")
    if mark := next((mark for mark, least in ((";", 2), (",", 1), (";", 1)) if bare.count(mark) >= least), None):
        return mark
    parts = bare.split("\t")
    return "\t" if len(parts) > 2 and all(map(_is_one_field, parts)) else None


def _is_one_field(part: str) -> bool:
    """Return whether what stands between two tabs is one field, rather than none or several numbers."""
    words = part.split()
    return len(words) == 1 or not all(map(is_number, words))


def fields_of(line: str, delimiter: str | None) -> list[str]:
    """Return the fields of a line, with their quotes but without whitespace around them."""
    text = line.strip(" \r\n") if delimiter else line.strip()
    found = _SPACED.findall(text) if delimiter is None else _ENDED[delimiter].findall(text + delimiter)
    return [field.strip() for field in found]


def is_number(field: str) -> bool:
    """Return whether a field is a number."""
    try:
        float(field)
    except ValueError:
        return False
    return True


def unquoted(field: str) -> str:
    """Return the text of a field."""
    return field[1:-1].replace('""', '"') if _is_quoted(field) else field


def quoted(text: str) -> str:
    """Return a text in quotes, as a field of a line."""
    if fault := _fault(text):
        raise OutputError(f"expected text {fault}, found {ascii(text)[:60]}; write .npy or .npz")
    return '"{}"'.format(text.replace('"', '""'))


def text_columns(rows: Iterable[Sequence[str]], width: int, axes: Collection[int]) -> list[int] | None:
    """Return which columns are text in some row; None if there are neither texts, nor missing or quoted numbers."""
    others = set(range(width)) - set(axes)
    texts: set[int] = set()
    quotes_mean_text, plain = None, True
    for fields in rows:
        if len(fields) != width:
            continue
        if quotes_mean_text is None:
            quotes_mean_text = not any(_is_quoted(fields[i]) for i in axes)
        for i, field in enumerate(fields):
            if i not in texts and not is_number(field):
                bare = unquoted(field)
                numeric = (bare in MISSING or is_number(bare)) and not (quotes_mean_text and _is_quoted(field))
                plain = plain and not numeric
                if not numeric and i in others:
                    texts.add(i)
    return None if plain and not texts else sorted(texts)


class TextApart:
    """Takes the columns of text out of lines, so that numbers are left."""

    def __init__(self, columns: Collection[int], width: int, delimiter: str | None) -> None:
        self._width, self._delimiter = width, delimiter
        self._texts: dict[int, list[str]] = {i: [] for i in columns}

    def numbers(self, lines: Iterable[str], first_line: int) -> Iterator[str]:
        """Yield the numbers of each line, and keep its texts."""
        for number, line in enumerate(lines, first_line):
            if is_row(line):
                fields = fields_of(line, self._delimiter)
                if len(fields) != self._width:
                    raise FileFormatError(f"line {number}: expected {self._width} columns, found {shown(line.strip())}")
                for i, texts in self._texts.items():
                    if fault := _fault(text := unquoted(fields[i])):
                        raise FileFormatError(f"line {number}: expected text {fault}, found {ascii(text)[:60]}")
                    texts.append(text)
                kept = [unquoted(field) for i, field in enumerate(fields) if i not in self._texts]
                yield (self._delimiter or " ").join("nan" if field in MISSING else field for field in kept) + "\n"
            else:
                yield "\n"

    def taken(self) -> dict[int, Column]:
        """Return the columns of text of the lines since the last call."""
        columns = {i: np.array(texts, dtype=np.str_) for i, texts in self._texts.items()}
        self._texts = {i: [] for i in self._texts}
        return columns


def is_row(line: str) -> bool:
    """Return whether a line is neither empty nor a comment."""
    return not (line.isspace() or line.lstrip().startswith(("#", "//")))


def _is_quoted(field: str) -> bool:
    return re.fullmatch(_QUOTED, field) is not None


def _fault(text: str) -> str | None:
    """Return what is expected of a text that cannot be kept as it is, or None if it can."""
    if _UNWRITABLE.search(text):
        return "in UTF-8 without line breaks and zero characters"
    return f"of at most {_LONGEST:,} characters" if len(text) > _LONGEST else None
