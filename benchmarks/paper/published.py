"""What the clouds are that the authors published in the history of their repository.

They are expected in GPPCS_DATA/published, under the names that this prints with their addresses. If a file is missing,
the rest is measured. The first third of each should be farthest points of a random part of the cloud, and the others
the points of that part in the order of their surface variation, as `fps-variation` has them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

import gppcs
import report
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import paper_radius
from gppcs.surface.surface_variation import features_in_radius

REPOSITORY = "https://raw.githubusercontent.com/stutipathak5/gps-for-point-clouds"
NEIGHBOURS = 12  # in data.py of the commit of the Dragon; the .npz files hold the surface variation
ROUNDING = 1e-6  # largest difference of surface variation between jakteristics and gppcs


@dataclass(frozen=True)
class Published:
    """A simplified cloud: commit and path, its original, and the size of the random part in the authors' program."""

    commit: str
    path: str
    original: str
    random_part: int | None = None

    @property
    def file(self) -> Path:
        """Where the file is expected."""
        return report.DATA / "published" / f"{self.commit[:7]}_{Path(self.path).name}"

    @property
    def address(self) -> str:
        """Where the file can be had."""
        return f"{REPOSITORY}/{self.commit}/{self.path}"


CLOUDS = (
    Published("0dd34b0b90f5d6b71553ab8138c95a5009c68e7c", "resources/results/bun_zipper.ply.npz", "bunny", 15_000),
    Published("4aa6c94fee2fa0b07c1450541935b3525e0934b0", "resources/results/bun_zipper.ply.npz", "bunny", 15_000),
    Published("2739b71294ac2ca4745204cd93ca8d73e061c1b2", "resources/results/bun_zipper_0.1.npz", "bunny", 15_000),
    Published("4aa6c94fee2fa0b07c1450541935b3525e0934b0", "resources/results/dragon_vrip.ply.xyz", "dragon", 45_000),
)


def points_and_variation(cloud: Published) -> tuple[NDArray[np.float64], gppcs.PointCloud, NDArray[np.float64]]:
    """Return the simplified points, (M, 3), the original cloud of N points, and its surface variation, (N,)."""
    original = gppcs.read(report.DATA / f"{cloud.original}.ply")
    if cloud.file.suffix == ".npz":
        with np.load(cloud.file) as arrays:
            return arrays["simp_coords"], gppcs.PointCloud(arrays["org_coords"]), arrays["org_curv"]
    tree = KdTree.build(original.points)
    radius = paper_radius(original.points, NEIGHBOURS)
    return gppcs.read(cloud.file).points, original, features_in_radius(tree, radius).surface_variation


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
    path = report.DATA / f"{cloud.original}.ply"
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
        f"{cloud.path}, {cloud.commit[:7]}",
        f"{len(points):,}",
        f"{order.farther} of {order.farthest:,}",
        f"{order.ascents} of {order.steps:,}",
        f"{order.fraction:.3f}",
        f"{cloud.random_part / len(original):.3f}" if cloud.random_part else "",
        f"{mean:.2f}",
        f"{largest:.1f}",
    )


def main() -> None:
    """Print and write the table, if all clouds are there."""
    missing = [cloud for cloud in CLOUDS if not cloud.file.is_file()]
    for cloud in missing:
        print(f"missing: {cloud.file}, to be had at {cloud.address}", file=sys.stderr)
    there = [cloud for cloud in CLOUDS if cloud not in missing]
    if not there:
        print("none of the published clouds is there, so their page is not made", file=sys.stderr)
        return
    sections = [
        report.Section(
            "",
            (
                "file, commit",
                "points",
                "first third: points farther from the earlier ones than the one before",
                "the others: steps to a larger surface variation",
                "fraction kept of the points above their smallest surface variation",
                "random part of the authors' program",
                "H mean, 1e-4 diagonals",
                "H max",
            ),
            [row(cloud) for cloud in there],
        )
    ]
    title, files = "The clouds that the authors published", [cloud.file for cloud in there]
    if missing:
        print(report.text(title, sections, files))
    else:
        report.write_sections("paper_published", title, sections, files)


if __name__ == "__main__":
    main()
