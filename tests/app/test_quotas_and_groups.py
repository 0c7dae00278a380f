"""Quotas and groups in the command, on a file that laspy writes."""

import laspy
import numpy as np
import pytest

import gppcs

N_PULSES = 3000


@pytest.fixture(scope="module")
def tile(tmp_path_factory):
    """Write a LAS file of pulses with one to four returns by two channels, and classes."""
    random = np.random.default_rng(0)
    returns = random.integers(1, 5, N_PULSES)
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.header.scales = [1e-4] * 3
    las.x, las.y = np.repeat(random.random((N_PULSES, 2)), returns, axis=0).T
    las.z = np.concatenate([np.arange(count) * 0.05 for count in returns])
    las.gps_time = np.repeat(1e8 + np.arange(N_PULSES) // 2, returns)
    las.scanner_channel = np.repeat(np.arange(N_PULSES) % 2, returns)
    las.classification = np.where(las.x < 0.1, 6, 2)
    path = tmp_path_factory.mktemp("tile") / "tile.las"
    las.write(path)
    return path


def pulses(path):
    """Return time and channel of each pulse in a file, as one number, and the number of its returns."""
    las = laspy.read(path)
    return np.unique(las.gps_time * 4 + las.scanner_channel, return_counts=True)


def test_pulses_stay_whole(gppcs_command, tile):
    code, out, err = gppcs_command("simplify", tile, "-o", "out.laz", "--ratio", "20%", "--group", "gps_time")
    assert code == 0, err
    (before, of_before), (after, of_after) = pulses(tile), pulses("out.laz")
    np.testing.assert_array_equal(of_after, of_before[np.isin(before, after)])
    assert abs(of_after.sum() - 0.2 * of_before.sum()) <= 3
    assert all(f"{len(times):,}" in out for times in (before, after))


def test_quotas_are_exact(gppcs_command, tile):
    options = "--points", 500, "--quota", "classification == 6: 30%"
    code, _, err = gppcs_command("simplify", tile, "-o", "out.laz", *options)
    assert code == 0, err
    classes = np.asarray(laspy.read("out.laz").classification)
    assert ((classes == 6).sum(), len(classes)) == (150, 500)


def test_detail_that_counts_for_nothing_is_told(gppcs_command):
    rng = np.random.default_rng(0)
    cloud = gppcs.PointCloud(rng.random((2_000, 3)), {"grey": np.full(2_000, 7.0), "noise": rng.random(2_000)})
    gppcs.write("scan.ply", cloud)
    for name, told in (("grey", "attribute 'grey' is 7 everywhere"), ("noise", "the detail is only noise")):
        words = ("simplify", "scan.ply", "-o", f"{name}.ply", "--points", 200, "-q", "--detail", name)
        code, _, err = gppcs_command(*words)
        assert (code, err.count("\n")) == (0, 1)
        assert err.startswith(f"gppcs: note: {told}")
