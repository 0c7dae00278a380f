"""The method `gp` beside all rivals, by one judge, on scans, noisy clouds and shapes with edges.

Needs the extra `evaluate`; WLOP by CGAL is there where the extra `cgal` is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from time import perf_counter

import numpy as np

import conditions
import gppcs
import report
from conditions import COLUMNS, COVER, H_MAX, H_MEAN, VARIATION, Column, Condition, Figures

CONDITIONS = (
    Condition("dragon", "dragon", 0.03),
    Condition("armadillo_50k", "armadillo_50k", 0.05),
    Condition("nefertiti", "nefertiti", 0.05),
    Condition("bunny", "bunny", 0.05),
    Condition("bunny", "bunny", 0.2),
    Condition("face_rangemap", "face_rangemap", 0.03),
    Condition("armadillo_173k_resampled", "armadillo_50k", 0.05),
    Condition("sfm_angel", "sfm_angel", 0.1),
    Condition("sfm_bird_bath", "sfm_bird_bath", 0.1),
    Condition("armadillo_100k_noise_2.5e-3", "armadillo_50k", 0.05),
    Condition("armadillo_100k_noise_5e-3", "armadillo_50k", 0.05),
    Condition("fandisk_60k_sampled", "fandisk", 1_200),
    Condition("cube_30k_sampled", None, 600),
)
STARTS = range(5)  # turns of the cloud
SEEDS = range(3)  # of random points
GP = "gp"
RIVALS = {
    "fps": gppcs.FarthestPoint(),
    "voxel": gppcs.Voxel(),
    "sample-elimination": gppcs.SampleElimination(),
    "wlop": gppcs.WLOP(),
    "wlop, moved": gppcs.WLOP(snap=False),
    "hc": gppcs.HierarchicalClustering(),
    "pc-simp": gppcs.PCSimp(),
    "aivs": gppcs.AIVS(),
    "qem": gppcs.QEM(),
    "fps-variation": gppcs.FarthestPointVariation(),
    "gp-spectral": gppcs.SpectralGP(),
}
VARIANTS = {  # of gp: method, and whether the points carry normals
    GP: (gppcs.LocalGP(), False),
    "gp, feature_weight=0": (gppcs.LocalGP(feature_weight=0.0), False),
    "gp, feature_weight=0.75": (gppcs.LocalGP(feature_weight=0.75), False),
    "gp, normals carried": (gppcs.LocalGP(), True),
}
NOTES = (
    f"gp and its variants: mean ± standard deviation of {len(STARTS)} runs, the first of the cloud as it is, the "
    f"others of the cloud turned at random, all judged on the cloud as it is. random: of {len(SEEDS)} seeds. The "
    "others: one run, of the cloud as it is.",
    "Lengths are in diagonals of the mesh. H mean and H max are from its vertices to the screened Poisson mesh of the "
    "points kept, with normals estimated on these; in the row of normals carried, with those of the whole cloud.",
    "In the summary, the rivals are all methods but gp and its variants; ranks are by the largest mean surface "
    "variation, among the rivals and gp. The means of several runs are compared.",
    "Noisy clouds: all but H mean and H max compare the points kept with the noisy points.",
    "wlop, moved, and wlop by CGAL move the points; the others keep points of the cloud.",
    "Seconds are of each run once, kernels compiled; the table of benchmarks/main_job.py has the least of several.",
)

Made = Mapping[str, Sequence[Figures]]  # the figures of each run, by the label of the row


def our(condition: Condition, method: gppcs.Method) -> tuple[gppcs.PointCloud, float]:
    """Return what one of our methods makes of the cloud as it is, and the seconds."""
    result, seconds = conditions.timed(condition.cloud, method, condition.n_points)
    return result.cloud, seconds


def turned(condition: Condition, label: str, start: int) -> tuple[gppcs.PointCloud, float]:
    """Return what a variant of gp makes of the cloud turned, and the seconds."""
    method, normals = VARIANTS[label]
    return conditions.simplified(condition, method, start, normals=normals)


def wlop_by_cgal(condition: Condition) -> tuple[gppcs.PointCloud, float]:
    """Return what CGAL's WLOP makes of the cloud, with CGAL's own radius, and the seconds without the point sets."""
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Point_set_processing_3 import (
        compute_average_spacing,
        wlop_simplify_and_regularize_point_set,
    )

    given, moved = Point_set_3(), Point_set_3()
    for x, y, z in condition.cloud.points.tolist():
        given.insert(Point_3(x, y, z))
    percentage = 100 * (condition.n_points + 0.5) / len(condition.cloud)  # rounded down by CGAL
    start = perf_counter()
    wlop_simplify_and_regularize_point_set(given, moved, percentage, 8 * compute_average_spacing(given, 6), 35, False)
    seconds = perf_counter() - start
    return gppcs.PointCloud.of(np.array([[point.x(), point.y(), point.z()] for point in moved.points()])), seconds


def runs_of(condition: Condition, runs: conditions.Runs) -> dict[str, list[Figures]]:
    """Return the figures of all runs under a condition; rows of gp first."""
    works: dict[str, list[Callable[[], tuple[gppcs.PointCloud, float]]]] = {
        **{label: [partial(turned, condition, label, start) for start in STARTS] for label in VARIANTS},
        "random": [partial(our, condition, gppcs.Random(seed=seed)) for seed in SEEDS],
        **{label: [partial(our, condition, method)] for label, method in RIVALS.items()},
    }
    if find_spec("CGAL"):
        works["wlop by CGAL"] = [partial(wlop_by_cgal, condition)]
    return {
        label: [runs.of(condition, label, start, work) for start, work in enumerate(of_label)]
        for label, of_label in works.items()
    }


def mean(made: Made, label: str, column: Column) -> float:
    """Return the mean of a figure over the runs of a row that have it; NaN for none."""
    values = [found[column.figure] for found in made[label] if column.figure in found]
    return float(np.mean(values)) if values else float("nan")


def beside_the_best(made: Made, column: Column) -> tuple[str, str]:
    """Return the figure of gp as a multiple of the best rival's, and which that is."""
    of_rivals = {label: mean(made, label, column) for label in made if label not in VARIANTS}
    known = {label: value for label, value in of_rivals.items() if np.isfinite(value)}
    ours = mean(made, GP, column)
    if not known or not np.isfinite(ours):
        return "", ""
    best = min(known, key=known.__getitem__)
    return f"{ours / known[best]:.3f}", best


