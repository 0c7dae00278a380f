"""Which files are read, and where each result goes."""

import re
from pathlib import Path

import pytest

from gppcs.app.outputs import outputs_of
from gppcs.errors import OutputError


@pytest.fixture
def tiles(folder):
    """A folder with two files that gppcs reads by their names, and with others."""
    for name in ("b.ply", "A.XYZ", "notes.md", ".hidden.ply", "deeper/c.ply"):
        Path("tiles", name).parent.mkdir(parents=True, exist_ok=True)
        Path("tiles", name).touch()
    Path("tiles/folder.ply").mkdir()
    Path("there").mkdir()


def found(inputs, output, **options):
    return outputs_of(list(map(Path, inputs)), output, {}, **options)


@pytest.mark.parametrize(
    ("inputs", "output", "levels", "expected"),
    [
        (["scans/scan.v1.ply"], "out.ply", 0, ["out.ply"]),
        (["scans/scan.v1.ply"], "new/", 0, ["new/scan.v1.ply"]),
        (["scans/scan.v1.ply"], "there", 0, ["there/scan.v1.ply"]),
        (["scans/scan.v1.ply"], "{stem}.ply", 0, ["{stem}.ply"]),
        (["a.ply", "x/b.csv"], "new", 0, ["new/a.ply", "new/b.csv"]),
        (["a.ply", "x/b.csv"], "new.d/", 0, ["new.d/a.ply", "new.d/b.csv"]),
        (["a.ply", "tiles"], "out.ply", 0, ["out.ply"]),
        (["a.ply", "tiles"], "-", 0, ["-"]),
        (["a.ply", "tiles"], "all/{level}.ply", 2, ["all/0.ply", "all/1.ply"]),
    ],
)
def test_where_the_result_goes(tiles, inputs, output, levels, expected):
    [made] = found(inputs, output, levels=levels)
    assert [target.as_posix() for target in made.targets] == expected
    assert made.makes_folders == ("/" in expected[0])


def test_a_folder_stands_for_the_files_in_it_that_can_be_read(tiles):
    expected = ["a.ply", "tiles/A.XYZ", "tiles/b.ply"]
    [whole], each = found(["a.ply", "tiles"], "out.ply"), found(["a.ply", "tiles"], "out", separately=True)
    assert [path.as_posix() for path in whole.source.paths] == expected
    assert [one.source.paths[0].as_posix() for one in each] == expected


@pytest.mark.parametrize(("output", "reason"), [("out/", "different names"), ("out_{level}.ply", "with `levels`")])
def test_names_that_mean_no_file_for_each_result_are_refused(folder, output, reason):
    with pytest.raises(OutputError, match=re.escape(output) + f".*{reason}"):
        found(["x/a.ply", "y/a.ply"], output)


def test_a_file_is_no_folder(folder):
    for name in ("a.ply", "b.ply"):
        Path(name).touch()
    with pytest.raises(OutputError, match=r"a.ply/: expected a folder, found a file"):
        found(["b.ply"], "a.ply/")
    [made] = found(["b.ply"], "a.ply/deeper/")
    with pytest.raises(OutputError, match=r"expected a folder .*a.ply, found a file"):
        made.check()
