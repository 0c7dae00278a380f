"""The learned methods on larger clouds than those of their training, of shapes that training did not see.

Run as `python benchmarks/learned/sizes.py`.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1]))

import edges
import gppcs
import report
import training_set
from gppcs_learned import APES, Potamias
from gppcs_learned.weights import NEIGHBOURS

SIZES = (1024, 2048, 10_000, 100_000)  # points of a cloud; training has the first
CHAMFER, SHARE = 0.05, 0.25  # ratios of the two measures
Array = NDArray[np.float64]
NOTES = (
    "Medians over one shape of each of the twelve kinds, which training did not see. Training takes 1,024 at once.",
    f"Chamfer: at ratio {CHAMFER:g}, with the kept points in place of the originals, as the loss of potamias "
    "weighs it: by how fast the normals change.",
    f"Near an edge: at ratio {SHARE:g}, as in learned_edges.md, over the kinds that have sharp edges.",
)


def chamfer(points: Array, saliency: Array, kept: Array) -> float:
    """Return the weighted Chamfer distance between points, (N, 3), and kept ones, (M, 3); saliency is of shape (N,)."""
    to_kept, to_points = cKDTree(kept).query(points)[0], cKDTree(points).query(kept)[0]
    return float(((0.5 + saliency / saliency.mean()) * to_kept**2).mean() + (to_points**2).mean())


@cache
def sharp_places(kind: int) -> Array:
    """Return dense points beside the sharp edges of a shape, (n, 3), for clouds of all sizes."""
    return edges.edges_of_shape(kind, edges.UNSEEN, upright=True)[1]


def figures_of(kind: int, size: int) -> tuple[float, float, float]:
    """Return the Chamfer distance of potamias over those of fps and random, and the gain of apes near edges."""
    points, normals = training_set.draw(kind, edges.UNSEEN, size, upright=True)
    cloud, tree = gppcs.PointCloud.from_object(points), cKDTree(points)
    near = tree.query(points, NEIGHBOURS + 1)[1][:, 1:]
    saliency = np.linalg.norm(normals[near] - normals[:, np.newaxis], axis=2).mean(axis=1)
    potamias, fps, random = (
        chamfer(points, saliency, gppcs.simplify(cloud, ratio=CHAMFER, method=method).cloud.points)
        for method in (Potamias(), "fps", "random")
    )
    sharp = sharp_places(kind)
    if len(sharp) < size / 100:
        return potamias / fps, potamias / random, np.nan
    at_edge = cKDTree(sharp).query(points)[0] <= edges.REACH * gppcs.info(cloud).spacing
    kept = gppcs.simplify(cloud, ratio=SHARE, method=APES()).indices
    return potamias / fps, potamias / random, float(at_edge[kept].mean() / at_edge.mean())


def main() -> None:
    """Print and write the table."""
    rows = []
    for size in SIZES:
        medians = np.nanmedian([figures_of(kind, size) for kind in range(len(training_set.KINDS))], axis=0)
        rows.append([f"{size:,}", *(f"{value:.2f}" for value in medians)])
    header = ["points", "Chamfer of potamias / fps", "Chamfer of potamias / random", "apes, share near edges / all"]
    title = "The learned methods on larger clouds than those of their training"
    report.write_sections("learned_sizes", title, [report.Section("", header, rows)], [], NOTES)


if __name__ == "__main__":
    main()
