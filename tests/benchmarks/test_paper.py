"""Figures of the paper that are reproduced."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gppcs
from gppcs.methods.hc.clustering import hierarchical_clusters

BENCHMARKS = Path(__file__).parents[2] / "benchmarks" / "paper"


def benchmark(name):
    specification = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # dataclasses look their module up
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_ablation_table_within_two_percent(shared_data):
    ablation = benchmark("ablation")
    rows = ablation.table(gppcs.read(shared_data / "bunny.ply"), ablation.FPS_VARIATION)
    assert len(rows) == 12
    for _name, _value, paper, ours in rows:
        assert np.median(ours) == pytest.approx(paper, rel=0.02)


@pytest.mark.slow
def test_noise_study_within_five_percent(shared_data):
    noise = benchmark("noise")
    clean = gppcs.read(shared_data / f"{noise.STUDY_CLOUD}.ply").points
    for level, paper in noise.PAPER.items():
        cloud = noise.noisy(clean, level, seed=0)
        kept = gppcs.simplify(cloud, ratio=noise.STUDY_RATIO, method=noise.STUDIED[0]).cloud.points
        distances, _ = cKDTree(kept).query(cloud)
        assert np.mean(distances**2) == pytest.approx(paper, rel=0.05)


@pytest.mark.slow
def test_surfaces_rebuilt_from_the_dragon_within_five_percent(shared_data):
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


@pytest.mark.oracle
def test_registration_finds_the_motion_between_two_views(shared_data):
    pytest.importorskip("open3d")
    registration = benchmark("registration")
    scene = registration.view_scene("room", gppcs.read(shared_data / "3dmatch_room_fragment.ply").points, 0.1, 0)
    for method in ("hc", registration.GRID):
        run = registration.register(scene, method, seed=0)
        assert run.rotation < 1.0
        assert run.shift < scene.spacing
        assert 0.0 < run.icp_rmse < run.global_rmse < 1.5 * scene.spacing
        assert run.points == (round(0.1 * len(scene.source)) if method == "hc" else len(scene.source))


@pytest.mark.oracle
def test_registration_of_a_copy_is_exact():
    pytest.importorskip("open3d")
    registration = benchmark("registration")
    scene = registration.copy_scene("bracket", gppcs.sample("bracket", n_points=4000).points, 0.2, 0)
    run = registration.register(scene, "hc", seed=0)
    assert run.icp_rmse < 1e-6 * scene.spacing
    assert run.rotation < 1e-4


def test_without_open3d_registration_says_in_one_line_what_to_install():
    path = str(BENCHMARKS / "registration.py")
    code = "import runpy, sys; sys.modules['open3d'] = None; runpy.run_path(sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "pip install 'gppcs[registration]'" in line
    assert "libusb-1.0-0" in line
