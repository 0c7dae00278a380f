"""The options of pictures: `--view`, `--up` and `--colour`."""

from pathlib import Path

import numpy as np
import pytest

import gppcs
from command_line import FAST
from gppcs.drawing.viewpoint import Viewpoint


@pytest.mark.parametrize("command", [("simplify", "-o", "out.ply", "--picture", "a.png"), ("compare", "-o", "side")])
def test_view_and_up_turn_the_picture(gppcs_command, scan, monkeypatch, command):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    drawn = []
    for home in ("pair.draw_pair", "side_by_side.draw_comparison"):
        monkeypatch.setattr(f"gppcs.drawing.{home}", lambda file, *given: drawn.append(given[-2]))
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 0)
    name, *rest = command
    methods = ["--methods", "fps"] if name == "compare" else FAST
    arguments = (name, "scan.ply", *rest, "--points", 2, "--force", *methods)
    for options in ((), ("--view", "-30,20.5"), ("--up", "-z"), ("--view=5,0", "--up=y")):
        assert gppcs_command(*arguments, *options)[0] == 0
    assert drawn == [Viewpoint(), Viewpoint(None, (-30.0, 20.5)), Viewpoint("-z"), Viewpoint("y", (5.0, 0.0))]


@pytest.mark.slow
@pytest.mark.parametrize("command", [("simplify", "-o", "out.ply", "--picture", "a.png"), ("compare", "-o", "side")])
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
    gppcs.write("red.ply", gppcs.PointCloud(points, colours))
    name, *rest = command
    methods = ["--methods", "fps"] if name == "compare" else ["--method", "fps"]
    arguments = (name, "red.ply", *rest, "--points", 40, "--force", "--invalid", "drop", *methods)
    for options in ((), ("--colour", "variation"), ("--colour", "rgb")):
        assert gppcs_command(*arguments, *options)[0] == 0
    shown = [given[0] if name == "compare" else given[1:3] for given in pictures]
    assert [given[-1] and given[-1].title for given in pictures] == [None, None, "RGB"]
    assert [each[0].colours is None for each in shown] == [True, True, False]
    original, kept = shown[2]
    np.testing.assert_array_equal(original.colours[:, 0], red / 255.0)
    rows = [int(np.flatnonzero((original.points == point).all(axis=1))[0]) for point in kept.points]
    np.testing.assert_array_equal(kept.colours, original.colours[rows])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--picture", "a.png", "--colour", "rad"), "found 'rad'; expected one of rgb"),
        (("--colour", "rgb"), "found none; request a picture"),
    ],
)
def test_a_colour_that_cannot_be_drawn_is_refused(gppcs_command, scan, options, message):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 9, *options)
    assert code == 2
    assert message in err
    assert err.count("\n") == 1


def test_compare_refuses_a_colour_before_the_work(gppcs_command, scan):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    options = ("--points", 9, "--methods", "fps", "--colour", "rad")
    code, _, err = gppcs_command("compare", "scan.ply", "-o", "side", *options)
    assert code == 2
    assert "found 'rad'; expected one of rgb" in err
    assert not Path("side").exists()
