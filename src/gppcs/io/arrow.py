"""Reads and writes tables in Parquet and Feather files, by PyArrow."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from io import BufferedReader
from mmap import ACCESS_READ, mmap
from struct import unpack_from
from typing import Any, BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column
from gppcs.engine.extras import require_pyarrow
from gppcs.errors import FileFormatError
from gppcs.io.columns import columns_of
from gppcs.io.format import Format, Reader, begins, keeping
from gppcs.io.rows import BLOCK, at_most, bytes_left, check_unpacked, ends_early, reported, size_of_repeats

_reported = partial(reported, "pyarrow", "a whole table")
DICTIONARY, RECORD_BATCH = 2, 3  # kinds of messages of Arrow
_ROWS = 1 << 20  # of a block: what Parquet usually has in a row group


def open_parquet(file: BufferedReader) -> Reader:
    """Open a Parquet file."""
    require_pyarrow()
    import pyarrow.parquet

    size = bytes_left(file)
    with _reported():
        table = pyarrow.parquet.ParquetFile(file)
        _check_names(table.schema_arrow.names)
        # PyArrow reads a group of rows at once. It ends the process where the size of a column is damaged.
        sizes = [table.metadata.row_group(i).total_byte_size for i in range(table.metadata.num_row_groups)]
        count, schema = table.metadata.num_rows, table.schema_arrow
        memory = max([min(count, _ROWS) * sum(map(_width, schema.types)), *sizes])
        rows = _ROWS if all(map(_width, schema.types)) else BLOCK  # texts may be long
        return _reader(schema, lambda n: table.iter_batches(min(n, rows)), count, size, memory)


def open_feather(file: BufferedReader) -> Reader:
    """Open a Feather file of version 2, which is an Arrow file."""
    require_pyarrow()
    import pyarrow.dataset

    size = bytes_left(file)
    with _reported():
        table = pyarrow.ipc.open_file(file)
        _check_names(table.schema.names)
        count = pyarrow.dataset.IpcFileFormat().make_fragment(file).count_rows()
        batches = range(table.num_record_batches)
        sizes = _unpacked_sizes(file)
        check_unpacked(sum(sizes), size)
        memory = max(sizes, default=0)
        return _reader(table.schema, lambda n: map(table.get_batch, batches), count, size, memory)


def _unpacked_sizes(file: BufferedReader) -> list[int]:
    """Return the bytes of each record batch and dictionary of an Arrow file when it is unpacked."""
    pyarrow = require_pyarrow()
    content = memoryview(mmap(file.fileno(), 0, access=ACCESS_READ))  # of which only the starts of buffers are read
    messages = pyarrow.ipc.MessageReader.open_stream(pyarrow.BufferReader(content[len("ARROW1\0\0") :]))
    sizes = []
    with suppress(StopIteration):
        while True:
            message = messages.read_next_message()
            buffers, is_packed = _buffers(message.metadata.to_pybytes())
            if is_packed:  # each buffer begins with its size; -1 if it is not packed
                starts = (int.from_bytes(message.body[at : at + 8], "little", signed=True) for at, n in buffers if n)
                sizes.append(sum(start if start >= 0 else message.body.size for start in starts))
            else:
                sizes.append(sum(n for _, n in buffers))
    return sizes


def _buffers(metadata: bytes) -> tuple[list[list[int]], bool]:
    """Return starts and lengths of the buffers of an Arrow message, and if they are packed (see its Message.fbs)."""

    def field(table: int, number: int) -> int:
        """Return where a field of a table of FlatBuffers is; 0 if it is not there."""
        fields = table - unpack_from("<i", metadata, table)[0]
        is_there = 6 + 2 * number <= unpack_from("<H", metadata, fields)[0]
        offset = unpack_from("<H", metadata, fields + 4 + 2 * number)[0] if is_there else 0
        return table + offset if offset else 0

    def behind(place: int) -> int:
        """Return where what a field refers to is."""
        return place + int(unpack_from("<I", metadata, place)[0])

    message = behind(0)
    kind, batch = metadata[field(message, 1)], behind(field(message, 2))
    if kind not in (DICTIONARY, RECORD_BATCH):
        return [], False
    if kind == DICTIONARY:
        batch = behind(field(batch, 1))
    vector = behind(field(batch, 2))
    pairs = np.frombuffer(metadata, "<i8", 2 * unpack_from("<I", metadata, vector)[0], vector + 4)
    return pairs.reshape(-1, 2).tolist(), field(batch, 3) > 0


def _width(kind: Any) -> int:
    """Return the bytes of a value in a column, with those that Parquet takes for each of a list; 0 if they differ."""
    if hasattr(kind, "list_size"):
        return int(kind.list_size) * (_width(kind.value_type) + 8)
    try:
        return -(-kind.bit_width // 8)
    except ValueError:
        return 0


def _check_names(names: list[str]) -> None:
    if len(set(names)) < len(names):
        raise FileFormatError(f"expected columns of different names, found {', '.join(map(repr, names))}; rename some")


def _reader(schema: Any, batches: Callable[[int], Iterable[Any]], count: int, size: int, memory: int) -> Reader:
    """Return a reader of a table of `size` bytes, whose batches have at most n rows and take some memory."""
    check_unpacked(count * sum(map(_width, schema.types)), size)
    empty = _cloud(require_pyarrow().RecordBatch.from_pylist([], schema))

    def chunks(n: int) -> Iterator[PointCloud]:
        done = unpacked = 0
        with _reported():
            for batch in batches(n):
                unpacked += batch.nbytes  # with texts, whose lengths no header tells
                check_unpacked(unpacked, size)
                if batch.num_rows:
                    yield from at_most(n, [_cloud(batch)])
                done += batch.num_rows
            if done != count:
                raise ends_early("row", done, count)
            if not done:
                yield empty

    return Reader(chunks, count, memory=max(memory, size_of_repeats(count, size)))


def _cloud(batch: Any) -> PointCloud:
    """Return the cloud of some rows of a table, which has x, y and z, or one column of points, as GeoArrow has it."""
    batch.validate(full=True)  # damaged texts would crash what reads them
    columns = {name: _values(name, column) for name, column in zip(batch.schema.names, batch.columns, strict=True)}
    points = [name for name, values in columns.items() if values.shape[1:] == (3,) and values.dtype.kind == "f"]
    if len(points) == 1 and not {"x", "y", "z"} & {name.lower() for name in columns}:
        columns |= zip("xyz", columns.pop(points[0]).T, strict=True)
    return PointCloud.from_columns(columns)


def _values(name: str, column: Any) -> Column:
    """Return a block of a column as an array."""
    types = require_pyarrow().types
    column = getattr(column, "storage", column)  # of a type that another library has registered
    if types.is_struct(column.type) and [part.name for part in column.type] == ["x", "y", "z"]:
        return np.stack([_values(name, part) for part in column.flatten()], axis=1)
    if types.is_dictionary(column.type):
        texts = (value for value in column.dictionary.to_pylist() if isinstance(value, str))
        if (longest := max(map(len, texts), default=0)) * len(column) > 1 << 30:
            raise _too_long(name, longest)
        column = column.dictionary_decode()
    kind = column.type
    if column.null_count and not types.is_floating(kind):
        raise FileFormatError(
            f"expected a value for each point in {name!r}, found {column.null_count:,} missing; fill them or remove "
            "the column"
        )
    if types.is_fixed_size_list(kind) and types.is_primitive(kind.value_type) and kind.list_size <= 1 << 20:
        return _values(name, column.flatten()).reshape(len(column), kind.list_size)
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind):
        return np.asarray(column.to_numpy(zero_copy_only=False), kind.to_pandas_dtype())  # null becomes NaN
    if types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind):
        return _texts(name, column.to_pylist())
    raise FileFormatError(
        f"expected columns of numbers, truth values or texts, or lists of fixed size, found {kind} in {name!r}; "
        "convert or remove the column"
    )


def _texts(name: str, texts: list[str]) -> Column:
    """Return texts as an array, which drops zero characters at their ends."""
    longest, total = max(map(len, texts), default=0), sum(map(len, texts))
    if longest * len(texts) > 64 * (total + _ROWS):  # NumPy stores all as long as the longest
        raise _too_long(name, longest)
    return np.array(texts, f"<U{max(longest, 1)}")


def _too_long(name: str, longest: int) -> FileFormatError:
    return FileFormatError(
        f"expected texts of similar length in {name!r}, found one of {longest:,} characters; shorten or remove it"
    )


def write_parquet(file: BinaryIO, cloud: PointCloud) -> None:
    """Write a Parquet file with a column for each coordinate and attribute; of several numbers, a fixed-size list."""
    require_pyarrow()
    import pyarrow.parquet

    pyarrow.parquet.write_table(_table(cloud), file, row_group_size=_ROWS)


def write_feather(file: BinaryIO, cloud: PointCloud) -> None:
    """Write a Feather file of version 2, compressed by LZ4, in the manner of `write_parquet`."""
    require_pyarrow()
    import pyarrow.feather

    pyarrow.feather.write_feather(_table(cloud), file, compression="lz4", chunksize=_ROWS)


def _table(cloud: PointCloud) -> Any:
    pyarrow = require_pyarrow()
    columns = {}
    for name, values in columns_of(cloud, flat=False).items():
        dtype = np.dtype(np.float64) if name in "xyz" and values.dtype.itemsize > 8 else values.dtype
        column = pyarrow.array(np.ascontiguousarray(values, dtype.newbyteorder("=")).reshape(-1))
        is_flat = values.ndim == 1
        columns[name] = column if is_flat else pyarrow.FixedSizeListArray.from_arrays(column, values.shape[1])
    return pyarrow.table(columns)


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as a table stores it."""
    require_pyarrow()  # before long work, not at its end

    def holds(name: str, values: Column) -> bool:
        if values.dtype.kind == "U":
            return values.ndim == 1
        is_number = values.dtype.kind in "biuf" and values.dtype.itemsize <= 8
        return is_number and values.ndim <= 2 and values.shape[1:] != (0,)

    return keeping(cloud, holds)


FORMATS = (
    Format("Parquet", (".parquet",), open_parquet, write_parquet, begins(rb"PAR1"), _stored),
    Format("Feather", (".feather", ".arrow"), open_feather, write_feather, begins(rb"ARROW1\0\0"), _stored),
)
