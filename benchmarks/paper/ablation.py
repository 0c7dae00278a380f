"""The paper's ablations of k_init, k, i and k_opt (supplement, Table 2) on the bunny, by fps-variation and gp-spectral.

fps-variation chooses among 20,000 random candidates: first farthest points, then the points of largest surface
variation, measured in the whole cloud. This explains the columns of k_init and k: all twelve medians of five seeds are
within 2 % of the paper's values. fps-variation has no hyperparameters, so it has no columns of i (iterations of the
fit) and k_opt (points of the fit). In these columns the paper's values hardly vary. Those of gp-spectral hardly vary
either, since its fit ends before 50 iterations.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import data
import gppcs
import report

N_POINTS = 7_189  # a fifth of the bunny
SEEDS = range(5)
PAPER = {  # Chamfer distances in 1e-6 square metres
    "k_init": {500: 7.4345, 1000: 5.0463, 1500: 3.8995, 2000: 3.2469, 3000: 2.4893, 5000: 1.8498},
    "k": {5: 2.7721, 10: 3.0523, 15: 3.1314, 20: 3.2396, 30: 3.3033, 50: 3.4406},
    "i": {50: 3.1976, 100: 3.2049, 150: 3.2471, 200: 3.2153, 300: 3.2253, 500: 3.1996},
    "k_opt": {50: 3.2453, 100: 3.2237, 150: 3.2156, 200: 3.2529, 300: 3.2139, 500: 3.2236},
}
FIELDS = {"k_init": "k_init", "k": "neighbours", "i": "iterations", "k_opt": "k_opt"}  # of the methods
FPS_VARIATION = gppcs.FarthestPointVariation(k_init=2_000, neighbours=20, candidates=20_000)
SPECTRAL_GP = gppcs.SpectralGP(k_init=2_000, neighbours=20, candidates=20_000)


def chamfer(cloud: gppcs.PointCloud, method: gppcs.Method) -> float:
    """Return the Chamfer distance of the simplified bunny to the bunny, in 1e-6 square metres."""
    result = gppcs.simplify(cloud, n_points=N_POINTS, method=method)
    return 1e6 * gppcs.evaluate(cloud, result.cloud).chamfer


def table(cloud: gppcs.PointCloud, method: gppcs.Method) -> list[tuple[str, int, float, list[float]]]:
    """Return rows of parameter, value, the paper's figure and ours for each seed, for parameters of the method."""
    return [
        (name, value, paper, [chamfer(cloud, replace(method, **{FIELDS[name]: value, "seed": seed})) for seed in SEEDS])
        for name, column in PAPER.items()
        if hasattr(method, FIELDS[name])
        for value, paper in column.items()
    ]


def cells(paper: float, ours: list[float]) -> tuple[str, ...]:
    """Return the cells of a row: median, median divided by the paper's figure, and range."""
    return f"{np.median(ours):.3f}", f"{np.median(ours) / paper:.3f}", f"{min(ours):.3f} to {max(ours):.3f}"


def main() -> None:
    """Print and write the table."""
    path = data.path_of("bunny")
    cloud = gppcs.read(path)
    variation = {row[:2]: cells(*row[2:]) for row in table(cloud, FPS_VARIATION)}
    rows = [
        (name, f"{value}", f"{paper:.3f}", *variation.get((name, value), ("", "", "")), *cells(paper, ours))
        for name, value, paper, ours in table(cloud, SPECTRAL_GP)
    ]
    ours = [
        f"{method.name}, {what}"
        for method in (FPS_VARIATION, SPECTRAL_GP)
        for what in (f"median of {len(SEEDS)} seeds", "here / paper", "range of seeds")
    ]
    report.write(
        "ablation",
        "Ablations on the bunny, Chamfer distance in 1e-6 square metres (paper: supplement, Table 2)",
        ("parameter", "value", "paper", *ours),
        rows,
        [path],
    )


if __name__ == "__main__":
    main()
