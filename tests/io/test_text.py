"""Tables of numbers as text: delimiters, headers, counts, comments, bad lines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from formats import load
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, OutputError, ParameterError
from gppcs.io import read, rows, write


@pytest.mark.parametrize("delimiter", [",", ", ", ";", " ", "   ", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_delimiters_and_line_ends(file_of, delimiter, end):
    lines = [delimiter.join(row) for row in (["1.5", "2.5", "3.5", "7"], ["-1e3", ".5", "6.", "8"])]
    cloud = read(file_of(".xyz", end.join(lines)))
    assert cloud.points.tolist() == [[1.5, 2.5, 3.5], [-1000, 0.5, 6]]
    assert cloud.attributes["column_4"].tolist() == [7, 8]
    assert cloud.attributes["column_4"].dtype == np.int64


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("x,y,z,intensity\n1,2,3,4\n", ["intensity"]),
        ("\ufeffX;Y;Z;Reflectance\n1;2;3;4\n", ["Reflectance"]),
        ('"x" "y" "z" "a"\n1 2 3 4\n', ["a"]),
        ("//X Y Z R\n1 2 3 4\n", ["R"]),
        ("# a comment\n# x y z label\n# another\n1 2 3 4\n", ["label"]),
        ("x;y;z;a,b\n1;2;3;4\n", ["a,b"]),
        ("x\ty\tz\tScalar field\n1\t2\t3\t4\t\n", ["Scalar field"]),
        ("# x y z z\n1 2 3 4\n", ["column_4"]),
        ("//X Y Z R G B\n1 2 3 4 5 6\n", ["red", "green", "blue"]),
        ("x y z R G B red\n1 2 3 4 5 6 7\n", ["R", "G", "B", "red"]),
        ("X,Y,Z,B,G,R,Intensity\n1,2,3,4,5,6,7\n", ["blue", "green", "red", "Intensity"]),
    ],
)
def test_names_come_from_a_header_or_a_comment(file_of, text, names):
    cloud = read(file_of(".xyz", text))
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert list(cloud.attributes) == names
    assert cloud.attributes[names[0]].tolist() == [4]


def test_coordinates_have_the_digits_of_the_scale_of_their_las_file(tmp_path):
    points = np.array([[849393.95, 0.41, 7.07], [849394.01, 6.29, -0.57]])
    write(tmp_path / "a.las", points)
    cloud = read(tmp_path / "a.las")
    assert str(cloud.points[0, 1]) == "0.41000000000000003"  # 41 times 0.01
    for suffix in ("csv", "pts"):
        write(tmp_path / f"a.{suffix}", cloud, lossy=True)
        assert "0.41" in (tmp_path / f"a.{suffix}").read_text().replace(",", " ").split()
        assert np.array_equal(read(tmp_path / f"a.{suffix}").points, points)


@pytest.mark.parametrize(
    ("extra", "names"),
    [
        ("", []),
        (" 4", ["intensity"]),
        (" 4 5", ["column_4", "column_5"]),
        (" 4 5 6", ["red", "green", "blue"]),
        (" 4 5 6 7", ["intensity", "red", "green", "blue"]),
    ],
)
@pytest.mark.parametrize("count", ["2\n", ""])
def test_columns_of_pts_files(file_of, extra, names, count):
    cloud = read(file_of(".pts", f"{count}1.5 2 3{extra}\n4.5 5 6{extra}\n"))
    assert cloud.points.tolist() == [[1.5, 2, 3], [4.5, 5, 6]]
    assert list(cloud.attributes) == names


def test_numbers_are_written_as_the_shortest_text_of_their_type(tmp_path):
    path = tmp_path / "cloud.csv"
    points = np.array([[0.1, 1, 1e-7], [0, 5, 1e-21]], np.float32)
    attributes = {"a b": np.array([True, False]), "h": np.array([0.1, 1e-5]), "w": np.float16([1000, 0.5])}
    write(path, PointCloud(points, attributes, points.dtype))
    assert path.read_text() == "x,y,z,a_b,h,w\n0.1,1.0,0.0000001,1,0.1,1000.0\n0.0,5.0,1e-21,0,0.00001,0.5\n"


@pytest.mark.parametrize(
    ("row", "names"),
    [("1 2 3 0 128 255", "x,y,z,red,green,blue"), ("1 2 3 4 5 6 0.5", "x,y,z,red,green,blue,column_7"),
     ("1 2 3 4 5 256", ""), ("1 2 3 4 5", ""), ("1 2 3 0.5 1 1", "")],
)  # fmt: skip
def test_columns_that_may_be_colours_are_noted(tmp_path, row, names):
    (tmp_path / "a.xyz").write_text(f"{row}\n" * 3)
    assert [names in text for text in load(tmp_path / "a.xyz").unread] == [True] * bool(names)


@pytest.mark.parametrize("suffix", [".csv", ".xyz", ".pts", ".obj", ".off"])
def test_single_coordinates_far_from_zero_have_the_digits_of_double_ones(tmp_path, suffix):
    points = np.array([[493814.9, 5420477, 1], [493815.2, 5420494, 2]], np.float32)
    write(tmp_path / f"a{suffix}", PointCloud(points, coordinate_dtype=points.dtype))
    lines = (tmp_path / f"a{suffix}").read_text().replace(",", " ").splitlines()[-2:]
    assert [list(map(float, line.split()[-3:])) for line in lines] == points.tolist()
    assert not any("e" in line for line in lines)


@pytest.mark.parametrize(
    ("column", "kind"),
    [
        (["9007199254740993", "-5"], "int64"),
        (["5", "18446744073709551615"], "uint64"),
        (["1e300", "nan"], "float64"),
        (["18446744073709551615", "-1"], "<U20"),  # whole numbers that no type holds exactly stay text
        (["1" * 500, "1"], "<U500"),
    ],
)
def test_large_numbers_keep_their_values(file_of, column, kind):
    values = read(file_of(".xyz", "".join(f"1 2 3 {value}\n" for value in column))).attributes["column_4"]
    assert values.dtype == kind
    np.testing.assert_array_equal(values, np.array(column).astype(kind))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n4 5 6\n7 8\n", "point 3: expected 3 columns, found '7 8'"),
        ("1 2 3\n\n# no\n4 five 6\n", "point 2: expected a number, found 'five'"),
        ("1 2\n", "line 1: expected at least three numbers, found '1 2'"),
        ("1 2 3x\n", "line 1: expected numbers such as 1.5, or names of columns, .* with x, y, z, found '1 2 3x'"),
        ("# id lon lat\n1 2 3\n", "line 1: expected names of columns, each once, with x, y, z, found '# id lon lat'"),
        ("x,y,z\n1,2,3,4\n", "line 2 has 4 columns, but 3 have names"),
        ("1 " * 20_000 + "\n", "line 1: expected at most 4,096 columns, found 20,000"),
        ("3\n1 2 3\n4 5 6\n", "ends in point 3 of 3"),
        ("1\n1 2 3\n4 5 6\n", "expected 1 points, as the file says, found more"),
        ("x,y,z,label\n1,2,3,a\n4,5,6\n", "point 2: expected 4 columns, found '4,5,6'"),
        ("x,y,z,label\n1,2,three,a\n", "line 2: expected numbers such as 1.5, as x, y and z"),
        ('1,2,3,a\n4,5,6,"b\n', "pandas reports: .*EOF inside string"),
        ("1,2,3,a\n4,5,6,\0\n", "expected text in UTF-8"),
        ("1,2,3,a\n4,5,6," + "b" * 1001 + "\n", "expected text in UTF-8 of at most 1,000 characters"),
        ("1,5;2,5;3,5\n", "line 1: expected numbers such as 1.5, or names of columns, each once"),
        ("1 9007199254740993 3\n", r"below 2\^53, found larger ones in y; subtract an offset"),
    ],
)
def test_bad_rows_are_shown(file_of, monkeypatch, text, message):
    monkeypatch.setattr(rows, "BLOCK", 4)
    with pytest.raises(FileFormatError, match=message):
        read(file_of(".xyz", text))


@pytest.mark.parametrize("text", ["", "\n", "# nothing\n", "x,y,z\n", "0\n"])
def test_tables_without_rows_are_empty_clouds(file_of, text):
    assert len(read(file_of(".xyz", text))) == 0


@pytest.mark.parametrize(
    ("text", "labels"),
    [
        ("x,y,z,label\n1,2,3,tree\n4,5,6,low plant\n", ["tree", "low plant"]),
        ("1 2 3 tree\n4 5 6 grass\n", ["tree", "grass"]),
        ("x\ty\tz\tkind of plant\n1\t2\t3\ttree\n4\t5\t6\tlow plant\n", ["tree", "low plant"]),
        ("1\t2\t3\ttree\n4\t5\t6\t\n", ["tree", ""]),
        ('x;y;z;label\n1.5;2;3;"a;b"\n4;5;6;""\n', ["a;b", ""]),
        ('x,y,z,label\n1,2,3,"001"\n4,5,6,"2 ""b"""\n', ["001", '2 "b"']),
        ('x y z label\n1 2 3 "a b"\n4 5 6 c\n', ["a b", "c"]),
        ("x,y,z,label\n1,2,3,5\" pipe\n4,5,6,'b'\n", ['5" pipe', "'b'"]),
    ],
)
def test_columns_of_text_are_kept(file_of, text, labels):
    cloud = read(file_of(".xyz", text))
    assert cloud.points[1].tolist() == [4, 5, 6]
    (values,) = cloud.attributes.values()
    assert values.dtype.kind == "U"
    assert values.tolist() == labels


