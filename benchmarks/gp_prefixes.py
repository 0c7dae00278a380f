"""Compare prefixes of a ranking by the method `gp` with runs that ask for the smaller number of points directly."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

import conditions
import gppcs
import report
from conditions import COVER, ESTIMATED_H_MEAN, H_MAX, H_MEAN, SURFACE, Column, Condition, Figures, Work

CONDITIONS = (
    Condition("dragon", "dragon", 0.03),
    Condition("armadillo_50k", "armadillo_50k", 0.05),
    Condition("bunny", "bunny", 0.05),
    Condition("nefertiti", "nefertiti", 0.05),
)
STARTS = range(3)  # turns of the cloud
SHARES = {"M/2": 0.5, "M/4": 0.25, "0.7 M": 0.7}  # each stage doubles the points: 0.7 M lies within a stage
SHOWN = (H_MEAN, H_MAX, ESTIMATED_H_MEAN, SURFACE, COVER)


def direct(condition: Condition, share: float, start: int) -> tuple[gppcs.PointCloud, float]:
    """Return the points that a run for a share of M keeps, and the seconds."""
    return conditions.simplified(condition, gppcs.LocalGP(), start, round(share * condition.n_points))


def prefix(condition: Condition, share: float, start: int) -> tuple[gppcs.PointCloud, float]:
    """Return the first points of a run for M points, and the seconds of that run."""
    kept, seconds = direct(condition, 1.0, start)
    return kept.take(np.arange(round(share * condition.n_points))), seconds


def compared(made: tuple[Sequence[Figures], Sequence[Figures]], column: Column) -> list[str]:
    """Return the cells of a figure: of prefixes, of direct runs, and the ratio of their geometric means."""
    first, second = ([found[column.figure] for found in runs if column.figure in found] for runs in made)
    ratio = conditions.geometric_mean(first) / conditions.geometric_mean(second)
    return [column.cell(first), column.cell(second), f"{ratio:.3f}" if np.isfinite(ratio) else ""]


def main() -> None:
    """Print the table, and write it if it is of all conditions."""
    chosen, runs = conditions.asked(CONDITIONS, __doc__)
    rows = []
    for condition in chosen:
        for label, share in SHARES.items():
            works: dict[str, dict[int, Work]] = {
                f"{kind}, {label}": {start: partial(work, condition, share, start) for start in STARTS}
                for kind, work in (("prefix", prefix), ("direct", direct))
            }
            prefixes, directs = runs.of_all(condition, works).values()
            cells = [cell for column in SHOWN for cell in compared((prefixes, directs), column)]
            rows.append((condition.name, label, f"{round(share * condition.n_points):,}", *cells))
    titles = [title for column in SHOWN for title in (f"{column.title}: prefix", "direct", "prefix / direct")]
    conditions.keep(
        "gp_prefixes",
        "Prefixes of a ranking by gp beside direct runs",
        [report.Section("", ("cloud", "size", "points", *titles), rows)],
        chosen,
        (
            "M is the share of the points that the first column gives after the name of the cloud.",
            f"Mean ± standard deviation of {len(STARTS)} runs: the first of the cloud as it is, the others of the "
            "cloud turned at random. The ratios are of geometric means.",
        ),
        whole=len(chosen) == len(CONDITIONS),
    )


if __name__ == "__main__":
    main()
