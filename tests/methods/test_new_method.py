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

from gppcs.methods.method import Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class EveryNth(Method):
    """Points at equal steps."""

    name = "every-nth"
    summary = "points at equal steps in the order of the file"
    description = "Chooses points at equal steps in the order of the file."
    source = "an example"

    start: float = parameter(0.0, "Where to start, in steps.")

    def __call__(self, task: Task) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        steps = np.arange(task.n_points) + self.start
        return Selection((steps * len(task.points) / task.n_points).astype(np.int64))
'''
LINE = "from gppcs.methods.every_nth import EveryNth as EveryNth\n"
LAST = "# isort: on\n"  # the line after the list of methods


@pytest.mark.slow
def test_a_new_method_is_listed_and_simplifies(tmp_path):
    """In a copy of the package with one more file and line."""
    gppcs.write(tmp_path / "cloud.ply", cloud := gppcs.sample("sphere", n_points=600))
    gppcs.compare(cloud, ["random"], n_points=60)  # compiles the kernels, unless their cache is there to be copied
    package = tmp_path / "source" / "gppcs"
    shutil.copytree(Path(gppcs.__file__).parent, package)
    (package / "methods" / "every_nth.py").write_text(METHOD)
    registry = package / "methods" / "__init__.py"
    text = registry.read_text()
    assert text.count(LAST) == 1
    registry.write_text(text.replace(LAST, LINE + LAST))

    def run(*arguments):
        code = f"import sys; sys.path.insert(0, {str(package.parent)!r}); from gppcs.app.cli import main; main()"
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        return " ".join(done.stdout.split())

    assert "every-nth: points at equal steps in the order of the file" in run("methods")
    assert "start (float, default 0.0) Where to start, in steps." in run("methods", "every-nth")
    assert "every-nth" in run("simplify", "--help")
    run("simplify", "cloud.ply", "-o", "few.ply", "--points", "60", "--method", "every-nth", "--set", "start=.5")
    assert gppcs.read(tmp_path / "few.ply").points.tolist() == cloud.points[5::10].tolist()
