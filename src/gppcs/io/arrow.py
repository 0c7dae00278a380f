"""Reads and writes tables in Parquet and Feather files, by PyArrow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from io import BufferedReader
from typing import Any, BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.columns import Column, cloud_of_columns, coordinate_names
from gppcs.clouds.header import Header
from gppcs.engine.extras import require_pyarrow
from gppcs.errors import FileFormatError
from gppcs.io.columns import columns_of
from gppcs.io.format import Format, Reader, from_start, keeping
from gppcs.io.rows import at_most, ends_early, reported

_ROWS = 1 << 20  # of a block: what Parquet usually has in a row group
_ABOUT_COLUMNS = b"pandas"  # metadata that describe the columns, so that nothing is lost without them
_MOST_PADDING = 64  # how many times the memory of its texts an array of texts may take
_MOST_NUMBERS = 1 << 20  # in each row of a fixed-size list


@dataclass(frozen=True, eq=False)
class ArrowHeader(Header):
    """What a Parquet or Feather file says of the whole table: the metadata of its schema."""

    metadata: Mapping[bytes, bytes] = field(default_factory=dict)

    def contents(self) -> list[str]:
        """Return the names of the metadata in words, but for those that only describe the columns."""
        return [f"metadata {key.decode('utf-8', 'replace')}" for key in self.metadata if key != _ABOUT_COLUMNS]


def read_parquet(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read a Parquet file in chunks."""
    require_pyarrow()
    import pyarrow.parquet

    with _errors_of_file():
        table = pyarrow.parquet.ParquetFile(file)
        schema, count = table.schema_arrow, table.metadata.num_rows
        kept = _kept(schema, attributes)
        done = 0
        for batch in table.iter_batches(min(rows, _ROWS), columns=kept):
            done += batch.num_rows
            yield _cloud(batch, schema)
        if done != count:
            raise ends_early("row", done, count)
        if not count:
            yield _cloud(_no_rows(schema).select(kept), schema)


def count_parquet(file: BufferedReader) -> int:
    """Return how many points a Parquet file has, as its footer says."""
    require_pyarrow()
    import pyarrow.parquet

    with _errors_of_file():
        return int(pyarrow.parquet.ParquetFile(file).metadata.num_rows)


def _errors_of_file() -> AbstractContextManager[None]:
    """Turn the errors that PyArrow raises for damaged files into ours."""
    errors = (OSError, ValueError, KeyError, TypeError, OverflowError, MemoryError)
    return reported("pyarrow", "a whole table", (require_pyarrow().ArrowException, *errors))


