"""The method `gp` beside all rivals, judged alike, on scans, noisy clouds, shapes with edges and scenes of LiDAR.

Needs the extra `evaluate`, and `pip install benchmarks/learned`. WLOP by CGAL needs the extra `cgal`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from importlib.util import find_spec

import numpy as np

import conditions
import gppcs
import gppcs_learned
import report
from conditions import (
    COLUMNS,
    COVER,
    ESTIMATED_H_MEAN,
    EXACT,
    FEATURES,
    FOUND_ON,
    H_MAX,
    H_MEAN,
    HELD_OUT,
    LIDAR,
    SURFACE,
    SURFACE_P95,
    VARIATION,
    Column,
    Condition,
    Figures,
    Work,
)

STARTS = range(3)  # turns of the cloud
GP = "gp"
RIVALS = {
    "random": gppcs.Random(),
    "fps": gppcs.FarthestPoint(),
    "voxel": gppcs.Voxel(),
    "sample-elimination": gppcs.SampleElimination(),
    "wlop": gppcs.WLOP(),
    "wlop, moved": gppcs.WLOP(snap=False),
    "hc": gppcs.HierarchicalClustering(),
    "pc-simp": gppcs.PCSimp(),
    "aivs": gppcs.AIVS(),
    "qem": gppcs.QEM(),
    "apes": gppcs_learned.APES(),
    "potamias": gppcs_learned.Potamias(),
    "potamias, moved": gppcs_learned.Potamias(snap=False),
    "fps-variation": gppcs.FarthestPointVariation(),
    "gp-spectral": gppcs.SpectralGP(),
}
VARIANTS = {  # of gp: method, and whether the points carry normals
    GP: (gppcs.LocalGP(), False),
    "gp, feature_weight=0": (gppcs.LocalGP(feature_weight=0.0), False),
    "gp, feature_weight=0.75": (gppcs.LocalGP(feature_weight=0.75), False),
    "gp, normals carried": (gppcs.LocalGP(), True),
}
INTRODUCTION = (
    f"The {len(FOUND_ON)} clouds of the first table took part in finding the rules and constants of gp. They are no "
    f"independent test. The {len(HELD_OUT)} clouds of the second table, three scenes of LiDAR among them, "
    "took no part in that; since then, the scans among them have helped to tell noise from detail. "
    "The six samples horse, moth, case, plate, gears and plant were made later. Six clouds with thin parts (turbine, "
    "desk, fan, moth, case and plate) helped to decide how much normals count there; the others decided nothing. Each "
    "figure of gp is divided by that of the best rival on the same cloud, so below 1 gp is ahead. Where gp is behind, "
    "the cell is bold and says so."
)
NOTES = (
    f"Mean ± standard deviation of {len(STARTS)} runs. The first is of the cloud as it is, the others of the cloud "
    "turned at random, with other random numbers; all are judged on the cloud as it is.",
    "Rivals are all methods but gp and its variants. The best rival may differ between clouds and between "
    "figures. Ranks are by mean surface variation, largest first, among gp and the rivals.",
    "H mean and H max: mean and largest distance from the original surface to the screened Poisson mesh of the kept "
    "points, with the exact normals of the original surface there: of the mesh or of the sample scan, or those of a "
    "whole scan without a mesh. A point that was moved has the normal of the nearest original point. With estimated "
    "normals, these come from the kept points alone, and in the row of normals carried from the whole cloud.",
    "The depth of the octree is 8. It is 10 where H mean of all points is more than half of the smallest H mean at "
    "depth 8.",
    "The original surface is given by the vertices of a mesh; of a scan without a mesh, by at most "
    f"{conditions.REFERENCE:,} of its points, chosen at random; of a sample scan, such as bracket, "
    f"by {conditions.SURFACE_SAMPLE:,} other points of its surface, without noise. A scene of LiDAR spans no closed "
    "surface, so none is rebuilt.",
    "Lengths are in diagonals of the bounding box of these points, or of the cloud where there are none.",
    "The true surface of a cloud to which noise was added is given by points without it; of another cloud, by its own "
    "points. All other figures compare the kept points with the original points, also where these are noisy: they are "
    "lower where kept points follow the noise.",
    "wlop, moved, wlop by CGAL, and potamias, moved, move the points. The other methods keep points of the cloud.",
    "Seconds are of each run once, with compiled kernels and one thread, while other runs may be under way. For times, "
    "see speed.md.",
)

Made = Mapping[str, Sequence[Figures]]  # the figures of each run, by the label of the row


def turned(condition: Condition, label: str, start: int) -> tuple[gppcs.PointCloud, float]:
    """Simplify the turned cloud by a rival or a variant of gp; return the points kept and the seconds."""
    method, normals = VARIANTS[label] if label in VARIANTS else (RIVALS[label], False)
    return conditions.simplified(condition, method, start, normals=normals)


def wlop_by_cgal(condition: Condition, start: int) -> tuple[gppcs.PointCloud, float]:
    """Simplify by CGAL's WLOP with its own radius; the seconds are without the making of its point sets."""
    import by_cgal

    turn = conditions.turn_of(start)
    ratio = (condition.n_points + 0.5) / len(condition.cloud)  # the half point: CGAL rounds down
    moved, seconds = by_cgal.wlop(condition.cloud.points @ turn.T, ratio)
    return gppcs.PointCloud.from_object(moved @ turn), seconds


