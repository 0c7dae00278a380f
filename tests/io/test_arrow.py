"""Parquet and Feather files of PyArrow and pandas, every type of column, and damage."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError
from gppcs.io import losses, read, write

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
feather = pytest.importorskip("pyarrow.feather")

TYPES = ["?", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8"]
SUFFIXES = [".parquet", ".feather"]
AXES = {axis: pa.array([1.0, 2.0, 3.0], pa.float32()) for axis in "xyz"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("arrow")


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
def test_tables_of_pandas_and_pyarrow_are_read(folder, suffix):
    import pandas

    frame = pandas.DataFrame(
        {
            "label": pandas.Categorical(["tree", "house", "tree"]),
            "Z": [1.5, 2.5, 3.5],
            "X": [1.0, 2, 3],
            "Y": np.array([1, 2, 3], np.float32),
            "note": ["", "é", "three"],
            "weight": [0.5, np.nan, 1],
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
    write(folder / f"some{suffix}", cloud.take(np.array([2, 0])), force=True)
    some = loaded(folder / f"some{suffix}").to_pandas()
    assert some["note"].tolist() == ["three", ""]
    assert some["x"].tolist() == [3, 1]
    assert losses("cloud.ply", cloud) == ["attribute label (text)", "attribute note (text)"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_metadata_are_kept(folder, suffix):
    metadata = {b"crs": b"EPSG:25832", b"pandas": b"{}", b"\xff": b"\x00\x01"}
    cloud = read(stored(folder / f"metadata{suffix}", pa.table(AXES).replace_schema_metadata(metadata)))
    assert cloud.header.metadata == metadata
    assert losses("cloud.ply", cloud) == ["metadata crs", "metadata �"]
    write(folder / f"again{suffix}", cloud)
    assert loaded(folder / f"again{suffix}").schema.metadata == metadata
    assert read(folder / f"again{suffix}") == cloud


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("a", pa.array([1, None, 3]), "a value for each point in 'a', found 1 missing"),
        ("a", pa.array(["a", None, None]), "'a', found 2 missing"),
        ("a", pa.array([True, None, None]), "'a', found 2 missing"),
        ("a", pa.array([[1, 2], None, [3, 4]], pa.list_(pa.int8(), 2)), "'a', found 1 missing"),
        ("a", pa.array([[1, 2], [1, None], [3, 4]], pa.list_(pa.int8(), 2)), "'a', found 1 missing"),
        ("a", pa.array([[1, 2], [1], []]), r"found list<\w+: int64> in 'a'; convert or remove the column"),
        ("a", pa.array([{"b": 1}] * 3), r"found struct<b: int64> in 'a'"),
        ("a", pa.array([b"a"] * 3), "found binary in 'a'"),
        ("a", pa.array([1, 2, 3], pa.timestamp("us")), r"found timestamp\[us\] in 'a'"),
        ("a", pa.array(["a", "b", "c\0"]), "zero character at the end in 'a'"),
        ("x", pa.array(["1", "2", "3"]), "numbers as coordinates, found <U1 in x"),
        ("x", pa.array([2**53, 1, 2]), r"below 2\^53"),
        ("x", pa.array([[1, 2]] * 3, pa.list_(pa.int8(), 2)), r"one x for each point, found shape \(3, 2\)"),
    ],
)  # fmt: skip
def test_columns_that_a_cloud_cannot_hold_are_refused_by_name(folder, suffix, name, column, message):
    path = stored(folder / f"refused{suffix}", pa.table({**AXES, name: column}))
    with pytest.raises(FileFormatError, match=message):
        read(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_tables_without_coordinates_or_with_names_twice_are_refused(folder, suffix):
    with pytest.raises(FileFormatError, match="x, y and z for each point, found 'x', 'y'"):
        read(stored(folder / f"cloud{suffix}", pa.table({axis: AXES[axis] for axis in "xy"})))
    with pytest.raises(FileFormatError, match="different names, found 'x' twice"):
        read(stored(folder / "cloud.feather", pa.table([*AXES.values(), AXES["x"]], [*"xyzx"])))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_one_long_text_does_not_fill_the_memory(folder, suffix):
    count = 100_000
    texts = pa.array(["a"] * (count - 1) + ["long" * 1_000_000])
    table = pa.table({axis: np.zeros(count) for axis in "xyz"} | {"note": texts})
    with pytest.raises(FileFormatError, match="similar length in 'note', found one of 4,000,000 characters"):
        read(stored(folder / f"long{suffix}", table))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_coordinates_become_nan(folder, suffix):
    table = pa.table({**AXES, "x": pa.array([1.0, None, 3.0], pa.float32())})
    cloud = read(stored(folder / f"null{suffix}", table))
    assert cloud.non_finite().tolist() == [1]
    assert cloud.coordinate_dtype == np.float32


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_big_endian_and_strided_attributes(tmp_path, suffix):
    cloud = PointCloud(np.zeros((3, 3)), {"a": np.arange(3, dtype=">i4"), "b": np.arange(12.0).reshape(3, 4)[:, ::2]})
    write(tmp_path / f"cloud{suffix}", cloud)
    assert read(tmp_path / f"cloud{suffix}").attributes["a"].tolist() == [0, 1, 2]
    assert read(tmp_path / f"cloud{suffix}").attributes["b"].tolist() == [[0, 2], [4, 6], [8, 10]]


def test_a_footer_that_counts_more_rows_than_the_columns_is_an_error(tmp_path, monkeypatch):
    import pyarrow.parquet

    gppcs.write(tmp_path / "a.parquet", np.zeros((3, 3)))
    monkeypatch.setattr(pyarrow.parquet.ParquetFile, "iter_batches", lambda *_, **__: iter(()))
    with pytest.raises(gppcs.FileFormatError, match="the file ends in row 1 of 3"):
        gppcs.read(tmp_path / "a.parquet")