def read_feather(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read a Feather file of version 2, which is an Arrow file, in chunks."""
    pyarrow = require_pyarrow()
    with _errors_of_file():
        table = pyarrow.ipc.open_file(file)
        kept = _kept(table.schema, attributes)
        for i in range(table.num_record_batches):
            yield from at_most(rows, [_cloud(table.get_batch(i).select(kept), table.schema)])
        if not table.num_record_batches:
            yield _cloud(_no_rows(table.schema).select(kept), table.schema)


def _no_rows(schema: Any) -> Any:
    pyarrow = require_pyarrow()
    return pyarrow.record_batch([pyarrow.array([], kind) for kind in schema.types], schema=schema)


def _kept(schema: Any, attributes: bool) -> list[str]:
    """Return the columns to read; raise an error if a cloud does not hold the columns."""
    names = list(schema.names)
    for i, name in enumerate(names):
        if name in names[:i]:
            raise FileFormatError(f"expected columns of different names, found {name!r} twice; rename one")
        _check_type(name, schema.field(i).type)
    axes = coordinate_names(names)
    return names if attributes else list(axes)


def _cloud(batch: Any, schema: Any) -> PointCloud:
    """Return the cloud of a batch of a table whose schema has been checked."""
    batch.validate(full=True)  # damaged texts would crash what reads them
    names = batch.schema.names
    columns = {name: _values(name, column) for name, column in zip(names, batch.columns, strict=True)}
    return replace(cloud_of_columns(columns), header=ArrowHeader(dict(schema.metadata or {})))


def _check_type(name: str, kind: Any) -> None:
    """Raise an error if a column has a type that a cloud does not hold."""
    pyarrow = require_pyarrow()
    types = pyarrow.types
    kind = kind.value_type if types.is_dictionary(kind) else kind
    if types.is_fixed_size_list(kind):
        if kind.list_size > _MOST_NUMBERS:
            raise FileFormatError(f"expected at most {_MOST_NUMBERS:,} numbers in each row of {name!r}, found more")
        if _is_number(kind.value_type):
            return
    if not (_is_number(kind) or types.is_string(kind) or types.is_large_string(kind)):
        raise FileFormatError(
            f"expected columns of numbers, truth values or texts, or lists of fixed size, found {kind} in {name!r}; "
            "convert or remove the column"
        )


def _is_number(kind: Any) -> bool:
    types = require_pyarrow().types
    return types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)


def _values(name: str, column: Any) -> Column:
    """Return a block of a column as an array."""
    pyarrow = require_pyarrow()
    types = pyarrow.types
    if types.is_dictionary(column.type):
        column = column.dictionary_decode()
    if types.is_fixed_size_list(column.type):
        _check_no_nulls(name, column)
        size = column.type.list_size
        return _values(name, column.flatten()).reshape(len(column), size)
    if not types.is_floating(column.type):
        _check_no_nulls(name, column)
    if _is_number(column.type):
        values = column.to_numpy(zero_copy_only=False)  # null becomes NaN
        return np.asarray(values, column.type.to_pandas_dtype())
    return _texts(name, column)


def _check_no_nulls(name: str, column: Any) -> None:
    if column.null_count:
        raise FileFormatError(
            f"expected a value for each point in {name!r}, found {column.null_count:,} missing; fill them or remove "
            "the column"
        )


def _texts(name: str, column: Any) -> Column:
    texts = column.to_pylist()
    longest, total = max(map(len, texts), default=0), sum(map(len, texts))
    if longest * len(texts) > _MOST_PADDING * (total + _ROWS):
        raise FileFormatError(
            f"expected texts of similar length in {name!r}, found one of {longest:,} characters; shorten or remove it"
        )
    if any(text.endswith("\0") for text in texts):
        raise FileFormatError(f"expected texts without a zero character at the end in {name!r}, found one; remove it")
    return np.array(texts, f"<U{max(longest, 1)}")


def write_parquet(file: BinaryIO, cloud: PointCloud) -> None:
    """Write a Parquet file with a column for each coordinate and attribute; of several numbers, a fixed-size list."""
    require_pyarrow()
    import pyarrow.parquet

    pyarrow.parquet.write_table(_table(cloud), file, row_group_size=_ROWS)


def write_feather(file: BinaryIO, cloud: PointCloud) -> None:
    """Write a Feather file of version 2, compressed by LZ4, in the manner of `write_parquet`."""
    pyarrow, table = require_pyarrow(), _table(cloud)
    options = pyarrow.ipc.IpcWriteOptions(compression="lz4")
    with pyarrow.ipc.new_file(file, table.schema, options=options) as writer:
        writer.write_table(table, _ROWS)


def _table(cloud: PointCloud) -> Any:
    pyarrow = require_pyarrow()
    columns = {}
    for name, values in columns_of(cloud, flat=False, named=str).items():
        dtype = np.dtype(np.float64) if name in "xyz" and values.dtype.itemsize > 8 else values.dtype
        column = pyarrow.array(np.ascontiguousarray(values, dtype.newbyteorder("=")).reshape(-1))
        several = pyarrow.FixedSizeListArray.from_arrays
        columns[name] = column if values.ndim == 1 else several(column, values.shape[1])
    metadata = dict(cloud.header.metadata) if isinstance(cloud.header, ArrowHeader) else None
    return pyarrow.table(columns).replace_schema_metadata(metadata)


def open_parquet(file: BufferedReader) -> Reader:
    """Open a Parquet file."""
    return Reader(partial(from_start, read_parquet, file), count_parquet(file))


def open_feather(file: BufferedReader) -> Reader:
    """Open a Feather file."""
    return Reader(partial(from_start, read_feather, file))


def _stored(cloud: PointCloud) -> PointCloud:
    """Return a cloud as a table stores it."""
    require_pyarrow()  # before long work, not at its end
    return keeping(cloud, lambda name, values: _is_storable(values), ArrowHeader)


def _is_storable(values: Column) -> bool:
    if values.dtype.kind == "U":
        return values.ndim == 1
    return values.dtype.kind in "biuf" and values.dtype.itemsize <= 8 and values.ndim <= 2 and values.shape[1:] != (0,)


FORMATS = (
    Format(
        "Parquet",
        (".parquet",),
        open_parquet,
        write_parquet,
        lambda start, size: start.startswith(b"PAR1"),
        _stored,
    ),
    Format(
        "Feather",
        (".feather", ".arrow"),
        open_feather,
        write_feather,
        lambda start, size: start.startswith(b"ARROW1\0\0"),
        _stored,
    ),
)
