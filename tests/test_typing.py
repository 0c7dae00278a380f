"""Type checkers see every public name."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

import gppcs

PACKAGE = Path(gppcs.__file__).parent

USER = """
import pathlib
import gppcs
from gppcs.methods.parameters import Parameter, parameters_of
from gppcs import no_such_name  # type: ignore[attr-defined]

timer = gppcs.Timer(lambda stage, done, total: print(stage, done, total))
cloud: gppcs.PointCloud = gppcs.sample("bracket", n_points=2000)
result: gppcs.Result = gppcs.simplify(cloud, ratio=0.1, method=gppcs.LocalGP(neighbours=5), timer=timer)
parameter: Parameter = parameters_of(result.method)["neighbours"]
part: gppcs.PointCloud = cloud[::2]
gppcs.evaluate(pathlib.Path("scan.ply"), "kept.ply")
gppcs.simplify(cloud, ratio="10%")
gppcs.simplify(cloud, ratio=[0.1])  # type: ignore[arg-type]
gppcs.simplify(object(), ratio=0.1)  # type: ignore[arg-type]
gppcs.simplify(["a.las", "b.las"], ratio=0.1)
gppcs.simplify([pathlib.Path("a.las")], ratio=0.1)
for taken in (gppcs.open("scan.ply", only="z > 2"), result, cloud, cloud.points, [[0.0, 0.0, 0.0]]):
    gppcs.info(taken)
"""


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed")
def test_a_users_file_passes_mypy_strict(tmp_path, pytestconfig):
    (tmp_path / "user.py").write_text(USER + "\n".join(f"gppcs.{name}" for name in gppcs.__all__))
    cache = pytestconfig.cache.mkdir("mypy_of_users_file")
    run = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", cache, "user.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(PACKAGE.parent)},  # as if this copy of the package were installed
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