def runs_of(
    condition: Condition, runs: conditions.Runs, variants: Sequence[str] = tuple(VARIANTS)
) -> dict[str, list[Figures]]:
    """Return the figures of all runs under a condition, rows of gp first."""
    works: dict[str, dict[int, Work]] = {
        label: {start: partial(turned, condition, label, start) for start in STARTS} for label in (*variants, *RIVALS)
    }
    if find_spec("CGAL"):
        works["wlop by CGAL"] = {start: partial(wlop_by_cgal, condition, start) for start in STARTS}
    return runs.of_all(condition, works)


def mean(made: Made, label: str, column: Column) -> float:
    """Return the mean of a figure over the runs of a row that have it; NaN for none."""
    values = [found[column.figure] for found in made[label] if column.figure in found]
    return float(np.mean(values)) if values else float("nan")


def best_rival(made: Made, column: Column) -> str:
    """Return the rival with the least figure; empty if no rival has it."""
    known = {label: mean(made, label, column) for label in made if label not in VARIANTS}
    known = {label: value for label, value in known.items() if np.isfinite(value)}
    return min(known, key=known.__getitem__) if known else ""


def ratio(made: Made, column: Column, rival: str) -> float:
    """Return the figure of gp divided by that of a rival; NaN if either has none."""
    return mean(made, GP, column) / mean(made, rival, column) if rival in made else float("nan")


def shown(ratio: float) -> str:
    """Return a ratio as a cell; in bold where gp is behind, and empty where there is none."""
    if not np.isfinite(ratio):
        return ""
    return f"**{ratio:.3f}, behind**" if round(ratio, 3) > 1 else f"{ratio:.3f}"


BESIDE = (H_MEAN, H_MAX, ESTIMATED_H_MEAN, SURFACE, EXACT)  # figures of the summaries


def summary(heading: str, all_made: Mapping[Condition, Made]) -> report.Section:
    """Return the table that puts gp beside the best rival on each cloud, and the geometric means."""
    header = ["cloud"]
    for column in BESIDE:
        header += [f"{column.title.split(',')[0]}, times the best rival's", "best rival"]
    rows = []
    for condition, made in all_made.items():
        rivals = [best_rival(made, column) for column in BESIDE]
        cells = [
            cell
            for column, rival in zip(BESIDE, rivals, strict=True)
            for cell in (shown(ratio(made, column, rival)), rival)
        ]
        rows.append([condition.name, *cells, rank(made), shown(ratio(made, COVER, "fps"))])
    means = [
        [ratio(made, column, best_rival(made, column)) for made in all_made.values()] for column in BESIDE
    ]  # fmt: skip
    cells = [cell for values in means for cell in (shown(conditions.geometric_mean(values)), ahead(values))]
    covers = [ratio(made, COVER, "fps") for made in all_made.values()]
    rows.append(["**geometric mean**", *cells, "", shown(conditions.geometric_mean(covers))])
    return report.Section(
        heading, [*header, "rank in mean surface variation", "covering radius, times that of fps"], rows
    )


