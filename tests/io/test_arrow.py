"""Parquet and Feather files of PyArrow and pandas, every type of column, and damage."""

import numpy as np
import pytest

from formats import losses
from gppcs import simplify
from gppcs.errors import FileFormatError, InputError
from gppcs.io import CloudFiles, read, write
from gppcs.io.arrow import open_feather

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
feather = pytest.importorskip("pyarrow.feather")

SUFFIXES = [".parquet", ".feather"]
AXES = {axis: pa.array([1.0, 2.0, 3.0], pa.float32()) for axis in "xyz"}


def stored(path, table):
    """Write a table by PyArrow; return the path."""
    if path.suffix == ".parquet":
        try:
            pq.write_table(table, path)
        except pa.ArrowNotImplementedError as error:
            pytest.skip(f"this PyArrow cannot write the table: {error}")
    else:
        feather.write_feather(table, path, compression="uncompressed")
    return path


def loaded(path):
    return pq.read_table(path) if path.suffix == ".parquet" else feather.read_table(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("rows", [7, 100_000])
def test_points_in_small_batches_are_counted(folder, suffix, rows):
    table = pa.table({axis: np.arange(150_000, dtype=np.float32) for axis in "xyz"})
    path = folder / f"batches{suffix}"
    if suffix == ".parquet":
        pq.write_table(table[:3000] if rows == 7 else table, path, row_group_size=rows)
    else:
        feather.write_feather(table[:3000] if rows == 7 else table, path, chunksize=rows)
    with CloudFiles([path]) as files:
        assert (files.n_points, files.is_counted) == (len(read(path)), True)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_long_text_of_one_or_many_points_does_not_fill_the_memory(folder, suffix):
    shared = pa.DictionaryArray.from_arrays(pa.array(np.zeros(100_000, np.int32)), pa.array(["a" * 60_000]))
    single = pa.array(["a"] * 99_999 + ["long" * 1_000_000])
    for texts, length in ((shared, "60,000"), (single, "4,000,000")):
        table = pa.table({axis: np.zeros(100_000) for axis in "xyz"} | {"label": texts})
        with pytest.raises(FileFormatError, match=f"'label', found one of {length} characters"):
            read(stored(folder / f"long{suffix}", table))


def test_texts_that_unpack_from_nothing_are_refused(tmp_path):
    count = 450_000
    texts = pa.array(["a" * 1000]).take(pa.array(np.zeros(count, int)))
    table = pa.table({axis: np.zeros(count) for axis in "xyz"} | {"label": texts})
    pq.write_table(table, tmp_path / "texts.parquet")
    feather.write_feather(table, tmp_path / "texts.feather", compression="zstd")
    for path in tmp_path.iterdir():
        with pytest.raises(FileFormatError, match="unpacks to at most 100 times"):
            read(path)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "uncompressed"])
def test_the_memory_of_feather_files_is_that_of_their_largest_batch(tmp_path, compression):
    count = 100_000
    texts = pa.array(["a" * 1000]).take(pa.array(np.zeros(count, int)))
    table = pa.table({axis: np.zeros(count) for axis in "xyz"} | {"label": texts, "kind": texts.dictionary_encode()})
    path = tmp_path / "texts.feather"
    feather.write_feather(table, path, compression=compression, chunksize=count)
    with path.open("rb") as file:
        assert open_feather(file).memory == pytest.approx(table.drop_columns("kind").nbytes, rel=0.02)
    with pytest.raises(InputError, match="MB of memory, as the files are unpacked"):
        simplify(path, n_points=10, memory="90MB")


def test_lists_of_many_numbers_need_memory_before_they_are_unpacked(folder):
    zeros, count = np.zeros(1000), 20_000
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(1000 * count, np.int8)), count)
    path = stored(folder / "lists.parquet", pa.table({"x": zeros, "y": zeros, "z": zeros, "lists": lists}))
    with pytest.raises(InputError, match="MB of memory, as the files are unpacked"):
        simplify(path, n_points=10, memory="300MB")


