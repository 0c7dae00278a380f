"""What each fixed number of the method `gp` is worth: one changed at a time, beside the default."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

import conditions
import gppcs
import report
from conditions import H_MAX, H_MEAN, SURFACE, Column, Condition, Figures
from gppcs.gp.local import candidates, density
from gppcs.gp.local.ranking import Criterion
from gppcs.surface import noise

CONDITIONS = (
    Condition("bunny", "bunny", 0.05),
    Condition("nefertiti", "nefertiti", 0.05),
    Condition("fandisk_60k_sampled", "fandisk", 1_200),
    Condition("armadillo_100k_noise_2.5e-3", "armadillo_50k", 0.05),
    Condition("armadillo_100k_noise_5e-3", "armadillo_50k", 0.05),
)
STARTS = range(2)  # turns of the cloud
OTHERS = range(2, 4)
SHOWN = (H_MEAN, H_MAX, SURFACE)
USUAL = gppcs.LocalGP()
DEFAULT = "default"
CONTROL = "default, from other turns"


@dataclass(frozen=True)
class Weighted(gppcs.LocalGP):
    """The method with the three weights of its criterion multiplied."""

    density: float = 1.0
    normal: float = 1.0
    error: float = 1.0

    @property
    def criterion(self) -> Criterion:
        """What the selection weighs."""
        usual = super().criterion
        return dataclasses.replace(
            usual,
            density_power=self.density * usual.density_power,
            normal_weight=self.normal * usual.normal_weight,
            error_weight=self.error * usual.error_weight,
        )


@dataclass(frozen=True)
class Change:
    """A method, and numbers of modules that are no parameters, as they are to be meanwhile."""

    method: gppcs.LocalGP = USUAL
    replaced: Sequence[tuple[Any, str, Any]] = ()  # module, name, value


def changes() -> dict[str, Change]:
    """Return the changes, by what the table calls them."""
    fields = {
        "neighbours": (2, 3, 6, 8), "lengthscale": (0.75, 1.0, 2.0, 3.0), "candidates": (5.0, 12.0, 24.0),
        "feature_weight": (0.0, 0.25, 0.75, 1.0),
    }  # fmt: skip
    weights = {"density": (0.0, 0.5, 1.5), "normal": (0.0, 0.5, 1.5), "error": (0.0, 4.0, 10.0)}
    names = {"density": "density_power", "normal": "normal_weight", "error": "error_weight"}
    found = {DEFAULT: Change(), CONTROL: Change()}
    for field, values in fields.items():
        for value in values:
            found[f"{field} {value:g} for {getattr(USUAL, field):g}"] = Change(USUAL.replaced({field: value}))
    for field, values in weights.items():
        found |= {f"{names[field]} x {value:g}": Change(Weighted(**{field: value})) for value in values}
    found["noise off"] = Change(replaced=[(noise, "QUIET", np.inf), (candidates, "REACH", 0.0)])
    for value in (0.25, 1.0):
        found[f"noise tolerated {value:g} for {noise.TOLERATED:g}"] = Change(replaced=[(noise, "TOLERATED", value)])
    for value in (1.0, 4.0):
        found[f"largest variance {value:g} for {noise.LARGEST:g}"] = Change(replaced=[(noise, "LARGEST", value)])
    for value in (25, 60):
        found[f"points of the noise's quadrics {value} for {noise.MOST}"] = Change(replaced=[(noise, "MOST", value)])
    for value in (40, 160):
        found[f"where noise is thick {value} for {noise.WIDE}"] = Change(replaced=[(noise, "WIDE", value)])
    for value in (0.2, 0.5):
        found[f"thick from {value:g} for {noise.THICK:g}"] = Change(replaced=[(noise, "THICK", value)])
    for value in (0.0, 0.5):
        found[f"least density {value:g} for {density.SPARSEST:g}"] = Change(replaced=[(density, "SPARSEST", value)])
    for value in (0.03, 0.1):
        found[f"even below {value:g} for {density.EVEN:g}"] = Change(replaced=[(density, "EVEN", value)])
    for value in (0.2, 1 / 3):
        found[f"roughness of an edge {value:.2g} for {density.EDGE:g}"] = Change(replaced=[(density, "EDGE", value)])
    for value in (0.0, 0.5, 1.5):
        found[f"sharpness within {value:g} for {candidates.REACH:g} cells"] = Change(
            replaced=[(candidates, "REACH", value)]
        )
    for value in (0.05, 0.2, 100.0):
        found[f"slope {value:g} for {density.SLOPE:g}"] = Change(replaced=[(density, "SLOPE", value)])
    return found


def kept_by(condition: Condition, change: Change, start: int) -> tuple[gppcs.PointCloud, float]:
    """Return what the method makes of the cloud turned, with the change, and the seconds."""
    with ExitStack() as stack:
        for module, name, value in change.replaced:
            stack.enter_context(patch.object(module, name, value))
        return conditions.simplified(condition, change.method, start)


def ratios(changed: Sequence[Figures], usual: Sequence[Figures], column: Column) -> list[float]:
    """Return the logarithms of a figure over the default's, of the runs where both have it."""
    pairs = [(one.get(column.figure), other.get(column.figure)) for one, other in zip(changed, usual, strict=True)]
    return [float(np.log(one / other)) for one, other in pairs if one is not None and other is not None]


def cell(logarithms: Sequence[float]) -> str:
    """Return the geometric mean."""
    return f"{np.exp(np.mean(logarithms)):.3f}" if logarithms else ""


def rows(made: Mapping[str, Sequence[Sequence[Figures]]], column: Column | None = None) -> list[list[str]]:
    """Return, of each change, the geometric means over all conditions, or of one figure under each condition."""
    found = []
    for label, changed in made.items():
        pairs = list(zip(changed, made[DEFAULT], strict=True))
        if column:
            cells = [cell(ratios(one, other, column)) for one, other in pairs]
        else:
            cells = [cell([value for pair in pairs for value in ratios(*pair, shown)]) for shown in SHOWN]
        if label != DEFAULT:
            found.append([label, *cells])
    return found


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    chosen, runs = conditions.asked(CONDITIONS, __doc__)
    made: dict[str, list[list[Figures]]] = {label: [] for label in changes()}
    for condition in chosen:
        for label, change in changes().items():
            starts = OTHERS if label == CONTROL else STARTS
            made[label].append(
                [runs.of(condition, label, start, partial(kept_by, condition, change, start)) for start in starts]
            )
    titles = [column.title.split(",")[0] for column in SHOWN]
    names = [condition.name for condition in chosen]
    conditions.keep(
        "gp_ablation",
        "What the fixed numbers of gp are worth",
        [
            report.Section("All clouds", ["change", *titles], rows(made)),
            *(
                report.Section(f"{title}, each cloud", ["change", *names], rows(made, column))
                for title, column in zip(titles, SHOWN, strict=True)
            ),
        ],
        chosen,
        (
            f"Figures as multiples of the default's: geometric means over {len(STARTS)} runs on each cloud, the first "
            "of the cloud as it is, the others of the cloud turned at random; below 1, the change is for the better.",
            f"{CONTROL}: the same method on the cloud turned in {len(OTHERS)} other ways. It says how far from 1 "
            "chance alone leads.",
            "feature_weight moves density_power, normal_weight and error_weight together. Where the noise is "
            "judged too small to matter, the numbers that treat it change nothing. Without it (noise off) candidates "
            "are the first points of their cells, as where it is noticed.",
        ),
        whole=len(chosen) == len(CONDITIONS),
    )


if __name__ == "__main__":
    main()
