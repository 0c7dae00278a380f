"""The options of pictures: `--view`, `--up` and `--colour`."""

from pathlib import Path

import numpy as np
import pytest

import gppcs
from gppcs.drawing.viewpoint import Viewpoint

OF_COMMAND = {
    "render": ("scan.ply", "kept.ply", "-o", "a.png"),
    "compare": ("scan.ply", "-o", "side", "--points", 40, "--methods", "fps"),
}


@pytest.mark.parametrize("command", ["render", "compare"])
def test_view_and_up_turn_the_picture(gppcs_command, scan, monkeypatch, command):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    gppcs.write("kept.ply", scan.take(range(0, 400, 10)))
    drawn = []
    for home in ("pair.draw_pair", "side_by_side.draw_comparison"):
        monkeypatch.setattr(f"gppcs.drawing.{home}", lambda file, *given: drawn.append(given[-2]))
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 0)
    arguments = (command, *OF_COMMAND[command], "--force")
    for options in ((), ("--view", "-30,20.5"), ("--up", "-z"), ("--view=5,0", "--up=y")):
        assert gppcs_command(*arguments, *options)[0] == 0
    assert drawn == [Viewpoint(), Viewpoint(None, (-30.0, 20.5)), Viewpoint("-z"), Viewpoint("y", (5.0, 0.0))]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["render", "compare"])
def test_the_picture_shows_the_colour_asked_for_at_kept_points(gppcs_command, scan, monkeypatch, command):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    pictures = []
    for home in ("pair.draw_pair", "side_by_side.draw_comparison"):
        monkeypatch.setattr(f"gppcs.drawing.{home}", lambda file, *given: pictures.append(given))
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 0)
    red = (np.arange(400) % 251).astype(np.uint8)
    points = np.vstack([scan.points, [[np.nan] * 3]])[np.roll(np.arange(401), 1)]  # the first has no place
    colours = dict(zip(("red", "green", "blue"), [np.append(0, red)] * 3, strict=True))
    gppcs.write("scan.ply", gppcs.PointCloud(points, colours), force=True)
    gppcs.write("kept.ply", gppcs.read("scan.ply").take(range(1, 401, 10)))
    arguments = (command, *OF_COMMAND[command], "--force", *(("--drop", "invalid") if command == "compare" else ()))
    for options in ((), ("--colour", "variation"), ("--colour", "rgb")):
        assert gppcs_command(*arguments, *options)[0] == 0
    shown = [[each.cloud for each in given[0]] if command == "compare" else given[1:3] for given in pictures]
    assert [given[-1] and given[-1].title for given in pictures] == [None, None, "RGB"]
    assert [each[0].colours is None for each in shown] == [True, True, False]
    original, kept = shown[2]
    np.testing.assert_array_equal(original.colours[:, 0], red / 255.0)
    rows = [int(np.flatnonzero((original.points == point).all(axis=1))[0]) for point in kept.points]
    np.testing.assert_array_equal(kept.colours, original.colours[rows])


def test_compare_refuses_a_colour_before_the_work(gppcs_command, scan):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    options = ("--points", 9, "--methods", "fps", "--colour", "rad")
    code, _, err = gppcs_command("compare", "scan.ply", "-o", "side", *options)
    assert code == 2
    assert "found 'rad'; expected one of rgb" in err
    assert not Path("side").exists()