def test_text_may_stand_before_the_coordinates(file_of):
    cloud = read(file_of(".xyz", "label,x,note,z,y,class,X\na,1,b c,3,2,7,0\nd,4,,6,5,8,0\n"))
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert {name: values.tolist() for name, values in cloud.attributes.items()} == {
        "label": ["a", "d"],
        "note": ["b c", ""],
        "class": [7, 8],
        "X": [0, 0],
    }


TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0\n\r\ufffd"), max_size=20)


@given(texts=st.lists(TEXTS, min_size=1, max_size=4), block=st.sampled_from([1, 100]))
@pytest.mark.parametrize("suffix", [".xyz", ".csv", ".npy", ".npz"])
def test_any_text_comes_back(tmp_path_factory, suffix, texts, block):
    path = tmp_path_factory.mktemp("text") / f"cloud{suffix}"
    cloud = PointCloud(np.arange(3.0 * len(texts)).reshape(-1, 3), {"label": np.array(texts), "i": range(len(texts))})
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(rows, "BLOCK", block)
        write(path, cloud)
        found = read(path)
    assert found.points.tolist() == cloud.points.tolist()
    assert found.attributes["label"].tolist() == texts
    assert found.attributes["i"].tolist() == list(range(len(texts)))


@pytest.mark.parametrize("text", ["a\nb", "a\rb", "a\0b", chr(0xD800), "\ufffd", "a" * 1001])
@pytest.mark.parametrize("suffix", [".xyz", ".csv"])
def test_text_that_no_line_holds_is_refused(tmp_path, suffix, text):
    with pytest.raises(OutputError, match=r"expected text .* write .npy or .npz"):
        write(tmp_path / f"cloud{suffix}", PointCloud([[0, 0, 0]], {"label": np.array([text])}))
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(("row", "kind"), [("0 255 7", "uint8"), ("0 256 7", "int64"), ("0.5 0.1 1.0", "float64")])
def test_colours_of_one_byte_are_of_type_uint8(file_of, row, kind):
    cloud = read(file_of(".xyz", f"x y z red green blue\n1 2 3 {row}\n"))
    assert {str(values.dtype) for values in cloud.attributes.values()} == {kind}


