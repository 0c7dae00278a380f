"""The tables of quality show where `gp` is behind, and keep the clouds of the rules apart from the others."""

import pytest


@pytest.fixture(scope="module")
def quality(script):
    return script("quality.py")


def made(gp, fps, random):
    """Return runs with the given figures in place of all."""
    names = ("hausdorff_mean", "hausdorff_max", "surface_mean", "surface_p95", "covering_radius", "feature_error")
    rows = {"gp": gp, "fps": fps, "random": random, "sample-elimination": random}
    return {label: [dict.fromkeys((*names, "mean_surface_variation"), value)] for label, value in rows.items()}


def test_the_summary_compares_with_the_best_rival_of_each_cloud(quality):
    first, second = quality.FOUND_ON[:2]
    groups = {first: made(1.0, 2.0, 4.0), second: made(4.0, 3.0, 2.0)}
    section = quality.summary("Summary", groups)
    assert [len(row) for row in section.rows] == [len(section.header)] * 3
    ahead, behind, means = section.rows
    assert ahead[:3] == [first.name, "0.500", "fps"]
    assert behind[1] == "**2.000, behind**"
    assert means[1:3] == ["1.000", "ahead on 1 of 2"]
    rank = section.header.index("rank in mean surface variation")
    assert ahead[rank] == "4 of 4"  # the largest variation is first


def test_no_held_out_cloud_took_part_in_finding_the_rules(quality):
    found_on = {each.file for each in quality.FOUND_ON}
    assert len(quality.FOUND_ON) == 13
    assert not {each.file for each in quality.HELD_OUT} & found_on
    assert set(quality.LIDAR) < set(quality.HELD_OUT)
    names = [each.name for each in (*quality.FOUND_ON, *quality.HELD_OUT)]
    assert len(set(names)) == len(names)
