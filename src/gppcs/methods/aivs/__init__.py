"""The isotropic form of AIVS as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class AIVS(Method):
    """Farthest points in each box of a grid, in number by its share of the points, apart from those around.

    As in the program that its authors published, distances are Euclidean. Their forms that follow curvature and
    sharp edges are not public.
    """

    name = "aivs"
    summary = "farthest points box by box, as many of each as its share of the points"
    source = "Lv, Lin and Zhao 2021, the isotropic form"

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.methods.aivs.boxes import CLASSES, points_of_boxes

        stages = stages or Stages()
        with stages("boxes", CLASSES) as advanced:
            return Selection(points_of_boxes(points, n_points, advanced))
