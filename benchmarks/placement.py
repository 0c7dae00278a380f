"""What the placement of gp is worth, and what the field adds beyond it.

Needs the extra `evaluate`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import numpy as np

import conditions
import gppcs
import report
from conditions import COVER, ESTIMATED_H_MEAN, FEATURES, FOUND_ON, H_MAX, H_MEAN, HELD_OUT, SURFACE, Condition, Figures
from gppcs.gp.local import algorithm
from gppcs.gp.local.candidates import survey
from gppcs.gp.local.placement import place

SHOWN = (H_MEAN, H_MAX, ESTIMATED_H_MEAN, SURFACE, COVER, FEATURES)
STARTS = range(3)  # turns of the cloud
GROUPS = {"the rules were found on these clouds": FOUND_ON, "held-out clouds": HELD_OUT}


class PlacedFarthestPoint(gppcs.FarthestPoint):
    """Farthest points, placed as `gp` does."""

    def __call__(self, task: gppcs.Task) -> gppcs.Selection:
        """Choose, then place."""
        found = super().__call__(task)
        measured = survey(task.points, task.n_points, gppcs.LocalGP().candidates, task.timer)
        return replace(found, indices=place(task.points, found.indices, 0, measured))


METHODS: Mapping[str, tuple[gppcs.Method, bool]] = {  # and whether it is placed
    "gp, not placed": (gppcs.LocalGP(), False),
    "gp": (gppcs.LocalGP(), True),
    "fps": (gppcs.FarthestPoint(), True),
    "fps, placed": (PlacedFarthestPoint(), True),
}
PAIRS = (("gp", "gp, not placed"), ("fps, placed", "fps"), ("gp", "fps, placed"))


def kept_by(condition: Condition, label: str, start: int) -> tuple[gppcs.PointCloud, float]:
    """Return the points that a method keeps, and the seconds."""
    method, is_placed = METHODS[label]
    with nullcontext() if is_placed else patch.object(algorithm, "place", conditions.not_placed):
        return conditions.simplified(condition, method, start)


def measured(condition: Condition, runs: conditions.Runs) -> dict[str, Figures]:
    """Return the mean figures of all methods under a condition."""
    works = {label: {start: partial(kept_by, condition, label, start) for start in STARTS} for label in METHODS}
    made = runs.of_all(condition, works)
    return {
        label: {name: float(np.mean([each[name] for each in of if name in each])) for name in of[0]}
        for label, of in made.items()
    }


def section(title: str, made: Mapping[str, Mapping[str, Figures]]) -> report.Section:
    """Return the ratios of the pairs on each cloud, and their geometric means."""
    header = ["cloud", "", *(column.title.split(",")[0] for column in SHOWN)]
    nan = float("nan")
    ratios = {
        (name, *pair): [of[pair[0]].get(each.figure, nan) / of[pair[1]].get(each.figure, nan) for each in SHOWN]
        for name, of in made.items()
        for pair in PAIRS
    }
    rows = [[name, f"{one} / {other}", *cells(found)] for (name, one, other), found in ratios.items()]
    means = []
    for one, other in PAIRS:
        of_pair = zip(*(ratios[name, one, other] for name in made), strict=True)
        means.append(["**geometric mean**", f"{one} / {other}", *cells(map(conditions.geometric_mean, of_pair))])
    return report.Section(title, header, [*means, *rows])


def cells(ratios: Iterable[float]) -> list[str]:
    """Return ratios as cells, empty where there is none."""
    return [f"{value:.3f}" if np.isfinite(value) else "" for value in ratios]


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    every = [each for group in GROUPS.values() for each in group]
    chosen, runs = conditions.asked(every, __doc__)
    made = {each.name: found for each, found in zip(chosen, runs.over(chosen, measured), strict=True)}
    sections = [
        section(title, {each.name: made[each.name] for each in group if each.name in made})
        for title, group in GROUPS.items()
        if any(each.name in made for each in group)
    ]
    conditions.keep(
        "placement",
        "What the placement of gp is worth",
        sections,
        chosen,
        (
            "Each row divides the figures of one method by those of another; below 1, the first one is better. They "
            f"are means of {len(STARTS)} runs: one on the cloud as it is, the others on the cloud turned at random. "
            "quality.md explains the figures.",
            "fps, placed: farthest points with the placement of gp. What gp has beyond it is due to the field.",
        ),
        whole=len(chosen) == len(every),
    )


if __name__ == "__main__":
    main()
