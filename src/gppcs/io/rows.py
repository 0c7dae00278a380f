"""Reads rows of numbers and text by pandas, reads records of bytes, and writes both."""

import math
import os
import re
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from io import BufferedReader, StringIO, TextIOWrapper
from itertools import islice, pairwise
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, coordinate_names
from gppcs.engine.memory import size_of
from gppcs.errors import FileFormatError, GppcsError, OutputError
from gppcs.io.format import Reader, Span

BLOCK = 1 << 16  # rows per block: large enough that NumPy's cost per call does not count, small enough for memory
MAX_EXPANSION = 100  # by which files may be smaller than what they unpack to: scans are 4 to 20 times
MISSING = ("", "NA", "N/A", "null", "nan", "NaN", "NAN", "-nan", "-NaN")  # fields that stand for NaN

AsRead: TypeAlias = Callable[[PointCloud], PointCloud]  # what becomes of the points of a file

is_row = re.compile(r"\s*+(?!#|//)\S").match  # whether a line is neither empty nor a comment

_QUOTED = r'"(?:[^"]|"")*+"'
_UNWRITABLE = re.compile("[\0\n\r\ufffd\ud800-\udfff]")  # in text: \ufffd stands for bytes that are not UTF-8


def lines_of(file: BufferedReader) -> Generator[str, None, None]:
    """Yield the rest of a file as lines of text."""
    text = TextIOWrapper(file, encoding="utf-8-sig", errors="replace")
    try:
        while lines := text.readlines(1 << 20):
            yield from lines
    finally:
        if not file.closed:  # the caller closes the file
            text.detach()


def shortened(line: str) -> str:
    """Return a line in quotes for a message, shortened to 60 characters."""
    text = line.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")


