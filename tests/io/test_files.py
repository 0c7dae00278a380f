"""Which format a file has, and errors that concern any file."""

import re
import sys

import numpy as np
import pytest

from formats import WRITABLE
from gppcs.clouds.cloud import PointCloud
from gppcs.errors import FileFormatError, MissingExtraError, ParameterError
from gppcs.io import FORMATS, CloudFiles, format_to_write, read, write

CLOUD = PointCloud([[1.5, 2.5, 3.5]])
PLAIN = (".points3d.txt", ".xyz", ".csv", ".obj")  # texts without a signature, or without a number of points
UNSIGNED = (".xyz", ".csv", ".pts", ".obj", ".points3d.bin")


@pytest.mark.parametrize("suffix", [suffix for suffix in WRITABLE if suffix not in UNSIGNED])
def test_content_decides_before_the_name(tmp_path, suffix):
    for name in ("cloud", "cloud.xyz", "cloud.unknown"):
        write(tmp_path / name, CLOUD, format=suffix)
        assert read(tmp_path / name).points.tolist() == CLOUD.points.tolist()
        with pytest.raises(FileFormatError, match=r"expected the format XYZ, found .*; leave out `format`"):
            read(tmp_path / name, format="xyz")


@pytest.mark.parametrize("suffix", [suffix for file_format in FORMATS for suffix in file_format.suffixes])
def test_suffixes_in_capitals(tmp_path, suffix):
    if any(suffix in file_format.suffixes and file_format.write for file_format in FORMATS):
        write(tmp_path / f"cloud{suffix.upper()}", CLOUD)
        assert read(tmp_path / f"cloud{suffix.upper()}").points.tolist() == CLOUD.points.tolist()


def test_a_format_decides_over_the_name(tmp_path):
    path = tmp_path / "cloud.ply"
    write(path, CLOUD, format="csv")
    assert path.read_text().startswith("x,y,z\n")
    assert len(read(path, format=".CSV")) == 1
    with pytest.raises(FileFormatError, match="first line of a PLY file"):
        read(path)


@pytest.mark.parametrize("name", ["cloud.las2", "cloud", "cloud.stl"])
def test_unknown_formats_are_listed(tmp_path, name):
    path = tmp_path / name
    path.write_text("1 2 3\n")
    attempts = [lambda: write(path, CLOUD, force=True), lambda: format_to_write(path)]
    if name != "cloud.stl":  # which is only read
        attempts += [lambda: read(path), lambda: read(path, format="las2")]
    for attempt in attempts:
        with pytest.raises(FileFormatError, match=r"\.ply \.copc\.laz \.las \.laz .* \.xyz \.txt \.asc \.csv \.pts"):
            attempt()
    if name == "cloud.stl":
        with pytest.raises(FileFormatError, match="gppcs mesh writes meshes"):
            attempts[0]()
    assert path.read_text() == "1 2 3\n"


@pytest.mark.parametrize("suffix", [".las", ".xyz", ".npz"])
def test_formats_without_a_choice_are_refused(tmp_path, suffix):
    for options in ({"ascii": True}, {"ascii": False}, {"levels_by": "order"}):
        with pytest.raises(FileFormatError, match=f"(PLY or PCD|COPC).* leave out `{next(iter(options))}`"):
            write(tmp_path / f"a{suffix}", CLOUD, **options)
    with pytest.raises(ParameterError, match="expected `ascii` to be True or False, found 'yes'"):
        write(tmp_path / "a.ply", CLOUD, ascii="yes")
    assert not any(tmp_path.iterdir())


def test_files_that_cannot_be_opened(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no\.ply"):
        read(tmp_path / "no.ply")
    with pytest.raises(FileFormatError, match="expected a file, found a folder"):
        read(tmp_path)


@pytest.mark.parametrize("suffix", [suffix for suffix in WRITABLE if suffix not in PLAIN])
@pytest.mark.parametrize("ascii", [None, True])
def test_cut_files_are_refused_as_a_whole_and_in_chunks(tmp_path, suffix, ascii):  # noqa: A002
    """Each of these formats says how many points it holds."""
    if ascii and suffix not in (".ply", ".pcd"):
        return
    path = tmp_path / f"cut{suffix}"
    points = np.random.default_rng(0).random((100, 3)).astype(np.float32)
    write(path, PointCloud(points, coordinate_dtype=points.dtype), lossy=True, ascii=ascii)
    whole = path.read_bytes()
    for left in np.linspace(4, len(whole) - 40, 9, dtype=int):
        path.write_bytes(whole[:left])
        with CloudFiles([path], suffix) as files:
            for attempt in (files.read, lambda: list(files.chunks(n=30))):
                with pytest.raises(FileFormatError, match=re.escape(f"{path}: ")):
                    attempt()


@pytest.mark.parametrize(
    ("suffix", "package", "extra"),
    [(".e57", "pye57", "e57"), (".parquet", "pyarrow", "arrow"), (".feather", "pyarrow", "arrow")],
)
def test_without_its_package_a_format_names_the_extra_before_any_work(tmp_path, monkeypatch, suffix, package, extra):
    pytest.importorskip(package)
    path = tmp_path / f"cloud{suffix}"
    write(path, CLOUD)
    monkeypatch.setitem(sys.modules, package, None)
    for attempt in (lambda: read(path), lambda: format_to_write(path).fit(CLOUD)):
        with pytest.raises(MissingExtraError, match=rf"(?i)needs? {package}.*the extra {extra}.*pip install"):
            attempt()
