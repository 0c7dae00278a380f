"""Adding a method is one file, and one line in `gppcs.methods`."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gppcs

METHOD = '''
from __future__ import annotations

from dataclasses import dataclass

from gppcs.methods.method import Method, Selection, Wanted
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class EveryNth(Method):
    """Points at equal steps."""

    name = "every-nth"
    summary = "points at equal steps in the order of the file"
    description = "Chooses points at equal steps in the order of the file."
    source = "an example"

    start: float = parameter(0.0, "Where to start, in steps.")

    def __call__(self, wanted: Wanted) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        steps = np.arange(wanted.n_points) + self.start
        return Selection((steps * len(wanted.points) / wanted.n_points).astype(np.int64))
'''
LINE = "from gppcs.methods.every_nth import EveryNth as EveryNth\n"
LAST = "# isort: on\n"  # the line after the list of methods


@pytest.fixture(scope="module")
def run_command(tmp_path_factory):
    """Run the command of a copy of the package that has one more method, in a folder that holds a cloud."""
    folder = tmp_path_factory.mktemp("new")
    cloud = gppcs.sample("sphere", n_points=600)
    gppcs.write(folder / "cloud.ply", cloud)
    gppcs.compare(cloud, ["random"], n_points=60)  # compiles the kernels, unless their cache is there to be copied
    package = folder / "source" / "gppcs"
    shutil.copytree(Path(gppcs.__file__).parent, package)
    (package / "methods" / "every_nth.py").write_text(METHOD)
    registry = package / "methods" / "__init__.py"
    text = registry.read_text()
    assert text.count(LAST) == 1
    registry.write_text(text.replace(LAST, LINE + LAST))

    def run(*arguments):
        code = f"import sys; sys.path.insert(0, {str(package.parent)!r}); from gppcs.app.cli import main; main()"
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, cwd=folder
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    run.folder = folder
    return run


@pytest.mark.slow
def test_it_is_listed_and_explained(run_command):
    assert "every-nth: points at equal steps in the order of the file" in run_command("methods")
    text = " ".join(run_command("methods", "every-nth").split())
    assert "Chooses points at equal steps in the order of the file." in text
    assert "start (float, default 0.0) Where to start, in steps." in text
    assert "every-nth" in run_command("simplify", "--help")


def test_it_simplifies(run_command):
    run_command(
        "simplify", "cloud.ply", "-o", "few.ply", "--points", "60", "--method", "every-nth", "--set", "start=.5"
    )
    cloud, few = gppcs.read(run_command.folder / "cloud.ply"), gppcs.read(run_command.folder / "few.ply")
    assert few.points.tolist() == cloud.points[5::10].tolist()