@pytest.mark.parametrize("text", ["1 2 3 4 a\n", "lon lat alt i n\n1 2 3 4 a\n", "1\n# x y z a b\n1 2 3 4 a\n"])
@pytest.mark.parametrize("suffix", [".txt", ".pts"])
def test_columns_take_the_names_that_are_given(file_of, text, suffix):
    cloud = read(file_of(suffix, text), columns=["y", "x", "z", "R", "note"])
    assert cloud.points.tolist() == [[2, 1, 3]]
    assert {name: values.tolist() for name, values in cloud.attributes.items()} == {"R": [4], "note": ["a"]}


@pytest.mark.parametrize(
    "columns", ["xyz", ["x", "y"], ["x", "y", "z", ""], ["x", "y", "z", 4], ["x", "y", "z", "x"], []]
)
def test_names_that_are_none_are_refused(file_of, columns):
    with pytest.raises(ParameterError, match="names of columns"):
        read(file_of(".xyz", "1 2 3 4\n"), columns=columns)


@pytest.mark.parametrize("cell", ["", "NA", "nan"])
def test_missing_numbers_are_nan_in_whichever_row(file_of, cell):
    cloud = read(file_of(".xyz", f"x,y,z,v,w\n0,{cell},0,{cell},5\n{cell},1,1,7,6\n2,2,2,9,{cell}\n"))
    assert np.array_equal(cloud.attributes["v"], [np.nan, 7, 9], equal_nan=True)
    assert np.array_equal(cloud.attributes["w"], [5, 6, np.nan], equal_nan=True)
    assert np.array_equal(cloud.points[:2], [[0, np.nan, 0], [np.nan, 1, 1]], equal_nan=True)


def test_text_after_the_first_block_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(rows, "BLOCK", 4)
    (tmp_path / "a.csv").write_text(
        "x,y,z,kind\n" + "".join(f"{i},0,0,{'a' if i in (2, 9) else i}\n" for i in range(9))
    )
    assert gppcs.read(tmp_path / "a.csv").attributes["kind"].tolist() == ["0", "1", "a", *map(str, range(3, 9))]
    (tmp_path / "a.csv").write_text("x,y,z,kind\n" + "".join(f"{i},0,0,{'a' if i == 6 else i}\n" for i in range(9)))
    with pytest.raises(FileFormatError, match="point 7: expected a number, found 'a'"):
        gppcs.read(tmp_path / "a.csv")
