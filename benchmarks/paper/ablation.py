"""The paper's ablation of k_init and k (supplement, Table 2) on the bunny, by the method fps-variation.

All twelve values come out within 2 % (median of five seeds), with 20,000 random candidates and the surface variation of
the whole cloud: farthest points, then the points of largest surface variation, are enough to explain that table.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import gppcs
import report

N_POINTS = 7_189  # a fifth of the bunny
CANDIDATES = 20_000
SEEDS = range(5)
DEFAULT_K_INIT, DEFAULT_K = 2_000, 20
PAPER = {  # Chamfer distances in 1e-6 square metres
    "k_init": {500: 7.4345, 1000: 5.0463, 1500: 3.8995, 2000: 3.2469, 3000: 2.4893, 5000: 1.8498},
    "k": {5: 2.7721, 10: 3.0523, 15: 3.1314, 20: 3.2396, 30: 3.3033, 50: 3.4406},
}


def chamfer(cloud: gppcs.PointCloud, k_init: int, k: int, seed: int) -> float:
    """Return the Chamfer distance of the simplified bunny to the bunny, in 1e-6 square metres."""
    method = gppcs.FarthestPointVariation(k_init=k_init, neighbours=k, candidates=CANDIDATES, seed=seed)
    result = gppcs.simplify(cloud, n_points=N_POINTS, method=method)
    return 1e6 * gppcs.evaluate(cloud, result.cloud).chamfer


def table(cloud: gppcs.PointCloud) -> list[tuple[str, int, float, list[float]]]:
    """Return parameter, value, the paper's figure and ours for each seed."""
    settings = [("k_init", value, value, DEFAULT_K) for value in PAPER["k_init"]]
    settings += [("k", value, DEFAULT_K_INIT, value) for value in PAPER["k"]]
    return [
        (name, value, PAPER[name][value], [chamfer(cloud, k_init, k, seed) for seed in SEEDS])
        for name, value, k_init, k in settings
    ]


def main() -> None:
    """Print and write the table."""
    path = report.DATA / "bunny.ply"
    rows = [
        (name, f"{value}", f"{paper:.3f}", f"{np.median(ours):.3f}", f"{np.median(ours) / paper:.3f}",
         f"{min(ours):.3f} to {max(ours):.3f}")
        for name, value, paper, ours in table(gppcs.read(path))
    ]  # fmt: skip
    report.write(
        "ablation",
        "Ablation on the bunny, Chamfer distance in 1e-6 square metres (paper: supplement, Table 2)",
        ("parameter", "value", "paper", "here, median of 5 seeds", "here / paper", "range of seeds"),
        rows,
        [path],
    )


if __name__ == "__main__":
    main()