def test_damaged_sizes_of_a_column_do_not_end_the_process(folder):
    path = stored(folder / "sizes.parquet", pa.table({axis: np.zeros(1000) for axis in "xyz"}))
    content = path.read_bytes()
    path.write_bytes(content.replace(b"\x26\x00\xd0\x0f", b"\x36\x00\x50\x0f"))  # 0 and 1000 become three numbers
    if path.read_bytes() == content:
        pytest.skip("this PyArrow stores no such sizes")
    with pytest.raises(FileFormatError, match=r"sizes\.parquet: expected a whole table"):
        read(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_tables_of_pandas_and_pyarrow_are_read(folder, suffix):
    import pandas

    frame = pandas.DataFrame(
        {
            "label": pandas.Categorical(["tree", "house", "tree"]),
            "Z": [1.5, 2.5, 3.5],
            "X": [1.0, 2, 3],
            "Y": np.array([1, 2, 3], np.float32),
            "note": ["", "é", "three"],
            "weight": [0.5, None, 1],
            "is_ground": [True, False, True],
        }
    )
    path = folder / f"pandas{suffix}"
    frame.to_parquet(path) if suffix == ".parquet" else frame.to_feather(path)
    cloud = read(path)
    assert cloud.points.tolist() == [[1, 1, 1.5], [2, 2, 2.5], [3, 3, 3.5]]
    assert cloud.attributes["label"].tolist() == ["tree", "house", "tree"]
    assert cloud.attributes["note"].tolist() == ["", "é", "three"]
    assert np.array_equal(cloud.attributes["weight"], [0.5, np.nan, 1], equal_nan=True)
    assert cloud.attributes["is_ground"].dtype == bool
    views = loaded(path).append_column("view", pa.array(["", "é", "three"], pa.string_view()))  # as Polars writes them
    assert read(stored(folder / f"views{suffix}", views)).attributes["view"].tolist() == ["", "é", "three"]
    write(folder / f"some{suffix}", cloud.take(np.array([2, 0])), force=True)
    some = loaded(folder / f"some{suffix}").to_pandas()
    assert some["note"].tolist() == ["three", ""]
    assert some["x"].tolist() == [3, 1]
    assert losses("cloud.ply", cloud) == ["attribute label (text)", "attribute note (text)"]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "column",
    [
        pa.array([[1.0, 2, 3], [4, 5, 6]], pa.list_(pa.float64(), 3)),
        pa.array([{"x": 1.0, "y": 2.0, "z": 3.0}, {"x": 4.0, "y": 5.0, "z": 6.0}]),
    ],
)
def test_a_column_of_points_holds_the_coordinates(folder, suffix, column):
    path = stored(
        folder / f"points{suffix}", pa.table({"geometry": column, "Intensity": pa.array([7, 8], pa.uint16())})
    )
    cloud = read(path)
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert {name: values.tolist() for name, values in cloud.attributes.items()} == {"Intensity": [7, 8]}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("a", pa.array([1, None, 3]), "a value for each point in 'a', found 1 missing"),
        ("a", pa.array([[1, 2], [1, None], [3, 4]], pa.list_(pa.int8(), 2)), "'a', found 1 missing"),
        ("a", pa.array([[1, 2], [1], []]), r"found list<\w+: int64> in 'a'; convert or remove the column"),
        ("a", pa.array([1, 2, 3], pa.timestamp("us")), r"found timestamp\[us\] in 'a'"),
        ("x", pa.array(["1", "2", "3"]), "numbers as coordinates, found <U1 in x"),
    ],
)  # fmt: skip
def test_columns_that_a_cloud_cannot_hold_are_refused_by_name(folder, suffix, name, column, message):
    path = stored(folder / f"refused{suffix}", pa.table({**AXES, name: column}))
    with pytest.raises(FileFormatError, match=message):
        read(path)


@pytest.mark.parametrize(
    ("names", "message"),
    [("xy", "x, y and z for each point, found 'x', 'y'"), ("xyzx", "different names, found 'x', 'y', 'z', 'x'")],
)
def test_tables_without_coordinates_or_with_names_twice_are_refused(folder, names, message):
    with pytest.raises(FileFormatError, match=message):
        read(stored(folder / "cloud.feather", pa.table([AXES[axis] for axis in names], [*names])))