def as_count(text: str) -> int | None:
    """Return the value of a text of decimal digits."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 18 else None


def is_number(field: str) -> bool:
    """Return whether a field is a number."""
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field


def fields_of(line: str, delimiter: str | None) -> list[str]:
    """Return the fields of a line, with their quotes but without whitespace around them."""
    if delimiter is None:
        return re.findall(rf"{_QUOTED}(?=\s|$)|\S+", line)
    fields = re.findall(rf"( *{_QUOTED} *(?={delimiter})|[^{delimiter}]*){delimiter}", line.strip(" \r\n") + delimiter)
    return [field.strip() for field in fields]


def bytes_left(file: BufferedReader) -> int:
    """Return the number of bytes from the position in a file to its end."""
    return os.fstat(file.fileno()).st_size - file.tell()


def size_of_repeats(count: int, size: int) -> int:
    """Return the bytes of coordinates that take less than a bit a point in a file: repeats, which no tile divides."""
    return 24 * count if count > 8 * size else 0


def check_unpacked(unpacked: int, size: int, spare: int = 1 << 28) -> None:
    """Raise an error if a file of `size` bytes unpacks to so many that it would fill the memory, or take minutes."""
    if unpacked > MAX_EXPANSION * size + spare:
        raise FileFormatError(
            f"expected a file that unpacks to at most {MAX_EXPANSION} times its {size:,} bytes, found "
            f"{size_of(unpacked)} or more; if you trust it, unpack it first, or write it with less compression"
        )


def damaged(expected: str, found: str, remedy: str = "get the whole file again") -> FileFormatError:
    """Return the error for a file that is not as its format says."""
    return FileFormatError(f"expected {expected}, found {found}; {remedy}")


def ends_early(what: str, index: int, count: int) -> FileFormatError:
    """Return the error for a file that ends early."""
    return FileFormatError(f"the file ends in {what} {index + 1} of {count}; get the whole file again")


@contextmanager
def reported(library: str, expected: str, errors: tuple[type[Exception], ...] = (Exception,)) -> Iterator[None]:
    """Raise the errors that a library raises for damaged files, and panics of Rust, as a FileFormatError."""
    try:
        yield
    except GppcsError:
        raise
    except BaseException as error:
        # A panic is no Exception, and its class cannot be imported.
        if not isinstance(error, errors) and type(error).__name__ != "PanicException":
            raise
        reason = " ".join(str(error).split())[:200]
        reason = reason if " " in reason else f"{type(error).__name__} {reason}".strip()
        raise FileFormatError(
            f"expected {expected}, but {library} reports: {reason}; the file is damaged, or of a kind that {library} "
            "does not read: get it again, or convert it"
        ) from error


def check_length(file: BufferedReader, record_size: int, count: int, what: str = "point") -> None:
    """Raise an error if a file, which is at the first of its records, does not have so many."""
    n_complete = max(bytes_left(file), 0) // record_size if record_size else count
    if n_complete < count:
        raise ends_early(what, n_complete, count)


def read_rows(
    lines: Iterator[str],
    width: int | None = None,
    count: int | None = None,
    what: str = "point",
    delimiter: str | None = None,
    texts: Collection[int] = (),
) -> Iterator[list[Column]]:
    """Read rows as columns of int64, uint64 or float64, and the columns `texts` as text, block by block.

    Without a row, one block is empty: of three columns if no width is given.
    """
    rows, done = islice(filter(is_row, lines), count), 0
    while block := list(islice(rows, BLOCK)):
        width = width or len(fields_of(block[0], delimiter))
        columns = []
        for i, column in _parsed(block, width, delimiter, texts, what, done + 1).items():
            values = column.to_numpy()
            if i in texts:
                values = np.array([_checked(text, FileFormatError) for text in values.tolist()], np.str_)
            elif values.dtype.kind not in "iuf":
                bad = next((k for k, value in enumerate(values.tolist()) if not is_number(str(value))), 0)
                actual = shortened(str(values[bad]))
                raise FileFormatError(f"{what} {done + 1 + bad}: expected a number, found {actual}")
            columns.append(values)
        yield columns
        done += len(block)
    if count is not None and done < count:
        raise ends_early(what, done, count)
    if not done:
        yield [np.empty(0, np.int64)] * (width or 3)


def read_table(
    lines: Iterator[str], width: int | None = None, count: int | None = None, what: str = "point"
) -> list[Column]:
    """Read rows as whole columns."""
    return [np.concatenate(parts) for parts in zip(*read_rows(lines, width, count, what), strict=True)]


def read_fields(
    file: BufferedReader, record: np.dtype[Any], count: int, what: str = "point"
) -> Iterator[dict[str, Column]]:
    """Read rows as the fields of records, of one number or several each, block by block."""
    fields, done = {name: record[name] for name in record.names or ()}, 0
    for block in read_rows(lines_of(file), sum(math.prod(dtype.shape) for dtype in fields.values()), count, what):
        values, columns = iter(block), {}
        for name, dtype in fields.items():
            expected = f"{dtype.base.name} as {name} of {what}"
            parts = [cast(part, dtype.base, expected, done) for part in islice(values, math.prod(dtype.shape))]
            columns[name] = np.stack(parts, axis=1).reshape(-1, *dtype.shape)
        yield columns
        done += len(block[0])


def text_columns(lines: Iterator[str], width: int, delimiter: str | None) -> set[int]:
    """Return which columns are text in the first block of rows."""
    kept = list(islice(filter(is_row, lines), BLOCK))
    table = _parsed(kept, width, delimiter, (), "point", 1) if kept else {}
    return {i for i in table if table[i].dtype.kind not in "iuf"}


def _parsed(lines: list[str], width: int, delimiter: str | None, texts: Collection[int], what: str, first: int) -> Any:
    """Return rows as a table of pandas; `what` and the number of the first row name a row in messages."""
    import pandas  # only here, as it is slow to load

    # The parser of later versions reads every number to its last digit anyway.
    exact: Any = {} if pandas.__version__ >= "3.1" else {"float_precision": "round_trip"}
    try:
        table = pandas.read_csv(
            StringIO("".join(lines)),
            sep=delimiter or r"\s+",
            header=None,
            dtype=dict.fromkeys(texts, str),
            na_values={i: MISSING for i in range(width) if i not in texts},
            keep_default_na=False,
            skipinitialspace=True,
            low_memory=False,
            **exact,
        )
        fault = None if table.shape == (len(lines), width) else f"{len(table):,} rows of {table.shape[1]} columns"
    except ValueError as error:
        fault = " ".join(str(error).split())[:200]
    # Fields that lack at the end of a row are empty.
    uncertain = range(len(lines)) if fault else np.flatnonzero(table[width - 1].isna() | (table[width - 1] == ""))
    for i in uncertain:
        if len(fields_of(lines[i], delimiter)) != width:
            raise FileFormatError(f"{what} {first + i}: expected {width} columns, found {shortened(lines[i])}")
    if fault:
        raise FileFormatError(f"expected {len(lines):,} rows of {width} columns, but pandas reports: {fault}")
    return table


def _checked(text: str, error: type[GppcsError], remedy: str = "") -> str:
    """Return a text that a line and an array of NumPy can hold, which stores all as long as the longest."""
    if _UNWRITABLE.search(text) or len(text) > 1000:
        expected = "text in UTF-8 of at most 1,000 characters without line breaks and zero characters"
        raise error(f"expected {expected}, found {ascii(text)[:60]}{remedy}")
    return text


def cast(values: Column, to: np.dtype[Any], what: str, done: int = 0) -> Column:
    """Return numbers, which `done` others precede, in a type that must represent whole ones; `what` says which."""
    if to.kind in "iu":
        bounds = np.iinfo(to)
        fits = (values == np.rint(values)) & (values >= bounds.min) & (values <= bounds.max)
        if not fits.all():
            row = int(np.argmin(fits))
            raise FileFormatError(f"expected {what} {done + row + 1}, found {shortened(str(values[row]))}")
    with np.errstate(over="ignore"):  # values beyond the range of float32 become infinite
        return values.astype(to)


def at_most(n: int, clouds: Iterable[PointCloud]) -> Iterator[PointCloud]:
    """Yield clouds, cut into chunks of at most n points."""
    for cloud in clouds:
        for start in range(0, max(len(cloud), 1), n):
            yield cloud if len(cloud) <= n else cloud[start : start + n]


def equal_spans(count: int, n: int) -> list[Span]:
    """Divide records into spans of n; the last may be twice as long."""
    return list(pairwise([*range(0, max(1, count - n + 1), n), count]))


def column_chunks(columns: Mapping[str, Column], n: int, span: Span | None = None) -> Iterator[PointCloud]:
    """Yield the clouds of n values each of columns that are mapped into memory."""
    first, last = span or (0, len(columns[coordinate_names(columns)[0]]))
    for start in range(first, max(last, first + 1), n):
        part = slice(start, min(start + n, last))
        yield PointCloud.from_columns({name: np.array(values[part]) for name, values in columns.items()})  # no views


def records_reader(
    file: BufferedReader, record: np.dtype[Any], count: int, as_read: AsRead, what: str = "point"
) -> Reader:
    """Return a reader of packed records, the first of which is at the position of a file."""
    start = file.tell()
    check_length(file, record.itemsize, count, what)

    def chunks(n: int, span: Span | None = None) -> Iterator[PointCloud]:
        table = np.memmap(file, record, "r", start, count) if count else np.empty(0, record)
        return map(as_read, column_chunks({name: table[name] for name in record.names or ()}, n, span))

    return Reader(chunks, count, spans=partial(equal_spans, count))


def blocks_reader(
    file: BufferedReader, blocks: Callable[[BufferedReader], Iterator[dict[str, Column]]], count: int, as_read: AsRead
) -> Reader:
    """Return a reader of columns that are read block by block, from the position of a file on."""
    start = file.tell()

    def chunks(n: int) -> Iterator[PointCloud]:
        file.seek(start)
        return at_most(n, map(as_read, map(PointCloud.from_columns, blocks(file))))

    return Reader(chunks, count)


def write_records(file: BinaryIO, columns: Sequence[Column]) -> None:
    """Write columns (N, ...) as packed little-endian records, block by block."""
    count = len(columns[0])
    # The names of the fields are numbers: those of the columns may have characters that NumPy refuses in a buffer.
    fields = {str(i): values for i, values in enumerate(columns)}
    record = [(name, values.dtype.newbyteorder("<"), values.shape[1:]) for name, values in fields.items()]
    block = np.empty(min(count, BLOCK), record)
    for start in range(0, count, BLOCK):
        part = block[: count - start]
        for name, values in fields.items():
            part[name] = values[start : start + BLOCK]
        file.write(part.data)


def write_rows(file: BinaryIO, columns: Sequence[Column], separator: str = " ", prefix: str = "") -> None:
    """Write columns (N,) as lines of text."""
    for start in range(0, len(columns[0]), BLOCK):
        fields = (texts_of(column[start : start + BLOCK]) for column in columns)
        file.writelines(f"{prefix}{separator.join(row)}\n".encode() for row in zip(*fields, strict=True))


def texts_of(values: Column) -> list[str]:
    """Return each value as the shortest text that reads back as the same value of its type."""
    if values.dtype.kind == "U":
        return list(map(_quoted, values.tolist()))
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype != np.float64:
        texts = list(map(str, values))  # str of a NumPy number is the shortest text for its own type
    else:
        texts = list(map(repr, values.tolist()))
    for i, text in enumerate(texts):
        if "e" in text and 1e-20 < abs(float(values[i])) < 1e20:  # some programs read no exponents
            texts[i] = np.format_float_positional(values[i], trim="0")
    return texts


def _quoted(text: str) -> str:
    """Return a text in quotes, as a field of a line."""
    return '"{}"'.format(_checked(text, OutputError, "; write .npy or .npz").replace('"', '""'))
