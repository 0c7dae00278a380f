"""Files are whole or not there, and nothing is overwritten unasked."""

import errno
import os
import stat
import threading

import numpy as np
import pytest

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import OutputError
from gppcs.io import check_distinct, check_writable, whole_output, write

CLOUD = PointCloud([[1.5, 2.5, 3.5]])


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit, OSError])
@pytest.mark.parametrize("existing", [None, b"precious"])
def test_nothing_is_left_of_a_failed_write(tmp_path, failure, existing):
    path = tmp_path / "result.png"
    if existing:
        path.write_bytes(existing)

    def fail():
        with whole_output(path, force=True) as file:
            file.write(b"half")
            file.flush()
            assert len(list(tmp_path.iterdir())) == (2 if existing else 1)
            raise failure

    with pytest.raises(failure):
        fail()
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([existing] if existing else [])


def test_existing_files_are_kept_unless_forced(tmp_path):
    path = tmp_path / "cloud.xyz"
    path.write_text("precious")
    for attempt in (lambda: write(path, CLOUD), lambda: check_writable(path)):
        with pytest.raises(OutputError, match=r"cloud\.xyz: expected a new file, found one"):
            attempt()
    assert path.read_text() == "precious"
    check_writable(path, force=True)
    write(path, CLOUD, force=True)
    assert path.read_text() == "1.5 2.5 3.5\n"


def test_missing_folders_and_folders_as_targets_are_told(tmp_path):
    for path, message in (
        (tmp_path / "missing" / "cloud.ply", r"a folder .*missing, found none"),
        (tmp_path, "a folder"),
    ):
        with pytest.raises(OutputError, match=message):
            check_writable(path, force=True)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs a user bound by permissions")
def test_closed_folders_are_told(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="no permission"):
        check_writable(tmp_path / "cloud.ply")
    tmp_path.chmod(0o700)


@pytest.mark.skipif(os.name != "posix", reason="links as on Unix")
def test_a_link_stays_a_link(tmp_path):
    real, link = tmp_path / "real.ply", tmp_path / "link.ply"
    link.symlink_to(real)
    write(link, CLOUD)
    write(link, PointCloud(np.zeros((2, 3))), force=True)
    assert link.is_symlink()
    assert b"element vertex 2\n" in real.read_bytes()


def test_of_two_that_write_at_the_same_time_one_wins(tmp_path):
    path, both_began = tmp_path / "cloud.xyz", threading.Barrier(8)
    ends = []

    def run(name):
        try:
            with whole_output(path) as file:
                both_began.wait()  # all have found no file of that name
                file.write(name)
            ends.append(name)
        except OutputError as error:
            ends.append(str(error))

    runs = [threading.Thread(target=run, args=(bytes([letter]),)) for letter in b"abcdefgh"]
    for each in runs:
        each.start()
    for each in runs:
        each.join()
    (winner,) = [end for end in ends if isinstance(end, bytes)]
    assert path.read_bytes() == winner
    assert [end for end in ends if end != winner] == [str(_refused(path))] * 7
    assert list(tmp_path.iterdir()) == [path]


def _refused(path):
    with pytest.raises(OutputError, match="expected a new file, found one") as caught:
        check_writable(path)
    return caught.value


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_that_appears_during_the_work_is_kept(tmp_path, monkeypatch, has_links):
    def refuse(*arguments):
        raise OSError(errno.EPERM, "Operation not permitted")

    if not has_links:
        monkeypatch.setattr(os, "link", refuse)
    path = tmp_path / "cloud.xyz"

    def late():
        with whole_output(path) as file:
            file.write(b"ours")
            path.write_text("theirs")

    with pytest.raises(OutputError, match=r"cloud\.xyz: expected a new file, found one"):
        late()
    assert [each.read_text() for each in tmp_path.iterdir()] == ["theirs"]


def test_no_empty_file_is_left_where_renaming_fails(tmp_path, monkeypatch):
    def refuse(*arguments):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "link", refuse)
    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(OSError, match="Input/output error"):
        write(tmp_path / "cloud.ply", CLOUD)
    assert not any(tmp_path.iterdir())


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
    with whole_output(path, force=True) as file:
        (part,) = set(tmp_path.iterdir()) - {path}
        assert stat.S_IMODE(part.stat().st_mode) == mode  # nobody else can read it before it is complete
        file.write(b"new")
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert path.read_text() == "new"


@pytest.mark.skipif(os.name != "posix", reason="links as on Unix")
def test_outputs_that_are_inputs_or_each_other_are_found_by_every_way(tmp_path):
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
    for first, second in ((scan, soft), (missing, loose), (missing, missing.with_name("missing.ply"))):
        with pytest.raises(OutputError, match="expected a file for each result, found one for two"):
            check_distinct([first, second], [])