def ahead(ratios: Sequence[float]) -> str:
    """Return on how many clouds gp is ahead."""
    known = [value for value in ratios if np.isfinite(value)]
    return f"ahead on {sum(value < 1 for value in known)} of {len(known)}" if known else ""


def rank(made: Made) -> str:
    """Return the rank of gp in mean surface variation, largest first."""
    values = [mean(made, label, VARIATION) for label in made if label == GP or label not in VARIANTS]
    known, own = [value for value in values if np.isfinite(value)], mean(made, GP, VARIATION)
    return f"{1 + sum(value > own for value in known)} of {len(known)}" if np.isfinite(own) else ""


def rival_by_rival(groups: Mapping[str, Mapping[Condition, Made]]) -> report.Section:
    """Return the geometric means of H mean and of the distance to the local surface beside each rival."""
    columns = (H_MEAN, ESTIMATED_H_MEAN, SURFACE)
    header = ["rival"]
    header += [f"{column.title.split(',')[0]}; {group}" for column in columns for group in groups]
    labels = dict.fromkeys(
        label for of_group in groups.values() for made in of_group.values() for label in made if label not in VARIANTS
    )
    rows = []
    for label in labels:
        row = [label]
        for column in columns:
            for of_group in groups.values():
                values = [ratio(made, column, label) for made in of_group.values()]
                row.append("; ".join(filter(None, (shown(conditions.geometric_mean(values)), ahead(values)))))
        rows.append(row)
    return report.Section("Geometric means, gp divided by each rival", header, rows)


def lidar(all_made: Mapping[Condition, Made]) -> report.Section:
    """Return the figures of the scenes of LiDAR for gp, fps and sample elimination."""
    columns, rivals = (SURFACE, SURFACE_P95, FEATURES, COVER), ("fps", "sample-elimination")
    rows = []
    for condition, made in all_made.items():
        for label in (GP, *rivals):
            cells = []
            for column in columns:
                value, others = mean(made, label, column), [mean(made, rival, column) for rival in rivals]
                behind = label == GP and value > np.nanmin(others)
                text = f"{column.factor * value:.{column.digits}f}"
                cells.append(f"**{text}, behind**" if behind else text)
            rows.append([condition.name, label, *cells])
    return report.Section(
        "Scenes of LiDAR: gp beside fps and sample elimination",
        ["cloud", "method", *(column.title for column in columns)],
        rows,
    )


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    every = (*FOUND_ON, *HELD_OUT)
    chosen, runs = conditions.asked(every, __doc__)
    made = dict(zip(chosen, runs.over(chosen, runs_of), strict=True))
    groups = {
        f"{title} clouds": {condition: made[condition] for condition in of_group if condition in made}
        for title, of_group in (("the rules were found on these", FOUND_ON), ("held-out", HELD_OUT))
    }
    scenes = {condition: made[condition] for condition in LIDAR if condition in made}
    conditions.keep(
        "quality",
        "The method gp beside all rivals",
        [
            *(summary(f"Summary: {title}", group) for title, group in groups.items() if group),
            *([lidar(scenes)] if scenes else []),
            rival_by_rival(groups),
            *(
                conditions.section(condition, of_condition, COLUMNS if condition.exact is None else (*COLUMNS, EXACT))
                for condition, of_condition in made.items()
            ),
        ],
        chosen,
        NOTES,
        whole=len(chosen) == len(every),
        introduction=INTRODUCTION,
    )


if __name__ == "__main__":
    main()
