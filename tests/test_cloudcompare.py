"""The plugin for CloudCompare, against stubs written from the documented interface of CloudCompare-PythonRuntime.

They have the classes and functions that the plugin uses: this does not show that it runs in CloudCompare itself.
"""

import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import entry_points
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import gppcs


class Cloud:
    """Stands for pycc.ccPointCloud, with one scalar field."""

    def __init__(self, points, field, name="scan"):
        self.places, self.field, self.name = points, field, name

    def points(self):
        return self.places

    def getName(self):  # noqa: N802
        return self.name

    def setName(self, name):  # noqa: N802
        self.name = name

    def partialClone(self, reference):  # noqa: N802
        assert reference.cloud is self
        if self.name == "too large":  # for the memory that there is
            return None
        return Cloud(self.places[reference.rows], self.field[reference.rows], self.name)


class ReferenceCloud:
    """Stands for cccorelib.ReferenceCloud."""

    def __init__(self, cloud):
        self.cloud, self.rows = cloud, []

    def addPointIndex(self, row):  # noqa: N802
        assert type(row) is int
        self.rows.append(row)


def run_in_thread(function, *arguments):
    """Stands for pycc.RunInThread, which passes on that there was an error, but not which."""
    with ThreadPoolExecutor() as pool:
        try:
            return pool.submit(function, *arguments).result()
        except Exception:
            raise RuntimeError("std::exception") from None


@pytest.fixture
def plugin(monkeypatch):
    """Import the plugin as CloudCompare would; `plugin.pycc` is the stub, with selected entities and those added."""
    pycc, cccorelib = ModuleType("pycc"), ModuleType("cccorelib")
    pycc.selected, pycc.added = [], []
    pycc.ccPointCloud, cccorelib.ReferenceCloud = Cloud, ReferenceCloud
    pycc.PythonPluginInterface = type("PythonPluginInterface", (), {})
    pycc.Action = SimpleNamespace
    pycc.RunInThread = run_in_thread
    pycc.GetInstance = lambda: SimpleNamespace(
        getSelectedEntities=lambda: pycc.selected, addToDB=pycc.added.append, updateUI=lambda: None
    )
    for module in (pycc, cccorelib):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.delitem(sys.modules, "gppcs.cloudcompare", raising=False)
    yield importlib.import_module("gppcs.cloudcompare")
    sys.modules.pop("gppcs.cloudcompare")


@pytest.fixture
def told(plugin, monkeypatch):
    """Collect the messages, and answer each dialog."""
    messages = []
    monkeypatch.setattr(plugin, "_show", messages.append)
    monkeypatch.setattr(plugin, "_ask", lambda defaults: {**defaults, plugin.AMOUNT: "40"})
    return messages


def test_the_plugin_is_found_and_has_an_action(plugin):
    (found,) = entry_points(group="cloudcompare.plugins", name="gppcs")
    assert found.load() is plugin.Plugin
    (action,) = plugin.Plugin().getActions()
    assert (action.name, action.target) == ("Simplify", plugin.simplify_selected)


def test_selected_clouds_get_simplified_copies_with_their_fields(plugin, told):
    points = gppcs.sample("bracket", n_points=1_000).points.astype(np.float32)
    plugin.pycc.selected += ["a mesh", Cloud(points, np.arange(1_000))]
    plugin.simplify_selected()
    (copy,) = plugin.pycc.added
    expected = gppcs.simplify(points, n_points=40)
    np.testing.assert_array_equal(copy.field, expected.indices)
    np.testing.assert_array_equal(copy.places, points[expected.indices])
    assert copy.name == "scan (40 points, gp)"
    assert not told


def test_what_is_wrong_is_told_and_other_clouds_are_simplified(plugin, told):
    plugin.simplify_selected()
    points = gppcs.sample("bracket", n_points=50).points
    plugin.pycc.selected += [
        Cloud(np.full((50, 3), np.nan), np.arange(50), "bad"),
        Cloud(np.empty((0, 3), np.float32), np.empty(0), "empty"),
        Cloud(points, np.arange(50), "too large"),
        Cloud(points, np.arange(50), "good"),
    ]
    plugin.simplify_selected()
    assert told[0] == "Select one or more point clouds first."
    assert [text.partition(":")[0] for text in told[1:]] == ["bad", "empty", "too large"]
    assert "NaN" in told[1]
    assert "memory" in told[3]
    assert [copy.name for copy in plugin.pycc.added] == ["good (40 points, gp)"]
