"""A method that an installed package offers in the entry point group gppcs.methods is as good as our own."""

import os
import subprocess
import sys

import pytest

import gppcs

METHOD = '''
import sys
from dataclasses import dataclass

import gppcs

print("the plugin is imported", file=sys.stderr)


@dataclass(frozen=True)
class EveryNth(gppcs.Method):
    """Points at equal steps."""

    name = "every-nth"
    summary = "points at equal steps in the order of the file"
    description = "Chooses points at equal steps in the order of the file."
    source = "an example"

    start: float = gppcs.parameter(0.0, "Where to start, in steps.")

    def __call__(self, task):
        import numpy as np

        steps = np.arange(task.n_points) + self.start
        return gppcs.Selection((steps * len(task.points) / task.n_points).astype(np.int64))
'''
ENTRIES = """
[gppcs.methods]
every-nth = plugin:EveryNth
broken = plugin:NoSuchClass
gp = plugin:EveryNth
"""


@pytest.fixture
def run(tmp_path):
    """Run the command, or some code, in a process where a package with methods is installed."""
    folder = tmp_path / "site"
    about = folder / "some_plugin-1.0.dist-info"
    about.mkdir(parents=True)
    (folder / "plugin.py").write_text(METHOD)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: some-plugin\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRIES)
    path = os.pathsep.join([str(folder), *sys.path])

    def run(*arguments, code=0):
        start = ("-m", "gppcs") if arguments[0] != "-c" else ()
        done = subprocess.run(
            [sys.executable, *start, *arguments],
            capture_output=True, text=True, check=False, cwd=tmp_path, env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip
        assert done.returncode == code, done.stderr
        return " ".join(done.stdout.split()), " ".join(done.stderr.split())

    return run


def test_an_installed_method_simplifies_and_is_compared(run, tmp_path):
    gppcs.write(tmp_path / "cloud.ply", cloud := gppcs.sample("sphere", n_points=600))
    run("simplify", "cloud.ply", "-o", "few.ply", "--points", "60", "--method", "every-nth", "--set", "start=.5")
    assert gppcs.read(tmp_path / "few.ply").points.tolist() == cloud.points[5::10].tolist()
    code = "import gppcs; c = gppcs.read('cloud.ply'); print(gppcs.compare(c, ['every-nth'], n_points=9)[0].method)"
    assert run("-c", code)[0] == "every-nth"


def test_installed_methods_are_listed_and_broken_ones_noted(run):
    listed, notes = run("methods")
    assert "every-nth: points at equal steps in the order of the file" in listed
    assert "the method 'broken' of the package 'some-plugin' cannot be used: AttributeError" in notes
    assert "gp: a local Gaussian process" in listed  # not that of the package
    assert "start (float, default 0.0) Where to start, in steps." in run("methods", "every-nth")[0]


def test_a_broken_method_is_an_error_where_it_is_named_only(run, tmp_path):
    gppcs.write(tmp_path / "cloud.ply", gppcs.sample("sphere", n_points=600))
    simplify = ("simplify", "cloud.ply", "-o", "few.ply", "--points", "60", "--method")
    assert "the method 'broken' of the package 'some-plugin' cannot be used" in run(*simplify, "broken", code=2)[1]
    assert run(*simplify, "random")[1] == ""
    assert "broken" not in run(*simplify, "evry-nth", "--force", code=2)[1]
