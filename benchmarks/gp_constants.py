"""The constants of the method `gp`: what each means, and what half and twice its value change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

import conditions
import gppcs
import report
from conditions import SMALLER, Condition
from gppcs.gp.local import algorithm, candidates, density, greedy, placement
from gppcs.methods import gp
from gppcs.spatial.kdtree import KdTree
from gppcs.surface import noise, quadrics

FACTORS = (0.5, 2.0)
ROUNDING = 1e-12  # a mean distance below this, in diagonals, is only rounding
LIMITS = {"SHARE": (0.0, 0.99), "feature_weight": (0.0, 1.0), "SPARE": (1.0, 2.0)}


class Constant(NamedTuple):
    """A constant of a module, or a parameter of the method if there is no module."""

    module: Any
    name: str
    meaning: str
    unit: str

    def value(self) -> Any:
        """Return its value."""
        return getattr(self.module or gppcs.LocalGP(), self.name)

    def times(self, factor: float) -> Any:
        """Return its value times a factor, whole if it is whole and not 0."""
        value = self.value()
        if isinstance(value, tuple):
            return tuple(factor * each for each in value)
        if isinstance(value, int):
            return max(1, round(factor * value))
        return float(np.clip(factor * value, *LIMITS.get(self.name, (0.0, np.inf))))


CONSTANTS = (
    Constant(None, "feature_weight", "how much denser points are on features", "-"),
    Constant(None, "lengthscale", "of the Matérn kernel", "desired spacings"),
    Constant(None, "neighbours", "chosen points that a posterior is conditioned on", "points"),
    Constant(None, "candidates", "cells of the grid in a square of the target spacing", "cells"),
    Constant(gp, "DENSITY_POWER", "power of the roughness that the density goes as", "-"),
    Constant(gp, "NORMAL_WEIGHT", "distance of two normals at a right angle", "desired spacings"),
    Constant(density, "ROUNDNESS_POWER", "how fast flat faces with edges lower these two", "-"),
    Constant(algorithm, "NUGGET", "variance of an observation without noise", "prior variances"),
    Constant(algorithm, "NEAREST", "points of a neighbourhood where candidates are all points", "points"),
    Constant(algorithm, "GRADATION", "growth of the desired spacing with distance", "-"),
    Constant(density, "GROUP_SIZE", "points that have one limit of that growth", "points"),
    Constant(density, "LEAST_ROUGHNESS", "of flat places", "-"),
    Constant(density, "EDGE_ROUGHNESS", "roughness on a right-angled edge", "-"),
    Constant(density, "WEIGHT_POWER", "power of the users' weights", "-"),
    Constant(density, "FINEST", "candidates with weights", "times those without"),
    Constant(candidates, "FIRST_STAGE", "points of the first stage", "points"),
    Constant(candidates, "ENOUGH", "candidates for each point to keep", "candidates"),
    Constant(candidates, "TOO_MANY", "occupied cells for each that the area has room for", "cells"),
    Constant(candidates, "DISTANCES", "within which a lone candidate has no other", "target spacings"),
    Constant(candidates, "OUTLIERS", "of lone candidates, those lone within twice the distance", "-"),
    Constant(candidates, "HARMLESS", "lone candidates that may stay", "points to keep"),
    Constant(greedy, "SPARE", "points chosen for each one wanted", "-"),
    Constant(greedy, "POINTS", "candidates of a part that chooses at once with others", "candidates"),
    Constant(placement, "PASSES", "of the placement", "-"),
    Constant(placement, "MOST", "points of a cell", "points"),
    Constant(placement, "PROJECTED", "points of a cell where noise matters", "points"),
    Constant(placement, "IN_BALL", "points that the tangent plane of the placement is fitted to", "points"),
    Constant(placement, "REACH", "how far a point goes at once", "distances to three nearest chosen points"),
    Constant(placement, "PULL", "weight of the middle of the cell", "-"),
    Constant(placement, "WIDER", "by which the largest gap may grow", "-"),
    Constant(placement, "AGREEING", "cosine between the planes of a cell and the fan of its point", "-"),
    Constant(placement, "THROUGH", "share of a cell on the other side of a thin wall", "-"),
    Constant(placement, "PARALLEL", "cosine of planes on both sides of a thin wall", "-"),
    Constant(placement, "STEEP", "squared sine of the slope of a way through it", "-"),
    Constant(placement, "TRIED", "points of a cell around which the triangles are tried", "points"),
    Constant(placement, "TRIED_BY_DETAIL", "the same with attributes", "points"),
    Constant(placement, "JUDGED", "points of a cell whose distance from the triangles is measured", "points"),
    Constant(candidates, "LARGE", "points of the sample that is surveyed, at least", "points"),
    Constant(candidates, "PER_POINT", "points of that sample for each point to keep", "points"),
    Constant(noise, "NEIGHBOURS", "points of a quadric", "points"),
    Constant(quadrics, "STEEPEST", "squared slope of a quadric, at most", "-"),
    Constant(noise, "FEWEST", "points within the target spacing from which on noise is measured", "points"),
    Constant(noise, "THICK", "noise above which quadrics are fitted to twice the points", "radii of the fits"),
    Constant(noise, "DETAIL", "what is detail, not noise: ratio of two relative levels", "-"),
    Constant(noise, "CLEAN", "noise that changes nothing", "target spacings"),
    Constant(noise, "TOLERATED", "noise whose observations are as uncertain as the prior", "target spacings"),
    Constant(noise, "LARGEST", "variance of an observation at most", "prior variances"),
    Constant(noise, "SAMPLES", "points on which the noise is measured", "points"),
    Constant(noise, "SHARE", "of the points, the share whose distance tells the level of the noise", "-"),
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
        if constant.module:
            setattr(constant.module, constant.name, value)
        else:
            method = replace(method, **{constant.name: value})
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
            "The first four are parameters of the method. Beyond memory there are three more constants: parts of "
            "131,072 candidates, halos of 6 target spacings "
            "(research/experiments.md), and 16 parts on which noise and scale are measured.",
        ),
        whole=len(chosen) == len(SMALLER),
    )


def shown(value: Any) -> str:
    """Return a value as text."""
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


if __name__ == "__main__":
    main()
