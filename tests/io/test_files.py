"""Which format a file has, and errors that concern any file."""

import re
import subprocess
import sys

import numpy as np
import pytest

from formats import losses
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, MissingExtraError, OutputError, ParameterError
from gppcs.io import FORMATS, format_to_write, read, write
from gppcs.io.cloud_files import CloudFiles

CLOUD = PointCloud([[1.5, 2.5, 3.5]])
WRITABLE = [known.suffixes[0] for known in FORMATS if known.write]


@pytest.mark.parametrize("suffix", [each for each in WRITABLE if each not in (".xyz", ".csv", ".pts", ".obj")])
@pytest.mark.parametrize("name", ["cloud", "cloud.xyz", "cloud.unknown"])
def test_content_decides_before_the_name(tmp_path, suffix, name):
    write(tmp_path / name, CLOUD, format=suffix)
    assert read(tmp_path / name).points.tolist() == CLOUD.points.tolist()


@pytest.mark.parametrize("suffix", [s for known in FORMATS for s in known.suffixes if known.write])
def test_suffixes_in_capitals(tmp_path, suffix):
    write(tmp_path / f"cloud{suffix.upper()}", CLOUD)
    assert read(tmp_path / f"cloud{suffix.upper()}").points.tolist() == CLOUD.points.tolist()


def test_a_given_format_decides_over_content_and_name(tmp_path):
    path = tmp_path / "cloud.ply"
    write(path, CLOUD, format="csv")
    assert path.read_text().startswith("x,y,z\n")
    assert len(read(path, format=".CSV")) == 1
    with pytest.raises(FileFormatError, match="first line of a PLY file"):
        read(path)


@pytest.mark.parametrize("name", ["cloud.las2", "cloud"])
def test_unknown_formats_are_listed(tmp_path, name):
    path = tmp_path / name
    path.write_text("1 2 3\n")
    formats = r"\.ply \.copc\.laz \.las \.laz \.points3d\.txt \.points3d\.bin \.xyz \.txt \.asc \.csv \.pts \.npy "
    for attempt in (lambda: read(path), lambda: write(path, CLOUD), lambda: read(path, format="las2")):
        with pytest.raises(FileFormatError, match=formats):
            attempt()


def test_stl_cannot_hold_points(tmp_path):
    for attempt in (lambda: write(tmp_path / "a.stl", CLOUD), lambda: format_to_write(tmp_path / "a.stl")):
        with pytest.raises(FileFormatError, match=r"a\.stl: expected one of the formats \.ply .*, found '\.stl\'"):
            attempt()
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".las", ".xyz", ".npz"])
def test_formats_without_a_choice_of_text_are_refused(tmp_path, suffix):
    for choice in (True, False):
        with pytest.raises(FileFormatError, match=r"PLY or PCD, which has ascii, found .*; leave out ascii"):
            write(tmp_path / f"a{suffix}", CLOUD, ascii=choice)
    with pytest.raises(ParameterError, match="expected ascii to be True or False, found 'yes'"):
        write(tmp_path / "a.ply", CLOUD, ascii="yes")
    assert not any(tmp_path.iterdir())


