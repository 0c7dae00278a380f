"""PTX files: poses, several scans, rows without a return, and damage."""

import numpy as np
import pytest

from formats import load
from gppcs.errors import FileFormatError
from gppcs.io import read

IDENTITY = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"
TURN = "0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1"  # x to y, y to -x, then moved
ROWS = ["1 2 3 0.5", "0 0 0 0.5", "4 5 6 0.25", "0.0 -0 0.000000 0", "0 0 7.5 1", "nan 0 0 1"]


def scan(rows, columns=1, pose=IDENTITY):
    return "\n".join([str(columns), str(len(rows) // columns), "0 0 0", "1 0 0", "0 1 0", "0 0 1", pose, *rows, ""])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("name", ["cloud.ptx", "cloud.xyz", "cloud"])
def test_points_come_without_rows_that_have_no_return(file_of, end, name):
    path = file_of(name, scan(ROWS, 2).replace("\n", end))
    cloud = read(path)
    assert np.array_equal(cloud.points, [[1, 2, 3], [4, 5, 6], [0, 0, 7.5], [np.nan, 0, 0]], equal_nan=True)
    assert cloud.attributes["intensity"].tolist() == [0.5, 0.25, 1, 1]
    assert list(cloud.attributes) == ["intensity"]
    assert load(path)[-1] == ["rows without a return (2)"]


def test_scans_are_merged_with_their_poses(file_of):
    coloured = [f"{row} {i} 0 255" for i, row in enumerate(ROWS[:3])]
    cloud = read(file_of(".ptx", scan(coloured) + scan(coloured, pose=TURN)))
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6], [8, 21, 33], [5, 24, 36]]
    assert cloud.attributes["scan"].tolist() == [0, 0, 1, 1]
    assert cloud.attributes["red"].tolist() == [0, 2, 0, 2]
    assert cloud.attributes["blue"].dtype == np.uint8


def test_scans_without_points(file_of):
    assert len(read(file_of(".ptx", scan([])))) == 0
    assert read(file_of(".ptx", scan([]) + scan(ROWS))).attributes["scan"].tolist() == [1] * 4
    assert len(read(file_of(".ptx", scan(["0 0 0 0.5"])))) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "size of a scan in a PTX file, found nothing"),
        ("2\n", "ends in scan 1, line 2 of 10"),
        (scan(ROWS).replace("1\n6\n", "2.5\n1\n"), "whole numbers as the size of scan 1 .* found 2.5"),
        (scan(ROWS).replace("0 1 0\n", "0 1\n", 1), "scan 1, line 5: expected 3 numbers, found '0 1'"),
        (scan(ROWS).replace("0 0 0 1", "0 0 0 inf"), "finite ones as its pose"),
        (scan(ROWS)[:-20], "ends in point 5 of 6"),
        (scan([*ROWS, "1 2 3"]), "point 7: expected 4 columns, found '1 2 3'"),
        (scan(["1 2 3"]), "expected 4 or 7 numbers for each point, found 3"),
        (scan(["1 2 3 0 0 0 256"]), "whole numbers from 0 to 255 as blue of point 1, found '256'"),
        (scan(["1 2 3 0 0 nan 0"]), "whole numbers from 0 to 255 as green of point 1, found 'nan'"),
        (scan(ROWS) + scan(["1 2 3 0 0 0 0"]), "colours in all scans or in none"),
        (scan(ROWS) + "nonsense\n", "scan 2, line 1: expected 1 numbers, found 'nonsense'"),
        (scan(ROWS).replace("1\n6\n", "999999999\n999999999\n"), "ends in point 7 of 999999998000000001"),
    ],
)
def test_malformed_files_tell_what_and_where(file_of, text, message):
    with pytest.raises(FileFormatError, match=message):
        read(file_of(".ptx", text))
