"""A point for each cell of a grid, as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Voxel(Method):
    """One point for each occupied cell of a grid, with cells of the edge that gives the number.

    Where no edge gives just that number, the most crowded of somewhat too many points go by sample elimination. What
    is left is in the order of the input.

    Parameters
    ----------
    place : "representative" or "mean"
        Keep of each cell the point nearest the mean of its points; or the mean itself, with the attributes of that
        point.
    """

    name = "voxel"
    summary = "one point for each occupied cell of a grid: that nearest the mean of its points, or the mean"
    source = "baseline; the edge of the cells is found by bisection"

    place: Literal["representative", "mean"] = "representative"

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.methods.sample_elimination.elimination import thin
        from gppcs.methods.voxel.grid import cell_edge, representatives

        stages = stages or Stages()
        with stages("size of cells"):
            corner = points.min(axis=0)
            points = points - corner
            edge = cell_edge(points, n_points)
        with stages("representatives"):
            indices, means = representatives(points, edge)
        with stages("elimination"):
            kept, _ = thin(points[indices], n_points)
        return Selection(indices[kept], {}, means[kept] + corner if self.place == "mean" else None)
