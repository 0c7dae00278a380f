"""Compressed files, standard input and standard output."""

import gzip
import io
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from gppcs import PointCloud
from gppcs.errors import FileFormatError, OutputError
from gppcs.io import FORMATS, read, write

WRITABLE = [known.suffixes[0] for known in FORMATS if known.write]
CLOUD = PointCloud([[0.5, 1, 2], [3, 4, 5e30]])
TEXT = b"# x y z label\n0.5 1 2 7\n3 4 5 8\n"


@pytest.mark.parametrize("suffix", WRITABLE)
def test_compressed_files_hold_what_plain_ones_do(tmp_path, suffix):
    plain, packed = tmp_path / f"cloud{suffix}", tmp_path / f"cloud{suffix}.gz"
    for path in (plain, packed):
        write(path, CLOUD, lossy=True)
    assert gzip.decompress(packed.read_bytes()) == plain.read_bytes()
    assert read(packed) == read(plain)


def test_compression_is_found_by_content_and_streams_are_read_one_after_another(tmp_path):
    (tmp_path / "cloud.xyz").write_bytes(gzip.compress(TEXT) + gzip.compress(b"6 7 8 9\n"))
    assert read(tmp_path / "cloud.xyz").attributes["label"].tolist() == [7, 8, 9]


@pytest.mark.parametrize("damage", [lambda data: data[:-6], lambda data: data[:14] + b"junk" + data[18:]])
def test_damaged_compression_is_refused(tmp_path, damage):
    path = tmp_path / "cloud.xyz.gz"
    packed = gzip.compress(os.urandom(300).hex().encode())
    path.write_bytes(damage(packed))
    with pytest.raises(FileFormatError, match=r"cloud\.xyz\.gz: expected"):
        read(path)


def test_a_cloud_that_breaks_off_leaves_no_compressed_file(tmp_path):
    with pytest.raises(OutputError, match="Unicode"):
        write(tmp_path / "cloud.npz.gz", PointCloud(CLOUD.points, {"\ud800": np.zeros(2)}))
    assert not any(tmp_path.iterdir())


@pytest.fixture
def stdin(monkeypatch):
    """Let standard input hold some bytes."""

    def hold(content):
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BufferedReader(io.BytesIO(content))))

    return hold


@pytest.mark.parametrize("suffix", WRITABLE)
def test_standard_input_gives_any_format(tmp_path, stdin, suffix):
    write(tmp_path / f"a{suffix}", CLOUD, lossy=True)
    stdin((tmp_path / f"a{suffix}").read_bytes())
    assert read("-", suffix) == read(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_standard_input_is_read_once(stdin, pack):
    stdin(pack(TEXT))
    assert read("-", "xyz").attributes["label"].tolist() == [7, 8]
    with pytest.raises(FileFormatError, match="closed or was read before; name it once"):
        read("-", "xyz")


def test_standard_streams_need_a_known_format_and_to_be_open(stdin, monkeypatch):
    stdin(TEXT)
    with pytest.raises(FileFormatError, match="standard input: expected one of the formats"):
        read("-")
    with pytest.raises(FileFormatError, match="format of standard output"):
        write("-", CLOUD)
    for name in ("stdin", "stdout"):
        monkeypatch.setattr(sys, name, None)
    with pytest.raises(FileFormatError, match="expected standard input"):
        read("-", "xyz")
    with pytest.raises(OutputError, match="expected standard output"):
        write("-", CLOUD, "ply")


def test_convert_is_a_filter():
    words = ["convert", "-", "-", "--from", "xyz", "--to", "csv"]
    program = "from gppcs.app.cli import main; main()"
    run = subprocess.run([sys.executable, "-c", program, *words], input=TEXT, capture_output=True, check=True)
    assert run.stdout == b"x,y,z,label\n0.5,1.0,2.0,7\n3.0,4.0,5.0,8\n"
    assert run.stderr == b""
