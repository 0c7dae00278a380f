"""Files are complete or not there and nothing is overwritten unasked; compressed files, standard input and output."""

import gzip
import io
import os
import stat
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from formats import WRITABLE
from gppcs import PointCloud
from gppcs.errors import FileFormatError, OutputError
from gppcs.io import CloudFiles, check_distinct, check_writable, read, whole_output, write

CLOUD = PointCloud([[0.5, 1, 2], [3, 4, 5e30]])
TEXT = b"# x y z label\n0.5 1 2 7\n3 4 5 8\n"


@pytest.mark.parametrize("suffix", WRITABLE)
def test_compressed_files_and_standard_input_hold_what_plain_files_do(tmp_path, stdin, suffix):
    plain, packed = tmp_path / f"cloud{suffix}", tmp_path / f"cloud{suffix}.gz"
    for path in (plain, packed):
        write(path, CLOUD, lossy=True)
    assert gzip.decompress(packed.read_bytes()) == plain.read_bytes()
    assert read(packed) == read(plain)
    stdin(plain.read_bytes())
    assert read("-", suffix) == read(plain)


def test_compression_is_found_by_content_and_streams_are_read_one_after_another(tmp_path):
    (tmp_path / "cloud.xyz").write_bytes(gzip.compress(TEXT) + gzip.compress(b"6 7 8 9\n"))
    assert read(tmp_path / "cloud.xyz").attributes["label"].tolist() == [7, 8, 9]


@pytest.mark.parametrize("damage", [lambda data: data[:-6], lambda data: data[:14] + b"junk" + data[18:]])
def test_damaged_compression_is_refused(tmp_path, damage):
    path = tmp_path / "cloud.xyz.gz"
    path.write_bytes(damage(gzip.compress(os.urandom(300).hex().encode())))
    with pytest.raises(FileFormatError, match=r"cloud\.xyz\.gz: expected"):
        read(path)


@pytest.fixture
def stdin(monkeypatch):
    """Let standard input hold some bytes."""

    def hold(content):
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BufferedReader(io.BytesIO(content))))

    return hold


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


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit, OSError])
@pytest.mark.parametrize("existing", [None, b"precious"])
@pytest.mark.parametrize("name", ["result.png", "result.csv.gz"])
def test_nothing_is_left_of_a_failed_write(tmp_path, failure, existing, name):
    path = tmp_path / name
    if existing:
        path.write_bytes(existing)

    def fail():
        with whole_output(path, force=True) as file:
            file.write(b"half")
            file.flush()
            raise failure

    with pytest.raises(failure):
        fail()
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([existing] if existing else [])


def test_existing_files_are_kept_unless_forced(tmp_path):
    path = tmp_path / "cloud.xyz"
    path.write_text("precious")
    for attempt in (lambda: write(path, CLOUD), lambda: check_writable(path)):
        with pytest.raises(OutputError, match=r"cloud\.xyz: the file exists"):
            attempt()
    assert path.read_text() == "precious"
    write(path, CLOUD, force=True)
    assert path.read_text().startswith("0.5 1.0 2.0\n")
    for target in (tmp_path / "missing" / "cloud.ply", tmp_path):
        with pytest.raises(OutputError, match="a folder"):
            check_writable(target, force=True)


@pytest.mark.skipif(os.name != "posix", reason="links as on Unix")
def test_a_link_stays_a_link(tmp_path):
    real, link = tmp_path / "real.ply", tmp_path / "link.ply"
    link.symlink_to(real)
    write(link, CLOUD)
    write(link, PointCloud(np.zeros((3, 3))), force=True)
    assert link.is_symlink()
    assert b"element vertex 3\n" in real.read_bytes()


def test_a_file_that_appears_during_the_work_is_kept(tmp_path):
    path = tmp_path / "cloud.xyz"

    def late():
        with whole_output(path) as file:
            file.write(b"ours")
            path.write_text("theirs")

    with pytest.raises(OutputError, match=r"cloud\.xyz: the file exists"):
        late()
    assert [file.read_text() for file in tmp_path.iterdir()] == ["theirs"]


@pytest.mark.skipif(os.name != "posix", reason="permissions as on Unix")
@pytest.mark.parametrize("mode", [0o600, 0o444, 0o664])
def test_a_new_file_follows_the_umask_and_a_replaced_one_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "cloud.ply"
    before = os.umask(0o027)
    try:
        write(path, CLOUD)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(mode)
    with whole_output(path, force=True):
        (part,) = set(tmp_path.iterdir()) - {path}
        assert stat.S_IMODE(part.stat().st_mode) == mode  # nobody else can read it before it is complete
    assert stat.S_IMODE(path.stat().st_mode) == mode


@pytest.mark.skipif(os.name != "posix", reason="links as on Unix")
def test_outputs_that_are_inputs_or_each_other_are_found(tmp_path):
    scan, missing = tmp_path / "scan.ply", tmp_path / "missing.ply"
    scan.write_text("")
    (tmp_path / "folder").mkdir()
    soft, loose = tmp_path / "soft.ply", tmp_path / "loose.ply"
    soft.symlink_to(scan)
    loose.symlink_to(missing)
    check_distinct([tmp_path / "a.ply", tmp_path / "b.ply"], [scan, scan, missing])
    for output in (scan, soft, loose, missing, tmp_path / "folder" / ".." / "scan.ply"):
        with pytest.raises(OutputError, match="expected a file that is no input, found an input"):
            check_distinct([tmp_path / "a.ply", output], [missing, scan])
    for first, second in ((scan, soft), (missing, loose)):
        with pytest.raises(OutputError, match="expected a file for each result, found one for two"):
            check_distinct([first, second], [])


class Pipe(io.BytesIO):
    """A file in which one cannot seek."""

    def seekable(self):
        return False


def test_an_open_file_is_read_again_or_refused_if_one_cannot_seek_in_it(tmp_path):
    write(tmp_path / "a.laz", PointCloud(np.eye(3)))
    with open(tmp_path / "a.laz", "rb") as file:
        assert read(file) == read(tmp_path / "a.laz")
    with pytest.raises(FileFormatError, match="open it as 'rb'"):
        read(io.StringIO("1 2 3\n"))
    stream = io.BytesIO(b"junk" + TEXT)
    stream.seek(4)
    files = CloudFiles(stream, "xyz")
    assert files.read() == files.read()
    files = CloudFiles(Pipe(TEXT), "xyz")
    assert len(files.read()) == 2
    with pytest.raises(FileFormatError, match="was read before"):
        files.read()
