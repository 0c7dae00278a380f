"""The method `gp` beside all rivals on scenes: streets, land and rooms, seen by LiDAR, a laser or a depth camera.

Needs no extra. WLOP by CGAL takes part if the extra `cgal` is installed. To judge one run, import `score`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np

import conditions
import quality
import report
from conditions import (
    COVER_P999,
    FEATURES,
    SCENE,
    SECONDS,
    SURFACE,
    SURFACE_BY_AREA,
    SURFACE_P95,
    SURFACE_P95_BY_AREA,
    SURFACE_SAMPLE,
    Column,
    Condition,
    SampleScene,
    ThinnedScene,
)
from gppcs.amounts.options import method_of
from quality import GP, Made, best_rival, shown

RATIOS = (0.01, 0.03, 0.1)
SCENES: Mapping[str, type[Condition]] = {
    "kitti_000000": ThinnedScene,
    "autzen_airborne": ThinnedScene,
    "lidr_topography_airborne": ThinnedScene,
    "3dmatch_room_fragment": ThinnedScene,
    "nyu_basement": ThinnedScene,
    "redwood_fragment": ThinnedScene,
    "tum_desk": ThinnedScene,
    "pcl_room_scan": ThinnedScene,
    "lion_takanawa": ThinnedScene,
    "room": SampleScene,
    "avenue": SampleScene,
    "terrain": SampleScene,
    "forest": SampleScene,
    "plot": SampleScene,
}
HELD_OUT = ("redwood_fragment", "avenue", "terrain", "forest", "plot")  # no constant of gp was decided by these
MEASURES = (SURFACE, SURFACE_P95, SURFACE_BY_AREA, SURFACE_P95_BY_AREA, FEATURES, COVER_P999)
CONDITIONS = [make(name, None, ratio) for name, make in SCENES.items() for ratio in RATIOS]
INTRODUCTION = (
    f"{len(SCENES)} scenes at {', '.join(f'{100 * ratio:g} %' for ratio in RATIOS)} of their points. "
    f"{', '.join(HELD_OUT)} are held out: no constant of gp was decided by these. The others took part in telling "
    "noise from detail, and outliers from sparse parts. Each figure of gp is divided by that of the best rival under "
    "the same condition, or by that of fps, so below 1 gp is ahead. Where gp is behind, the cell is bold and says so."
)
NOTES = (
    f"A file of more than {1.5 * SCENE:,.0f} points is thinned to about {SCENE:,}: every n-th point is taken.",
    f"room, avenue, terrain, forest and plot are scenes of benchmarks/scans with {SCENE:,} points. {SURFACE_SAMPLE:,} "
    "other points of their surfaces judge them, seen by the same sensor without noise, and without leaves. The other "
    "scenes are compared with their own points, noise included.",
    f"Mean ± standard deviation of {len(quality.STARTS)} runs. The first is of the cloud as it is, the others of the "
    "cloud turned at random, with other random numbers; all are judged on the cloud as it is.",
    "Rivals are those of quality.md. The best rival may differ between conditions and between measures.",
    "By area: each point counts by the area of the surface that it stands for (docs/evaluation.md).",
    "Lengths are in diagonals of the bounding box of the points that judge.",
    "Seconds are of each run once, with compiled kernels and one thread, while other runs may be under way.",
)


@cache
def scene_of(name: str) -> Condition:
    """Return a scene whose points are read or computed once."""
    return SCENES.get(name, ThinnedScene)(name, None, 1.0)


def score(
    cloud: str, method: str, params: Mapping[str, Any] | None = None, ratio: float = 0.03, seed: int = 0
) -> dict[str, float]:
    """Thin a scene and judge the kept points.

    Parameters
    ----------
    cloud : str
        A name of `SCENES`, or another file of the data, which is thinned and judged as the scenes of files are.
    method : str
        A name of `gppcs.METHODS`.
    params : mapping of str to value, optional
        Parameters of the method that replace the defaults.
    ratio : float
        Share of the points to keep.
    seed : int
        The cloud is turned at random by this seed before it is thinned; 0 leaves it as it is.

    Returns
    -------
    dict of str to float
        All figures of `gppcs.evaluate`, lengths in diagonals, and "seconds". `MEASURES` names those of the tables.
    """
    scene = scene_of(cloud)
    chosen, n_points = method_of(method, settings=params), round(ratio * len(scene.cloud))
    kept, seconds = conditions.simplified(scene, chosen, seed, n_points)
    return {**conditions.figures(scene, kept), "seconds": seconds}


def groups_of(all_made: Mapping[Condition, Made]) -> dict[str, list[Condition]]:
    """Return the conditions that are averaged together, by heading, without empty groups."""
    groups = {
        "all": list(all_made),
        **{f"{100 * ratio:g} %": [each for each in all_made if each.amount == ratio] for ratio in RATIOS},
        "held out": [each for each in all_made if each.file in HELD_OUT],
        "the others": [each for each in all_made if each.file not in HELD_OUT],
    }
    return {heading: group for heading, group in groups.items() if group}


def beside(title: str, all_made: Mapping[Condition, Made], rival_of: Callable[[Made, Column], str]) -> report.Section:
    """Return the geometric means of the figures of gp divided by those of a rival, for each measure and group."""
    groups = groups_of(all_made)
    rows = []
    for column in MEASURES:
        ratios = {
            condition: quality.ratio(made, column, rival_of(made, column)) for condition, made in all_made.items()
        }
        means = [shown(conditions.geometric_mean([ratios[each] for each in group])) for group in groups.values()]
        values = list(ratios.values())
        rows.append([column.title, *means, shown(np.nanmax(values)), quality.ahead(values)])
    return report.Section(title, ["measure", *groups, "largest", "conditions"], rows)


def each_condition(all_made: Mapping[Condition, Made]) -> report.Section:
    """Return gp divided by the best rival, and which that is, for each condition and measure."""
    rows = []
    for condition, made in all_made.items():
        rivals = [best_rival(made, column) for column in MEASURES]
        cells = [
            f"{shown(quality.ratio(made, column, rival))} {rival}"
            for column, rival in zip(MEASURES, rivals, strict=True)
        ]
        rows.append([condition.name, *cells])
    return report.Section(
        "gp divided by the best rival under each condition", ["condition", *(each.title for each in MEASURES)], rows
    )


def each_rival(all_made: Mapping[Condition, Made]) -> report.Section:
    """Return the geometric means over all conditions of gp divided by each rival."""
    labels = dict.fromkeys(label for made in all_made.values() for label in made if label not in quality.VARIANTS)
    rows = [
        [label, *(shown(conditions.geometric_mean([quality.ratio(made, column, label) for made in all_made.values()]))
                  for column in MEASURES)]
        for label in labels
    ]  # fmt: skip
    return report.Section(
        "Geometric means, gp divided by each rival", ["rival", *(each.title for each in MEASURES)], rows
    )


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    chosen, runs = conditions.asked(CONDITIONS, __doc__)
    made = dict(zip(chosen, runs.over(chosen, partial(quality.runs_of, variants=(GP,))), strict=True))
    conditions.keep(
        "scenes",
        "The method gp beside all rivals on scenes",
        [
            beside("Summary: geometric means of gp divided by the best rival of each condition", made, best_rival),
            beside("Summary: geometric means of gp divided by fps", made, lambda *_: "fps"),
            each_rival(made),
            each_condition(made),
            *(
                conditions.section(condition, of_condition, (*MEASURES, SECONDS))
                for condition, of_condition in made.items()
            ),
        ],
        chosen,
        NOTES,
        whole=len(chosen) == len(CONDITIONS),
        introduction=INTRODUCTION,
    )


if __name__ == "__main__":
    main()
