"""What the parts of the method `gp` are worth: one part changed or left out at a time, beside the default."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

import conditions
import gppcs
import report
from conditions import (
    ESTIMATED_H_MEAN,
    FOUND_ON,
    H_MAX,
    H_MEAN,
    HELD_OUT,
    LIDAR,
    SMALLER,
    SURFACE,
    Column,
    Condition,
    Figures,
)
from gppcs.gp.local import algorithm, candidates
from gppcs.gp.local.algorithm import Criterion
from gppcs.surface import noise

USED = tuple(each for each in SMALLER if each in FOUND_ON and each.amount != 0.2)
OTHERS = tuple(each for each in HELD_OUT if each not in LIDAR)  # H mean needs a rebuilt surface
CONDITIONS = (*USED, *OTHERS)
STARTS = range(3)  # turns of the cloud
CONTROL_STARTS = range(3, 6)
SHOWN = (H_MEAN, H_MAX, ESTIMATED_H_MEAN, SURFACE)
USUAL = gppcs.LocalGP()
DEFAULT = "default"
CONTROL = "default, other turns"


@dataclass(frozen=True)
class Weighted(gppcs.LocalGP):
    """The method with other weights in its criterion."""

    density: float = 1.0
    normal: float = 1.0
    error: float = 0.0

    @property
    def criterion(self) -> Criterion:
        """What the selection weighs."""
        usual = super().criterion
        return dataclasses.replace(
            usual,
            density_power=self.density * usual.density_power,
            normal_weight=self.normal * usual.normal_weight,
            error_weight=self.error,
        )


@dataclass(frozen=True)
class Change:
    """A method, and attributes of modules that are replaced while it runs."""

    method: gppcs.LocalGP = USUAL
    replaced: Sequence[tuple[Any, str, Any]] = ()  # module, name, value


def not_graded(tree: Any, spacings: Any, slope: float) -> Any:
    """Leave spacings as they are, in place of `density.graded`."""
    return spacings


def always_round(roughness: Any) -> float:
    """Take every cloud for one that is alike everywhere, in place of `density.roundness_of`."""
    return 1.0


def nowhere_sharp(variation: Any) -> Any:
    """Take no place for sharp, in place of `candidates.sharpness_of`."""
    return np.zeros(len(variation))


def changes() -> dict[str, Change]:
    """Return the changes by their names in the table."""
    gradation_off, segregation_off = (algorithm, "graded", not_graded), (algorithm, "roundness_of", always_round)
    sharpness_off, noise_off = (candidates, "sharpness_of", nowhere_sharp), (noise, "CLEAN", np.inf)
    return {
        DEFAULT: Change(),
        CONTROL: Change(),
        "posterior conditioned on 1 point (farthest points in the metric)": Change(replace(USUAL, neighbours=1)),
        "error term, weight 0.1": Change(Weighted(error=0.1)),
        "error term, weight 1 (the paper's)": Change(Weighted(error=1.0)),
        "normals off": Change(Weighted(normal=0.0)),
        "density off": Change(Weighted(density=0.0)),
        "normals and density off": Change(replace(USUAL, feature_weight=0.0)),
        "gradation off": Change(replaced=[gradation_off]),
        "segregation off": Change(replaced=[segregation_off]),
        "sharpness off": Change(replaced=[sharpness_off]),
        "placement off": Change(replaced=[(algorithm, "place", conditions.not_placed)]),
        "noise off": Change(replaced=[noise_off]),
        "wide neighbourhoods off": Change(replaced=[(noise, "THICK", np.inf)]),
        "largest variance off": Change(replaced=[(noise, "LARGEST", np.inf)]),
    }


def kept_by(condition: Condition, change: Change, start: int) -> tuple[gppcs.PointCloud, float]:
    """Return the points that the changed method keeps of the turned cloud, and the seconds."""
    with ExitStack() as stack:
        for module, name, value in change.replaced:
            stack.enter_context(patch.object(module, name, value))
        return conditions.simplified(condition, change.method, start)


def measured(condition: Condition, runs: conditions.Runs) -> dict[str, list[Figures]]:
    """Return the figures of all runs under a condition, by the names of the changes."""
    works = {
        label: {
            start: partial(kept_by, condition, change, start)
            for start in (CONTROL_STARTS if label == CONTROL else STARTS)
        }
        for label, change in changes().items()
    }
    return runs.of_all(condition, works)


def ratios(made: Mapping[str, Mapping[str, Sequence[Figures]]], label: str, column: Column) -> dict[str, float]:
    """Return the geometric mean of a figure over the default's, of the runs where both have it, on each cloud."""
    found, nan = {}, float("nan")
    for name, of in made.items():
        pairs = zip(of[label], of[DEFAULT], strict=True)
        figures = (one.get(column.figure, nan) / other.get(column.figure, nan) for one, other in pairs)
        found[name] = conditions.geometric_mean(figures)
    return {name: value for name, value in found.items() if np.isfinite(value)}


def summary(made: Mapping[str, Mapping[str, Sequence[Figures]]]) -> list[list[str]]:
    """Return a row for each change: geometric means, and the best and the worst cloud in H mean."""
    rows = []
    for label in changes():
        if label != DEFAULT:
            means = [conditions.geometric_mean(ratios(made, label, column).values()) for column in SHOWN]
            by_cloud = ratios(made, label, H_MEAN)
            best, worst = min(by_cloud, key=by_cloud.__getitem__), max(by_cloud, key=by_cloud.__getitem__)
            ends = [f"{by_cloud[name]:.3f} ({name.split(':')[0]})" for name in (best, worst)]
            rows.append([label, *(f"{value:.3f}" for value in means), *ends])
    return rows


def by_cloud(made: Mapping[str, Mapping[str, Sequence[Figures]]], column: Column) -> list[list[str]]:
    """Return a row for each condition, with the ratio of each change."""
    labels = [label for label in changes() if label != DEFAULT]
    of_each = {label: ratios(made, label, column) for label in labels}
    return [
        [name, *(f"{of_each[label][name]:.3f}" if name in of_each[label] else "" for label in labels)] for name in made
    ]


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    chosen, runs = conditions.asked(CONDITIONS, __doc__)
    made = dict(zip([each.name for each in chosen], runs.over(chosen, measured), strict=True))
    groups = {
        "All clouds": list(made),
        "Clouds that took part in finding the rules": [each.name for each in USED if each.name in made],
        "Clouds that did not": [each.name for each in OTHERS if each.name in made],
    }
    header = ["change", *(column.title.split(",")[0] for column in SHOWN), "best cloud, H mean", "worst cloud, H mean"]
    sections = [
        report.Section(title, header, summary({name: made[name] for name in names}))
        for title, names in groups.items() if names
    ]  # fmt: skip
    labels = [label for label in changes() if label != DEFAULT]
    sections.append(report.Section("H mean, each cloud", ["cloud", *labels], by_cloud(made, H_MEAN)))
    conditions.keep(
        "gp_ablation",
        "What the parts of gp are worth",
        sections,
        chosen,
        (
            f"Figures are multiples of the default's: geometric means over {len(STARTS)} runs on each cloud, the first "
            "of the cloud as it is, the others of the cloud turned at random. Below 1, the change is an improvement. "
            "quality.md explains the figures.",
            f"{CONTROL}: the same method on the cloud turned in {len(CONTROL_STARTS)} other ways. It shows how far "
            "from 1 chance alone leads.",
            "The default has no error term: the score is the uncertainty alone.",
        ),
        whole=len(chosen) == len(CONDITIONS),
    )


if __name__ == "__main__":
    main()
