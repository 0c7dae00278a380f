"""The options of pictures: `--view`, `--up` and `--colour`."""

import numpy as np
import pytest

import gppcs
from gppcs.drawing.viewpoint import Viewpoint

OF_COMMAND = {
    "render": ("scan.ply", "kept.ply", "-o", "a.png"),
    "compare": ("scan.ply", "-o", "side", "--points", 40, "--methods", "fps", "--drop", "invalid"),
}


@pytest.fixture
def pictures(monkeypatch):
    """The arguments of what was drawn."""
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    found = []
    monkeypatch.setattr("gppcs.drawing.side_by_side.draw_comparison", lambda file, *given, **_: found.append(given))
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 0)
    return found


@pytest.mark.parametrize("command", ["render", "compare"])
def test_view_and_up_turn_the_picture(gppcs_command, scan, pictures, command):
    gppcs.write("kept.ply", scan.take(range(0, 400, 10)))
    for options in ((), ("--view", "-30,20.5"), ("--up", "-z"), ("--view=5,0", "--up=y")):
        assert gppcs_command(command, *OF_COMMAND[command], "--force", *options)[0] == 0
    expected = [Viewpoint(), Viewpoint(None, (-30.0, 20.5)), Viewpoint("-z"), Viewpoint("y", (5.0, 0.0))]
    assert [viewpoint for _, viewpoint, _ in pictures] == expected


@pytest.mark.slow
@pytest.mark.parametrize("command", ["render", "compare"])
def test_the_picture_shows_the_colour_asked_for_at_kept_points(gppcs_command, scan, pictures, command):
    red = (np.arange(400) % 251).astype(np.uint8)
    points = np.vstack([scan.points, [[np.nan] * 3]])[np.roll(np.arange(401), 1)]  # the first has no place
    colours = dict(zip(("red", "green", "blue"), [np.append(0, red)] * 3, strict=True))
    gppcs.write("scan.ply", gppcs.PointCloud(points, colours), force=True)
    gppcs.write("kept.ply", gppcs.read("scan.ply").take(range(1, 401, 10)))
    for options in ((), ("--colour", "variation"), ("--colour", "rgb")):
        assert gppcs_command(command, *OF_COMMAND[command], "--force", *options)[0] == 0
    shown = [[each.cloud for each in columns] for columns, _, _ in pictures]
    assert [legend and legend.title for _, _, legend in pictures] == [None, None, "RGB"]
    assert [each[0].colours is None for each in shown] == [True, True, False]
    original, kept = shown[2]
    np.testing.assert_array_equal(original.colours[:, 0], red / 255.0)
    rows = [int(np.flatnonzero((original.points == point).all(axis=1))[0]) for point in kept.points]
    np.testing.assert_array_equal(kept.colours, original.colours[rows])


def test_compare_refuses_a_colour_before_the_work(refused, scan, pictures):
    words = ("compare", "scan.ply", "-o", "side", "--points", 9, "--methods", "fps", "--colour", "rad")
    refused(words, "found 'rad'; expected one of rgb")
