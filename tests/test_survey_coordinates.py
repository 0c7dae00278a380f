"""Clouds in survey coordinates, of millions of metres, are simplified as they are at the origin."""

import laspy
import numpy as np
import pytest

import gppcs

UTM = np.array([500_000.0, 5_400_000.0, 300.0])
SCALE = 2.0**-24  # metres. With millions of metres in front, float64 still holds each multiple of it.


def write_las(path, whole, offset):
    """Write coordinates that are whole multiples of the scale from an offset on."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [SCALE] * 3, offset
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = whole.T
    las.intensity = np.arange(len(whole)) % 2**16
    las.write(path)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("method", ["gp", "fps"])
def test_the_dragon_in_utm_coordinates_gives_the_indices_of_the_dragon_at_the_origin(
    shared_data, tmp_path, suffix, method
):
    dragon = gppcs.read(shared_data / "dragon.ply")
    whole = np.rint(dragon.points / SCALE).astype(np.int32)
    write_las(tmp_path / f"origin{suffix}", whole, [0.0] * 3)
    write_las(tmp_path / f"utm{suffix}", whole, UTM)
    utm = gppcs.read(tmp_path / f"utm{suffix}")
    assert (utm.points - UTM == whole * SCALE).all()
    there = gppcs.simplify(utm, n_points=3000, method=method)
    here = gppcs.simplify(tmp_path / f"origin{suffix}", n_points=3000, method=method)
    assert there.indices.tolist() == here.indices.tolist()

    gppcs.write(tmp_path / f"small{suffix}", there.cloud)
    small = laspy.read(tmp_path / f"small{suffix}")
    assert (np.column_stack([small.X, small.Y, small.Z]) == whole[there.indices]).all()
    assert (small.intensity == there.indices % 2**16).all()
    assert (small.header.scales == SCALE).all()
    assert (small.header.offsets == UTM).all()
    assert gppcs.read(tmp_path / f"small{suffix}") == there.cloud
