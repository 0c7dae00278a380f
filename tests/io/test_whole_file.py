"""Files are whole or not there, and nothing is overwritten unasked."""

import os
import stat

import numpy as np
import pytest

from gppcs.clouds.cloud import PointCloud
from gppcs.errors import OutputError
from gppcs.io import check_writable, whole_file, write

CLOUD = PointCloud([[1.5, 2.5, 3.5]])


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit, OSError])
@pytest.mark.parametrize("existing", [None, b"precious"])
def test_nothing_is_left_of_a_failed_write(tmp_path, failure, existing):
    path = tmp_path / "result.png"
    if existing:
        path.write_bytes(existing)

    def fail():
        with whole_file(path, force=True) as file:
            file.write(b"half")
            file.flush()
            assert len(list(tmp_path.iterdir())) == (2 if existing else 1)
            raise failure

    with pytest.raises(failure):
        fail()
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([existing] if existing else [])


def test_a_cloud_that_breaks_off_in_mid_write_leaves_nothing(tmp_path):
    cloud = PointCloud(CLOUD.points, {"name": np.array(["a"])})  # refused after the first line is written
    with pytest.raises(OutputError, match="numbers in attribute 'name'"):
        write(tmp_path / "cloud.pts", cloud)
    assert not any(tmp_path.iterdir())


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
    with pytest.raises(OutputError, match=r"expected a folder .*missing, found none"):
        check_writable(tmp_path / "missing" / "cloud.ply")
    with pytest.raises(OutputError, match="found a folder"):
        check_writable(tmp_path, force=True)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs a user bound by permissions")
def test_closed_folders_are_told(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="no permission"):
        check_writable(tmp_path / "cloud.ply")
    tmp_path.chmod(0o700)


@pytest.mark.skipif(os.name != "posix", reason="permissions as on Unix")
def test_permissions_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write(tmp_path / "cloud.ply", CLOUD)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "cloud.ply").stat().st_mode) == 0o640


@pytest.mark.skipif(os.name != "posix", reason="links as on Unix")
def test_a_link_stays_a_link(tmp_path):
    real, link = tmp_path / "real.ply", tmp_path / "link.ply"
    link.symlink_to(real)
    write(link, CLOUD)
    write(link, PointCloud(np.zeros((2, 3))), force=True)
    assert link.is_symlink()
    assert b"element vertex 2\n" in real.read_bytes()