def test_files_that_cannot_be_opened(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no\.ply"):
        read(tmp_path / "no.ply")
    with pytest.raises(FileFormatError, match="expected a file, found a folder"):
        read(tmp_path)


@pytest.mark.parametrize("suffix", [each for each in WRITABLE if each not in (".points3d.txt", ".xyz", ".csv", ".obj")])
@pytest.mark.parametrize("ascii", [None, True])
def test_cut_files_are_refused_as_a_whole_and_in_chunks(tmp_path, suffix, ascii):  # noqa: A002
    """Each of these formats says how many points it holds; those that tell the first missing one tell the right one."""
    if ascii and suffix not in (".ply", ".pcd"):
        return
    path, is_text = tmp_path / f"cut{suffix}", ascii or suffix in (".off", ".pts")
    points = np.random.default_rng(0).random((100, 3)).astype(np.float32)
    write(path, PointCloud(points, coordinate_dtype=points.dtype), lossy=True, ascii=ascii)
    whole = path.read_bytes()
    size = 20 if suffix == ".las" else 12
    for left in np.linspace(4, len(whole) - 40, 23, dtype=int):
        path.write_bytes(whole[:left])
        missing = whole[left:].count(b"\n") if is_text else (len(whole) - left - 1) // size + 1
        for attempt in (lambda: read(path, suffix), lambda: list(CloudFiles([path], suffix).chunks(True, 30))):
            with pytest.raises(FileFormatError, match=re.escape(f"{path}: ")) as caught:
                attempt()
            if ends := re.search(r"ends in (?:vertex|point) (\d+) of 100\b", str(caught.value)):
                assert 0 <= int(ends[1]) - (101 - min(missing, 100)) <= is_text  # half of a number is a number, too


def lost(path, cloud):
    """What a file cannot hold of a cloud without a coordinate system; COPC tells that it lacks one."""
    return [each for each in losses(path, cloud) if not each.startswith("a coordinate system, which")]


@pytest.mark.parametrize("suffix", [".ply", ".csv", ".npy", ".npz"])
@pytest.mark.parametrize("name", ["", "a\0b", "\ud800", "n" * 70_000, "../up", "a/", ".npy", "#", "new\nline"])
def test_strange_names_of_attributes_are_kept_or_refused(tmp_path, suffix, name):
    cloud = PointCloud(np.zeros((2, 3)), {name: np.arange(2)})
    written = re.sub(r"\s", "_", name) or "_" if suffix in (".ply", ".csv") else name
    if written in ("", "a\0b", "\ud800", "n" * 70_000):
        with pytest.raises(OutputError, match="expected a name of 1 to 1,000 characters"):
            write(tmp_path / f"cloud{suffix}", cloud)
        assert not any(tmp_path.iterdir())
    else:
        write(tmp_path / f"cloud{suffix}", cloud)
        assert list(read(tmp_path / f"cloud{suffix}").attributes) == [written]
        assert losses(f"cloud{suffix}", cloud) == (
            [] if written == name else [f"the name {name!a} (it becomes {written})"]
        )


@pytest.mark.parametrize("known", [known for known in FORMATS if known.write], ids=lambda known: known.name)
def test_what_a_format_cannot_hold_is_refused_or_left_out_when_that_is_asked_for(tmp_path, known):
    cloud = PointCloud(np.zeros((2, 3)), {"nx": np.zeros(2), "label": np.zeros(2)})
    path = tmp_path / f"cloud{known.suffixes[0]}"
    assert lost(path, CLOUD) == []
    if known.name in ("OFF", "OBJ", "PTS", "COLMAP text", "COLMAP binary"):  # OFF has normals, but of three numbers
        assert losses(path, cloud) == ["attribute nx (float64)", "attribute label (float64)"]
        with pytest.raises(OutputError, match=r"cannot hold: attribute nx \(float64\), .*; choose .* lossy"):
            write(path, cloud)
        assert not any(tmp_path.iterdir())
        write(path, cloud, lossy=True)
        assert not {"nx", "label"} & set(read(path).attributes)
    else:
        assert lost(path, cloud) == []
        write(path, cloud)
        assert set(read(path).attributes) >= {"nx", "label"}


@pytest.mark.parametrize("suffix", WRITABLE)
@pytest.mark.parametrize(
    ("name", "values"),
    [("none", np.zeros((2, 0))), ("thing", np.array([None, "b"], dtype=object)), ("a:b", np.arange(2.0))],
)
def test_attributes_are_kept_or_named(tmp_path, suffix, name, values):
    cloud, path = PointCloud(np.eye(3)[:2], {name: values}), tmp_path / f"cloud{suffix}"
    left = lost(path, cloud)
    if left:
        assert left == [f"attribute {name} ({values.dtype})"]
        with pytest.raises(OutputError, match=f"cannot hold: attribute {name}"):
            write(path, cloud)
    write(path, cloud, lossy=True)
    found = read(path).attributes
    assert (name not in found) == bool(left)
    assert left or np.array_equal(found[name], values)
    assert left or name != "thing"


@pytest.mark.parametrize("suffix", WRITABLE)
def test_no_two_columns_of_a_file_have_one_name(tmp_path, suffix):
    one, two = np.zeros(1), np.zeros((1, 2))
    path = tmp_path / f"cloud{suffix}"
    for attributes in ({"x": one}, {"a b": one, "a_b": one}, {"n": two, "n_0": one}):
        try:
            write(path, PointCloud(np.zeros((1, 3)), attributes))
        except OutputError as error:
            assert re.search("twice|different names|cannot hold", str(error))  # noqa: PT017
            assert not path.exists()
        else:
            assert "x" not in attributes
            assert set(read(path).attributes) >= set(attributes)
            path.unlink()


@pytest.mark.parametrize("known", [known for known in FORMATS if known.write], ids=lambda known: known.name)
def test_what_is_said_of_the_whole_cloud_is_no_value(tmp_path, known):
    path = tmp_path / f"cloud{known.suffixes[0]}"
    write(tmp_path / "said.ply", CLOUD)
    content = (tmp_path / "said.ply").read_bytes().replace(b"element", b"comment mine\nelement", 1)
    (tmp_path / "said.ply").write_bytes(content)
    cloud = read(tmp_path / "said.ply")
    assert lost(path, cloud) == ([] if known.name == "PLY" else ["1 comment"])
    write(path, cloud)
    assert len(read(path)) == len(CLOUD)


@pytest.mark.parametrize(
    ("suffix", "package", "extra"),
    [(".e57", "pye57", "e57"), (".parquet", "pyarrow", "arrow"), (".feather", "pyarrow", "arrow")],
)
def test_without_its_package_a_format_names_the_extra_before_any_work(tmp_path, monkeypatch, suffix, package, extra):
    pytest.importorskip(package)
    path = tmp_path / f"cloud{suffix}"
    write(path, CLOUD)
    monkeypatch.setitem(sys.modules, package, None)
    for attempt in (lambda: read(path), lambda: losses(path, CLOUD)):
        with pytest.raises(MissingExtraError, match=rf"(?i)needs? {package}.*the extra {extra}.*pip install"):
            attempt()


def test_importing_takes_no_compiler_along():
    compilers = "{'numba', 'scipy', 'laspy', 'lazrs', 'pandas', 'pyarrow', 'pye57'}"
    check = f"import sys, gppcs.io; sys.exit(bool({compilers} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0
