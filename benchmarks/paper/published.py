"""What the clouds are that the authors published in the history of their repository.

data.py fetches them into GPPCS_DATA/published. The first third of each should be farthest points of a random part of
the cloud, and the others the points of that part in the order of their surface variation, as `fps-variation` has them.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

import data
import gppcs
import report
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import paper_radius
from gppcs.surface.surface_variation import features_in_radius

NEIGHBOURS = 12  # in data.py of the commit of the Dragon; the .npz files hold the surface variation
ROUNDING = 1e-6  # largest difference of surface variation between jakteristics and gppcs


class Published(NamedTuple):
    """A simplified cloud, the name of its original, and the size of the random part in the authors' program."""

    file: data.File
    original: str
    random_part: int


CLOUDS = tuple(
    Published(file, *of)
    for file, of in zip(data.OF_THE_PAPER, (*3 * [("bunny", 15_000)], ("dragon", 45_000)), strict=True)
)


def points_and_variation(cloud: Published) -> tuple[NDArray[np.float64], gppcs.PointCloud, NDArray[np.float64]]:
    """Return the simplified points, (M, 3), the original cloud of N points, and its surface variation, (N,)."""
    path, original = data.path_of(cloud.file.name), gppcs.read(data.path_of(cloud.original))
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return arrays["simp_coords"], gppcs.PointCloud(arrays["org_coords"]), arrays["org_curv"]
    tree = KdTree.build(original.points)
    radius = paper_radius(original.points, NEIGHBOURS)
    return gppcs.read(path).points, original, features_in_radius(tree, radius).surface_variation


class Order(NamedTuple):
    """What the order of a simplified cloud shows."""

    farthest: int  # points of the first third
    farther: int  # of these, points that are farther from the earlier ones than the one before was
    steps: int  # from one of the other points to the next
    ascents: int  # of these, steps to a larger surface variation
    fraction: float  # that is kept, of the points whose surface variation is above the smallest of the others


def order_of(points: NDArray[np.float64], original: NDArray[np.float64], variation: NDArray[np.float64]) -> Order:
    """Measure the order of points, (M, 3), of an original, (N, 3), with its surface variation, (N,)."""
    nearest, squared = KdTree.build(original).nearest_of(points, 1)
    if not (np.sqrt(squared) <= ROUNDING * np.ptp(original, axis=0).max()).all():
        raise SystemExit("expected points of the original, found others: is it the right file?")
    third = len(points) // 3
    gaps, distances = np.empty(third), np.full(third, np.inf)
    for i in range(third):
        gaps[i] = distances[i]
        distances = np.minimum(distances, np.linalg.norm(points[:third] - points[i], axis=1))
    y = np.nan_to_num(variation)[nearest[:, 0]]
    chosen_by_y = y[third:]
    above = np.nan_to_num(variation) > chosen_by_y.min() + ROUNDING
    kept = np.count_nonzero(y > chosen_by_y.min() + ROUNDING)
    return Order(
        third,
        int(np.count_nonzero(np.diff(gaps[1:]) > 1e-9 * gaps[1])),
        len(chosen_by_y) - 1,
        int(np.count_nonzero(np.diff(chosen_by_y) > ROUNDING)),
        kept / np.count_nonzero(above),
    )


def errors(cloud: Published) -> tuple[float, float]:
    """Return H mean and H max of a cloud by `gppcs.evaluate`, in 1e-4 diagonals."""
    path = data.path_of(cloud.original)
    figures = gppcs.evaluate(path, points_and_variation(cloud)[0], gppcs.read_mesh(path))
    rebuilt = figures.rebuilt_estimated
    assert rebuilt
    return 1e4 * rebuilt.hausdorff_mean / figures.diagonal, 1e4 * rebuilt.hausdorff_max / figures.diagonal


def row(cloud: Published) -> tuple[str, ...]:
    """Return the row of a cloud."""
    points, original, variation = points_and_variation(cloud)
    order = order_of(points, original.points, variation)
    mean, largest = errors(cloud)
    return (
        Path(cloud.file.name).name,
        f"{len(points):,}",
        f"{order.farther} of {order.farthest:,}",
        f"{order.ascents} of {order.steps:,}",
        f"{order.fraction:.3f}",
        f"{cloud.random_part / len(original):.3f}",
        f"{mean:.2f}",
        f"{largest:.1f}",
    )


def main() -> None:
    """Print and write the table."""
    sections = [
        report.Section(
            "",
            (
                "commit and file",
                "points",
                "first third: points farther from the earlier ones than the one before",
                "the others: steps to a larger surface variation",
                "fraction kept of the points above their smallest surface variation",
                "random part of the authors' program",
                "H mean, 1e-4 diagonals",
                "H max",
            ),
            [row(cloud) for cloud in CLOUDS],
        )
    ]
    files = [data.path_of(cloud.file.name) for cloud in CLOUDS]
    report.write_sections("paper_published", "The clouds that the authors published", sections, files)


if __name__ == "__main__":
    main()
