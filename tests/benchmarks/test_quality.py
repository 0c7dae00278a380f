"""The tables of quality show where `gp` is behind, and keep the clouds of the rules apart from the others."""

import importlib
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def quality():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module("quality")
    finally:
        sys.path.remove(str(BENCHMARKS))


def made(gp, fps, random):
    """Return runs with the given figures in place of all."""
    names = ("hausdorff_mean", "hausdorff_max", "surface_mean", "surface_p95", "covering_radius", "feature_error")
    rows = {"gp": gp, "fps": fps, "random": random, "sample-elimination": random}
    return {label: [dict.fromkeys((*names, "mean_surface_variation"), value)] for label, value in rows.items()}


def test_a_cell_that_is_behind_says_so(quality):
    assert quality.shown(1.2) == "**1.200, behind**"
    assert quality.shown(0.8) == "0.800"
    assert quality.shown(1.0) == "1.000"
    assert quality.shown(float("nan")) == ""


def test_the_summary_compares_with_the_best_rival_of_each_cloud(quality):
    first, second = quality.FOUND_ON[:2]
    groups = {first: made(1.0, 2.0, 4.0), second: made(4.0, 3.0, 2.0)}
    section = quality.summary("Summary", groups)
    assert [len(row) for row in section.rows] == [len(section.header)] * 3
    ahead, behind, means = section.rows
    assert ahead[:3] == [first.name, "0.500", "fps"]
    assert behind[1] == "**2.000, behind**"
    assert means[1:3] == ["1.000", "ahead on 1 of 2"]
    assert ahead[7] == "4 of 4"  # the largest variation is first


def test_figures_that_a_cloud_lacks_stay_empty(quality):
    scene = quality.LIDAR[0]
    runs = made(1.0, 2.0, 4.0)
    for of_label in runs.values():
        del of_label[0]["hausdorff_mean"]
    row = quality.summary("Summary", {scene: runs}).rows[0]
    assert row[1:3] == ["", ""]
    assert row[5:7] == ["0.500", "fps"]


def test_scenes_of_lidar_stand_beside_fps(quality):
    scene = quality.LIDAR[0]
    gp, fps, _ = quality.lidar({scene: made(3e-4, 2e-4, 4e-4)}).rows
    assert gp[:3] == [scene.name, "gp", "**3.00, behind**"]
    assert fps[:3] == [scene.name, "fps", "2.00"]


def test_rivals_are_compared_one_by_one(quality):
    cloud = quality.FOUND_ON[0]
    rows = quality.rival_by_rival({"some clouds": {cloud: made(2.0, 1.0, 4.0)}}).rows
    assert dict(row[:2] for row in rows) == {
        "fps": "**2.000, behind**; ahead on 0 of 1",
        "random": "0.500; ahead on 1 of 1",
        "sample-elimination": "0.500; ahead on 1 of 1",
    }


def test_no_held_out_cloud_took_part_in_finding_the_rules(quality):
    found_on = {each.file for each in quality.FOUND_ON}
    assert len(quality.FOUND_ON) == 13
    assert not {each.file for each in quality.HELD_OUT} & found_on
    assert set(quality.LIDAR) < set(quality.HELD_OUT)
    names = [each.name for each in (*quality.FOUND_ON, *quality.HELD_OUT)]
    assert len(set(names)) == len(names)
