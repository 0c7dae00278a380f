"""Figures of the paper that are reproduced."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gppcs
from gppcs.methods.hc.clustering import hierarchical_clusters

PAPER = Path(__file__).parents[2] / "benchmarks" / "paper"


@pytest.fixture
def benchmark(script, monkeypatch):
    monkeypatch.syspath_prepend(PAPER)  # for what these scripts share
    return lambda name: script(f"paper/{name}.py")


@pytest.mark.slow
def test_ablation_table_within_two_percent(shared_data, benchmark):
    ablation = benchmark("ablation")
    rows = ablation.table(gppcs.read(shared_data / "bunny.ply"), ablation.FPS_VARIATION)
    assert len(rows) == 12
    for _name, _value, paper, ours in rows:
        assert np.median(ours) == pytest.approx(paper, rel=0.02)


@pytest.mark.slow
def test_noise_study_within_five_percent(shared_data, benchmark):
    noise = benchmark("noise")
    clean = gppcs.read(shared_data / f"{noise.STUDY_CLOUD}.ply").points
    for level, paper in noise.PAPER.items():
        cloud = noise.noisy(clean, level, seed=0)
        kept = gppcs.simplify(cloud, ratio=noise.STUDY_RATIO, method=noise.STUDIED[0]).cloud.points
        distances, _ = cKDTree(kept).query(cloud)
        assert np.mean(distances**2) == pytest.approx(paper, rel=0.05)


@pytest.mark.slow
def test_surfaces_rebuilt_from_the_dragon_within_five_percent(shared_data, benchmark):
    """One seed each, where the benchmark takes the median of three: now and then MeshLab turns a part inside out."""
    pytest.importorskip("pymeshlab")
    table1 = benchmark("table1")
    dragon, mesh = gppcs.read(shared_data / "dragon.ply"), gppcs.read_mesh(shared_data / "dragon.ply")
    clustered = dragon.take(hierarchical_clusters(dragon.points, 1000, 0.01))
    projected = gppcs.simplify(dragon, ratio=0.03, method=gppcs.WLOP(snap=False)).cloud
    varied = gppcs.simplify(dragon, ratio=0.03, method=gppcs.FarthestPointVariation(candidates=25_000, seed=1)).cloud
    for cloud, name in ((clustered, "HC"), (projected, "WLOP"), (varied, "GP")):
        paper = table1.PAPER["Dragon"][name][0]
        assert table1.errors_by_meshlab(cloud, mesh)[0] == pytest.approx(paper, rel=0.05)


@pytest.mark.slow
def test_all_points_of_the_dragon_take_little_memory(shared_data):
    """No matrix of N x N or M x M numbers: those would be 1,500 and 1.4 GB; the whole process stays below 2 GB."""
    code = (
        "import gppcs, sys\n"
        "result = gppcs.simplify(gppcs.read(sys.argv[1]), ratio=0.03, method='gp-spectral')\n"
        "assert len(result.indices) == 13_129\n"
        "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])\n"
    )
    dragon = str(shared_data / "dragon.ply")
    done = subprocess.run([sys.executable, "-c", code, dragon], capture_output=True, text=True, check=True)
    assert int(done.stdout) * 1024 < 2e9
