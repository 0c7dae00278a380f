"""`gppcs sample`."""

import re
from pathlib import Path

import laspy
import pytest
from scipy.spatial import cKDTree

import gppcs


def test_samples_are_the_same_for_the_same_seed(printed):
    options = ("--points", 300, "--noise", 0.001, "--outliers", 0.1, "--uneven", 0.5)
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        assert printed("sample", "fan", "-o", f"{name}.ply", *options, "--seed", seed) == f"{name}.ply: 300 points\n"
    assert Path("a.ply").read_bytes() == Path("b.ply").read_bytes() != Path("c.ply").read_bytes()
    expected = gppcs.sample("fan", 300, noise=0.001, outliers=0.1, uneven=0.5)
    assert gppcs.read("a.ply").points.tobytes() == expected.points.tobytes()


def test_the_help_names_all_samples(printed, refused):
    with pytest.raises(gppcs.ParameterError) as error:
        gppcs.sample("?")
    names = str(error.value).rpartition("one of ")[2].split(", ")
    words = set(re.findall(r"\w+", printed("sample", "--help")))
    assert len(names) > 3
    assert set(names) <= words


@pytest.mark.parametrize("suffix", ["las", "laz", "copc.laz"])
def test_samples_in_las_have_a_scale_and_a_coordinate_system(printed, suffix):
    printed("sample", "bracket", "-o", f"a.{suffix}", "--points", 300)
    with laspy.open(f"a.{suffix}") as file:
        assert file.header.scales.tolist() == [0.001] * 3
        assert str(file.header.version) == "1.4"
    cloud = gppcs.read(f"a.{suffix}")
    assert gppcs.info(cloud).unit == "mm"
    distances = cKDTree(cloud.points).query(gppcs.sample("bracket", 300).points)[0]
    assert 0 < distances.max() < 0.001
