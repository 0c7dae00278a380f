"""Which files are read, and where each result goes."""

import re
from pathlib import Path

import pytest

from gppcs.app.outputs import outputs_of, sources_of
from gppcs.errors import OutputError


@pytest.fixture
def tiles(folder):
    """A folder with two files that gppcs reads by their names, and with others."""
    for name in ("b.ply", "A.XYZ", "notes.md", ".hidden.ply", "deeper/c.ply"):
        Path("tiles", name).parent.mkdir(parents=True, exist_ok=True)
        Path("tiles", name).touch()
    Path("tiles/folder.ply").mkdir()
    return Path("tiles")


def targets(inputs, output, levels=0):
    found = outputs_of(list(map(Path, inputs)), output, {}, levels)
    return [str(target) for each in found for target in each.targets]


def test_a_folder_stands_for_the_files_in_it_that_can_be_read(tiles):
    expected = [Path("scan.ply"), tiles / "A.XYZ", tiles / "b.ply"]
    assert sources_of([Path("scan.ply"), tiles]) == expected
    each = outputs_of([Path("scan.ply"), tiles], "out", {}, separately=True)
    assert [output.source.paths for output in each] == [[path] for path in expected]


@pytest.mark.parametrize(
    ("output", "expected", "makes"),
    [
        ("out.ply", "out.ply", False),
        ("new/", "new/scan.v1.ply", True),
        ("there", "there/scan.v1.ply", True),
        ("{stem}.ply", "{stem}.ply", False),
    ],
)
def test_where_the_result_of_one_input_goes(folder, output, expected, makes):
    Path("there").mkdir()
    [found] = outputs_of([Path("scans/scan.v1.ply")], output, {})
    assert (found.targets, found.makes_folders) == ([Path(expected)], makes)


@pytest.mark.parametrize("output", ["new", "new/", "new.d/"])
def test_several_results_go_to_a_folder(folder, output):
    place = output.partition("/")[0]
    assert targets(["a.ply", "x/b.csv"], output) == [f"{place}/a.ply", f"{place}/b.csv"]


@pytest.mark.parametrize(("output", "reason"), [("out/", "different names"), ("out_{level}.ply", "with `levels`")])
def test_names_that_mean_no_file_for_each_result_are_refused(folder, output, reason):
    with pytest.raises(OutputError, match=re.escape(output) + f".*{reason}"):
        targets(["x/a.ply", "y/a.ply"], output)


@pytest.mark.parametrize(
    ("output", "levels", "expected"),
    [("out.ply", 0, ["out.ply"]), ("-", 0, ["-"]), ("all/{level}.ply", 2, ["all/0.ply", "all/1.ply"])],
)
def test_several_inputs_are_one_cloud_in_one_file(tiles, output, levels, expected):
    [found] = outputs_of([Path("a.ply"), tiles], output, {}, levels)
    assert found.source.paths == [Path("a.ply"), tiles / "A.XYZ", tiles / "b.ply"]
    assert list(map(str, found.targets)) == expected


def test_a_file_is_no_folder(folder):
    for name in ("a.ply", "b.ply"):
        Path(name).touch()
    with pytest.raises(OutputError, match=r"a.ply/: expected a folder, found a file"):
        targets(["b.ply"], "a.ply/")
    [made] = outputs_of([Path("b.ply")], "a.ply/deeper/", {})
    with pytest.raises(OutputError, match=r"expected a folder .*a.ply, found a file"):
        made.check()
