"""The options `--view` and `--up`."""

import pytest

from command_line import FAST
from gppcs.drawing.viewpoint import Viewpoint


@pytest.mark.parametrize("command", [("simplify", "-o", "out.ply", "--picture", "a.png"), ("compare", "-o", "side")])
def test_view_and_up_turn_the_picture(gppcs_command, scan, monkeypatch, command):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    drawn = []
    for home in ("pair.draw_pair", "side_by_side.draw_comparison"):
        monkeypatch.setattr(f"gppcs.drawing.{home}", lambda file, *given: drawn.append(given[-1]))
    monkeypatch.setattr("gppcs.app.pages.MOST_TO_REBUILD", 0)
    name, *rest = command
    methods = ["--methods", "fps"] if name == "compare" else FAST
    arguments = (name, "scan.ply", *rest, "--points", 2, "--force", *methods)
    for options in ((), ("--view", "-30,20.5"), ("--up", "-z"), ("--view=5,0", "--up=y")):
        assert gppcs_command(*arguments, *options)[0] == 0
    assert drawn == [Viewpoint(), Viewpoint(None, (-30.0, 20.5)), Viewpoint("-z"), Viewpoint("y", (5.0, 0.0))]
