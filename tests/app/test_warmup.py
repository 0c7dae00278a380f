"""`gppcs warmup`."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gppcs
from gppcs.engine import timer
from scans import sample


@pytest.mark.slow
def test_nothing_is_left_to_compile_after_warmup(tmp_path):
    """For what people run most, on scans that warmup does not use, by a copy of the package that has no kernels yet."""
    package = Path(gppcs.__file__).parent
    shutil.copytree(package, tmp_path / "source" / "gppcs", ignore=shutil.ignore_patterns("__pycache__"))
    variables = {**os.environ, "PYTHONPATH": str(tmp_path / "source")}

    def run(words):
        command = [sys.executable, "-m", "gppcs", *shlex.split(words)]
        return subprocess.run(command, cwd=tmp_path, env=variables, check=True, capture_output=True, text=True)

    (tmp_path / "source" / "pymeshlab.py").write_text("raise ModuleNotFoundError('not there')\n")
    assert "kernels compiled: 0," not in run("warmup").stdout  # without optional packages, too
    (tmp_path / "source" / "pymeshlab.py").unlink()
    gppcs.write(tmp_path / "room.ply", sample("room", 50_000))
    gppcs.write(tmp_path / "scan.ply", sample("statue", 40_000, noise=0.001, outliers=0.01, seed=3))
    gppcs.write(tmp_path / "fan.ply", gppcs.sample("fan", 15_000, noise=0.003))
    np.save(tmp_path / "plain.npy", np.random.default_rng(0).random((5_000, 3)))
    for words in ("render scan.ply -o scan.png", "render scan.ply fan.ply -o both.png"):
        assert timer.NOTICE not in run(words).stderr, words
    for words in (
        "mesh room.ply -o a.ply --points 4k",
        "mesh room.ply -o i.ply --points 2k --effort 2",
        "mesh fan.ply -o j.ply --points 1k --moved",
        "mesh scan.ply -o b.ply --faces 2k --fill-holes 5%",
        "mesh scan.ply -o h.ply --tolerance 1%",
        "evaluate scan.ply --simplified-mesh h.ply",
        "simplify scan.ply -o c.ply --points 500 --drop-outliers --max-gap 5% --normals --scores",
        "simplify scan.ply -o d.ply --tolerance 1% --keep 'curvature > 1'",
        "simplify scan.ply -o g.ply --points 500 --denoise",
        "simplify scan.ply -o k.ply --points 500 --detail rgb",
        "simplify plain.npy -o e.ply --ratio 5% --invalid drop",
        "simplify room.ply -o f.ply --points 900 --method qem",
    ):
        found = run(f"{words} --json")
        assert timer.NOTICE not in found.stderr, words
        if not words.startswith("evaluate"):  # which tells no times
            assert json.loads(found.stdout)["seconds_compiling"] == 0, words