def summary(made: Made) -> tuple[str, ...]:
    """Return the row of a condition, without its name."""
    variations = [mean(made, label, VARIATION) for label in made if label == GP or label not in VARIANTS]
    known, ours = [value for value in variations if np.isfinite(value)], mean(made, GP, VARIATION)
    rank = f"{1 + sum(value > ours for value in known)} of {len(known)}" if np.isfinite(ours) else ""
    ratio = mean(made, GP, COVER) / mean(made, "fps", COVER)
    cover = f"{ratio:.2f}" if np.isfinite(ratio) else ""
    return *beside_the_best(made, H_MEAN), *beside_the_best(made, H_MAX), rank, cover


def section(condition: Condition, made: Made) -> report.Section:
    """Return the table of a condition."""
    rows = [
        [label, *(column.cell([found[column.figure] for found in of_label if column.figure in found])
                  for column in COLUMNS)]
        for label, of_label in made.items()
    ]  # fmt: skip
    heading = f"{condition.name}, {len(condition.cloud):,} points to {condition.n_points:,}"
    return report.Section(heading, ["method", *(column.title for column in COLUMNS)], rows)


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    chosen, runs = conditions.asked(CONDITIONS, __doc__)
    sections, rows = [], []
    for condition in chosen:
        made = runs_of(condition, runs)
        rows.append((condition.name, *summary(made)))
        sections.append(section(condition, made))
    header = (
        "cloud", "H mean, times the best rival's", "best rival", "H max, times the best rival's", "best rival",
        "rank in mean surface variation", "covering radius, times that of fps",
    )  # fmt: skip
    conditions.keep(
        "quality",
        "The method gp beside all rivals",
        [report.Section("Summary", header, rows), *sections],
        chosen,
        NOTES,
        whole=len(chosen) == len(CONDITIONS),
    )


if __name__ == "__main__":
    main()
