"""Simplification by quadric errors as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class QEM(Method):
    """Pairs of neighbours contracted into one of the two, where the planes around them are missed least.

    A smaller choice is the start of a larger one. What is exactly flat costs nothing and is emptied before anything
    else loses a point: on models made of planes, edges are kept and faces are not covered.

    Parameters
    ----------
    neighbours : int
        How many neighbours a point has, to estimate its normal from and to be contracted with.
    """

    name = "qem"
    summary = "quadric errors: neighbours contracted into one of them where that misses the surface least"
    source = "Pauly, Gross and Kobbelt 2002; Garland and Heckbert 1997"

    neighbours: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.neighbours >= 1, "neighbours", "at least 1")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.methods.qem.contraction import contraction_order

        stages = stages or Stages()
        with stages("contraction", len(points) - 1) as advanced:
            return Selection(contraction_order(points, self.neighbours, advanced=advanced)[:n_points])
