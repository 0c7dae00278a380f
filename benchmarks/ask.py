"""Show what comes of asking `gppcs simplify` for an accuracy, a spacing, points to keep, weights, and no outliers."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import conditions
import gppcs
import report
from conditions import Condition
from scans import sample

RATIO = 0.03
CLOUDS = ("dragon", "armadillo_50k", "nefertiti", "kitti_000000", "tum_desk")
TOLERANCES = ("0.02%", "0.05%", "0.1%")
MEASURES = ("mean", "p95")
KEPT = (Condition("dragon", "dragon", 0.03), Condition("armadillo_50k", "armadillo_50k", 0.05),
        Condition("bunny", "bunny", 0.05), Condition("nefertiti", "nefertiti", 0.05))  # fmt: skip


def once(work: Callable[[], gppcs.Result]) -> tuple[gppcs.Result, float]:
    """Return a result and the least seconds of two runs."""
    results: list[gppcs.Result] = []
    seconds = report.least_time(lambda: results.append(work()), repeats=2)
    return results[-1], seconds


def of_tolerance(name: str, tolerance: str, measure: str) -> tuple[str, ...]:
    """Return the row of a tolerance: what was reached, also by the written file, and what 5 % fewer points reach."""
    path = report.DATA / f"{name}.ply"
    cloud = gppcs.read(path)
    result, seconds = once(lambda: gppcs.simplify(cloud, tolerance=f"{tolerance}:{measure}"))
    count = len(result.indices)
    _, plain = once(lambda: gppcs.simplify(cloud, n_points=count))
    fewer = result.prefix(math.floor(0.95 * count)).cloud if count < len(cloud) else cloud
    with tempfile.TemporaryDirectory() as folder:
        gppcs.write(Path(folder) / "small.ply", result.cloud)
        reached, missed = (
            gppcs.evaluate(path, kept).figures(relative=True)[f"surface_{measure}"]
            for kept in (Path(folder) / "small.ply", fewer)
        )
    return (
        name, f"{tolerance} {measure}", f"{count:,}", f"{100 * reached:.4f} %", f"{100 * missed:.4f} %",
        f"{seconds:.2f}", f"{plain:.2f}", f"{seconds / plain:.1f}",
    )  # fmt: skip


def of_points_to_keep(condition: Condition) -> tuple[str, ...]:
    """Return the row of a tenth of the points that is kept at random: H mean with and without."""
    count = condition.n_points
    keep = np.random.default_rng(0).permutation(len(condition.cloud))[: count // 10]
    with_them = gppcs.simplify(condition.cloud, n_points=count, keep=keep).cloud
    without = gppcs.simplify(condition.cloud, n_points=count).cloud
    errors = [1e4 * conditions.figures(condition, kept)["hausdorff_mean"] for kept in (without, with_them)]
    return condition.name, f"{count:,}", *(f"{error:.2f}" for error in errors), f"{errors[1] / errors[0] - 1:+.1%}"


def of_weight(count: int, weight: float) -> tuple[str, ...]:
    """Return the row of a weight on half of a sphere: how many times the points of the other half are there."""
    ball = gppcs.sample("sphere", n_points=200_000)
    upper = ball.points[:, 2] > ball.points[:, 2].mean()
    kept = upper[gppcs.simplify(ball, n_points=count, weight=np.where(upper, weight, 1.0)).indices]
    return f"{count:,}", f"{weight:g}", f"{kept.sum() / (~kept).sum():.2f}"


def of_spacing(name: str, share: float) -> tuple[str, ...]:
    """Return the row of a spacing: points, and the largest distance to a kept point, for four methods."""
    cloud = gppcs.read(report.DATA / f"{name}.ply")
    cells = []
    for method in ("gp", "fps", "sample-elimination", "voxel"):
        kept = gppcs.simplify(cloud, spacing=f"{100 * share}%", method=method).cloud
        radius = gppcs.evaluate(cloud, kept).figures(relative=True)["covering_radius"]
        cells.append(f"{len(kept):,} ({radius / share:.2f})")
    filled = gppcs.simplify(cloud, max_gap=f"{100 * share}%")
    return name, f"{share:.0%}", *cells, f"{len(filled.indices):,} ({filled.diagnostics['added_in_gaps']:,.0f} added)"


def of_outliers(name: str) -> tuple[str, ...]:
    """Return the row of a scan with 1 % stray points: how many are found, and how many others."""
    cloud = sample(name, n_points=100_000, outliers=0.01)
    stray, found = cloud.attributes["outlier"] == 1, gppcs.find_outliers(cloud)
    clean = gppcs.find_outliers(sample(name, n_points=100_000))
    return name, f"{stray.sum():,}", f"{(found & stray).sum():,}", f"{(found & ~stray).sum():,}", f"{clean.sum():,}"


def main() -> None:
    """Print and write the tables."""
    asked = [of_tolerance("dragon", tolerance, "p95") for tolerance in TOLERANCES]
    asked += [of_tolerance(name, "0.1%", measure) for name in CLOUDS[1:] for measure in MEASURES]
    sections = [
        report.Section(
            "By accuracy, method gp",
            ("cloud", "tolerance", "points", "reached by the file", "5 % fewer", "seconds", "n_points alone", "ratio"),
            asked,
        ),
        report.Section(
            "A tenth of M kept at random, method gp",
            ("cloud", "M", "H mean without, 1e-4 diagonals", "with", "change"),
            [of_points_to_keep(condition) for condition in KEPT],
        ),
        report.Section(
            "A weight on half of a sphere, method gp",
            ("M", "weight", "points there, in those of the other half"),
            [of_weight(count, weight) for count in (1000, 4000, 16_000) for weight in (4.0, 0.25)],
        ),
        report.Section(
            "By spacing: points (covering radius in spacings)",
            ("cloud", "of the diagonal", "gp", "fps", "sample-elimination", "voxel", "gp with this max_gap"),
            [of_spacing(name, 0.02) for name in ("bunny", "nefertiti", "kitti_000000")],
        ),
        report.Section(
            "Outliers, 100,000 points of which 1 % are stray",
            ("scan", "stray", "found", "others found", "found without stray points"),
            [of_outliers(name) for name in ("bracket", "fan", "statue", "medallion")],
        ),
    ]  # fmt: skip
    report.write_sections(
        "ask",
        "Ask for what you mean",
        sections,
        [report.DATA / f"{name}.ply" for name in CLOUDS],
        [
            "Errors and spacings as shares of the diagonal; errors by gppcs.evaluate, of the file that was written.",
            "Seconds are the least of 2 runs; n_points alone: those of a plain run for the resulting number.",
        ],
    )


if __name__ == "__main__":
    main()
