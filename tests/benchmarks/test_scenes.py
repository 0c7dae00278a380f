"""One function scores a method on a scene; the tables name the scenes that are held out."""

from functools import cache

import numpy as np
import pytest

import gppcs


@pytest.fixture(scope="module")
def scenes(script):
    return script("scenes.py")


@pytest.fixture
def small(scenes, monkeypatch):
    """The script with sample scenes of few points."""
    conditions = scenes.conditions
    monkeypatch.setattr(conditions, "SCENE", 3000)
    monkeypatch.setattr(conditions, "SURFACE_SAMPLE", 2000)
    monkeypatch.setattr(conditions, "_prepare", lambda method: None)  # no times are wanted
    monkeypatch.setattr(scenes, "scene_of", cache(scenes.scene_of.__wrapped__))
    for name in ("measured_scene", "exact_scene"):
        monkeypatch.setattr(conditions, name, cache(getattr(conditions, name).__wrapped__))
    return scenes


def test_a_score_is_the_judgement_by_the_exact_surface(small):
    found = small.score("room", "fps", ratio=0.1)
    original = small.conditions.exact_scene("room")
    kept = gppcs.simplify(small.conditions.measured_scene("room"), ratio=0.1, method="fps").cloud
    expected = gppcs.evaluate(original, kept).figures(relative=True)
    assert {column.figure for column in small.MEASURES} < set(found)
    assert found["points_out"] == 300
    for column in small.MEASURES:
        assert found[column.figure] == pytest.approx(expected[column.figure])


def test_the_surface_that_judges_is_without_noise(small):
    exact, measured = small.conditions.exact_scene("room").points, small.conditions.measured_scene("room").points
    on_the_floor = [np.mean(np.abs(points[:, 2]) < 1e-6) for points in (exact, measured)]
    assert on_the_floor[0] > 0.1 > on_the_floor[1]


def made(gp, fps, other):
    """Return runs with the given figures in place of all measures."""
    figures = ("surface_mean", "surface_p95", "surface_mean_by_area", "surface_p95_by_area", "feature_error")
    rows = {"gp": gp, "fps": fps, "random": other}
    return {label: [dict.fromkeys((*figures, "covering_p999"), value)] for label, value in rows.items()}


def test_the_summary_is_the_geometric_mean_of_all_and_of_the_held_out(scenes):
    kitti, redwood = (
        next(each for each in scenes.CONDITIONS if each.file == name) for name in ("kitti_000000", "redwood_fragment")
    )
    all_made = {kitti: made(1.0, 4.0, 2.0), redwood: made(4.0, 2.0, 8.0)}
    best = scenes.beside("best", all_made, scenes.best_rival)
    row = dict(zip(best.header, best.rows[0], strict=True))
    assert (row["all"], row["held out"], row["the others"]) == ("1.000", "**2.000, behind**", "0.500")
    assert (row["largest"], row["conditions"]) == ("**2.000, behind**", "ahead on 1 of 2")
    fps = scenes.beside("fps", all_made, lambda *_: "fps")
    assert [row[1] for row in fps.rows] == ["0.707"] * len(scenes.MEASURES)
    assert [row[1] for row in scenes.each_condition(all_made).rows] == ["0.500 random", "**2.000, behind** fps"]
    assert [row[:2] for row in scenes.each_rival(all_made).rows] == [["fps", "0.707"], ["random", "0.500"]]
