"""The tables of quality show where `gp` is behind, and keep the clouds of the rules apart from the others."""

import pytest


@pytest.fixture(scope="module")
def quality(script):
    return script("quality.py")


def test_no_held_out_cloud_took_part_in_finding_the_rules(quality):
    found_on = {each.file for each in quality.FOUND_ON}
    assert len(quality.FOUND_ON) == 13
    assert not {each.file for each in quality.HELD_OUT} & found_on
    assert set(quality.LIDAR) < set(quality.HELD_OUT)
    names = [each.name for each in (*quality.FOUND_ON, *quality.HELD_OUT)]
    assert len(set(names)) == len(names)
