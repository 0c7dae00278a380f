"""The constants of the method `gp`: what each means, and what half and twice its value change."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

import conditions
import gppcs
import gppcs.gp.local.algorithm  # which imports all stages
import report
from conditions import SMALLER, Condition
from gppcs.gp.local import greedy, settings
from gppcs.spatial.kdtree import KdTree
from gppcs.surface import noise

FACTORS = (0.5, 2.0)
ROUNDING = 1e-12  # a mean distance below this, in diagonals, is only rounding
LIMITS = {"feature_weight": (0.0, 1.0)}


class Constant(NamedTuple):
    """A constant of a module, or, in small letters, a parameter of the method."""

    name: str
    meaning: str
    unit: str
    module: Any = settings

    def value(self) -> Any:
        """Return its value."""
        if self.name.islower():
            return getattr(gppcs.LocalGP(), self.name)
        return getattr(greedy if self.name == "PART_POINTS" else self.module, self.name)

    def times(self, factor: float) -> Any:
        """Return its value times a factor, whole if it is whole and not 0."""
        value = self.value()
        if isinstance(value, tuple):
            return tuple(factor * part for part in value)
        if isinstance(value, int):
            return max(1, round(factor * value))
        return float(np.clip(factor * value, *LIMITS.get(self.name, (0.0, np.inf))))

    def change(self, value: Any) -> None:
        """Change it for good, in all modules that use it."""
        before = self.value()
        for name, module in list(sys.modules.items()):
            if name.startswith("gppcs.") and self.name in vars(module) and vars(module)[self.name] == before:
                setattr(module, self.name, value)


CONSTANTS = (
    Constant("feature_weight", "how much denser points are on features", "-"),
    Constant("lengthscale", "of the Matérn kernel", "desired spacings"),
    Constant("neighbours", "chosen points that a posterior is conditioned on", "points"),
    Constant("candidates", "cells of the grid in a square of the target spacing", "cells"),
    Constant("DENSITY_POWER", "power of the roughness that the density goes as", "-"),
    Constant("NORMAL_WEIGHT", "distance of two normals at a right angle", "desired spacings"),
    Constant("ROUNDNESS_POWER", "how fast flat faces with edges lower these two", "-"),
    Constant("NUGGET", "variance of an observation without noise", "prior variances"),
    Constant("GRADATION", "growth of the desired spacing with distance", "-"),
    Constant("MIN_ROUGHNESS", "of flat places", "-"),
    Constant("EDGE_ROUGHNESS", "roughness on a right-angled edge", "-"),
    Constant("WEIGHT_POWER", "power of the users' weights", "-"),
    Constant("MAX_REFINEMENT", "candidates with weights", "times those without"),
    Constant("SHEET_SPACINGS", "distance of two sheets, at least", "spacings of the cloud"),
    Constant("SHEET_GAP", "points between two sheets, at most, for each on the other", "-"),
    Constant("SHEET_VARIATION", "surface variation of a sheet that counts", "-"),
    Constant("THIN_FRACTION", "of the candidates beside another sheet, at least", "-"),
    Constant("FIRST_STAGE", "points of the first stage", "points"),
    Constant("MIN_CANDIDATES", "candidates for each point to keep", "candidates"),
    Constant("FEWEST_CELLS", "cells of the grid for each point to keep, where many are kept", "cells"),
    Constant("WANTED_FROM", "points for each point to keep, from which on there are all cells", "points"),
    Constant("MAX_CELLS", "occupied cells for each that the area has room for", "cells"),
    Constant("ISOLATION", "within which an isolated candidate has no other", "target spacings"),
    Constant("OUTLIERS", "of isolated candidates, those isolated within twice the distance", "-"),
    Constant("PART_POINTS", "candidates of a part that chooses at once with others", "candidates"),
    Constant("CELL_POINTS", "points of a cell", "points"),
    Constant("NOISY_CELL_POINTS", "points of a cell where noise matters", "points"),
    Constant("TRIED_ON", "points of a cell that judge an exchange, at most", "points"),
    Constant("CHECKED_ON", "points of a cell that judge all exchanges together, at most", "points"),
    Constant("PLANE_POINTS", "points that the tangent plane of the placement is fitted to", "points"),
    Constant("MAX_STEP", "how far a point goes at once", "distances to three nearest chosen points"),
    Constant("PULL", "weight of the middle of the cell", "-"),
    Constant("GAP_GROWTH", "by which the largest gap may grow", "-"),
    Constant("TRIALS", "points of a cell around which the triangles are tried", "points"),
    Constant("SAMPLE_SIZE", "points of the sample that is surveyed, at least", "points"),
    Constant("SAMPLED_PER_POINT", "points of that sample for each point to keep", "points"),
    Constant("NEIGHBOURS", "points of a quadric", "points", noise),
    Constant("FEWEST", "points within the target spacing from which on noise is measured", "points", noise),
    Constant("THICK", "noise above which quadrics are fitted to twice the points", "radii of the fits", noise),
    Constant("DETAIL", "what is detail, not noise: ratio of two relative thicknesses", "-", noise),
    Constant("CLEAN", "noise that changes nothing", "target spacings", noise),
    Constant("TOLERATED", "noise whose observations are as uncertain as the prior", "target spacings", noise),
    Constant("LARGEST", "variance of an observation at most", "prior variances", noise),
    Constant("SAMPLES", "points on which the noise is measured", "points", noise),
    Constant("SHARED", "distance from a fit within which points take its quadric", "radii of the fits", noise),
)


def judged(condition: Condition, method: gppcs.LocalGP) -> tuple[float, float]:
    """Return mean distance to the local surface and covering radius, in diagonals."""
    kept = conditions.simplified(condition, method)[0].points
    places = condition.original.points if condition.exact is None else condition.exact
    surface, cover = conditions.mean_to_local_surface(places, kept), KdTree.build(kept).nearest_of(places, 1)[1].max()
    return max(surface / condition.diagonal, ROUNDING), float(np.sqrt(cover)) / condition.diagonal


def changed(change: tuple[int, float] | None, chosen: Sequence[Condition]) -> dict[str, tuple[float, float]]:
    """Return the figures by condition with one constant changed, given by its number.

    It changes the module for good, so it needs a process of its own: kernels keep the values of their first call.
    """
    gppcs.set_threads(1)
    method = gppcs.LocalGP()
    if change:
        constant, value = CONSTANTS[change[0]], CONSTANTS[change[0]].times(change[1])
        if constant.name.islower():
            method = replace(method, **{constant.name: value})
        else:
            constant.change(value)
    return {each.name: judged(each, method) for each in chosen}


def cells(ratios: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return the cells of a change: geometric means, and the best and the worst cloud."""
    if all(value == (1.0, 1.0) for value in ratios.values()):
        return ["as it is", "as it is", "", ""]
    means = map(conditions.geometric_mean, zip(*ratios.values(), strict=True))
    order = sorted(ratios, key=lambda name: ratios[name][0])
    ends = [f"{ratios[name][0]:.3f} ({name.split(':')[0]})" for name in (order[0], order[-1])]
    return [*(f"{mean:.3f}" for mean in means), *ends]


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    chosen, runs = conditions.asked(SMALLER, __doc__)
    changes = [None, *((i, factor) for i in range(len(CONSTANTS)) for factor in FACTORS)]
    rows: dict[float, list[Sequence[str]]] = {factor: [] for factor in FACTORS}
    with ProcessPoolExecutor(runs.jobs, get_context("spawn"), max_tasks_per_child=1) as processes:
        made = dict(zip(changes, processes.map(partial(changed, chosen=chosen), changes), strict=True))
    usual = made.pop(None)
    for (number, factor), found in made.items():
        ratios = {name: (value[0] / usual[name][0], value[1] / usual[name][1]) for name, value in found.items()}
        rows[factor].append([CONSTANTS[number].name, shown(CONSTANTS[number].times(factor)), *cells(ratios)])
    header = ["constant", "value", "mean distance to the local surface", "covering radius", "best cloud", "worst cloud"]
    meanings = [[each.name, each.meaning, each.unit, shown(each.value())] for each in CONSTANTS]
    conditions.keep(
        "gp_constants",
        "The constants of gp",
        [
            report.Section("What they mean", ["constant", "meaning", "unit", "value"], meanings),
            *(report.Section(f"Times {factor:g}", header, rows[factor]) for factor in FACTORS),
        ],
        chosen,
        (
            "Figures are multiples of those with the usual constants, in the geometric mean over all clouds. Below 1, "
            "the change is an improvement.",
            "The first four are parameters of the method.",
        ),
        whole=len(chosen) == len(SMALLER),
    )


def shown(value: Any) -> str:
    """Return a value as text."""
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


if __name__ == "__main__":
    main()
