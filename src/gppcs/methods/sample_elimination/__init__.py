"""Weighted sample elimination as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class SampleElimination(Method):
    """The point with the nearest neighbours removed, again and again; the order of the rest is progressive."""

    name = "sample-elimination"
    summary = "the most crowded point removed, again and again: blue noise"
    source = "Yuksel 2015"

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.methods.sample_elimination.elimination import eliminate

        stages = stages or Stages()
        with stages("elimination", len(points) - n_points) as advanced:
            return Selection(eliminate(points, n_points, advanced))
