"""The method `voxel`: one point for each occupied cell of a grid."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Literal

from gppcs.errors import InputError
from gppcs.methods.method import Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter, require


@dataclass(frozen=True)
class Voxel(Method):
    """Voxel grid: one point for each occupied cell."""

    name = "voxel"
    summary = "one point for each occupied cell of a grid: by default the point nearest the mean of the cell's points"
    description = (
        "Keeps one point for each occupied cell of a cubic grid. The edge length of the cells is chosen so that about "
        "the right number of cells is occupied, and not too few; sample elimination then removes the most crowded of "
        "the surplus points. The kept points are in the order of the input."
    )
    source = "baseline; the edge length of the cells is found by bisection"
    supports = {
        Feature.SPACING: "The edge length of the cells; each occupied cell keeps one point.",
    }
    by_cells = True
    _bytes_per_point = 170

    keep: Literal["nearest", "mean", "highest", "lowest", "most", "least", "random"] = parameter(
        "nearest",
        'What to keep of each cell. "nearest": the point nearest the mean of its points. "mean": the mean itself, with '
        'the attributes of that point. "highest", "lowest": the point with the largest or smallest z; the cells are '
        'then columns, without limits in z. "most", "least": the point with the largest or smallest value of an '
        'attribute. "random": any point.',
    )
    min_points: int = parameter(1, "Cells with fewer different points than this keep none.", minimum=1)
    attribute: str | None = parameter(None, 'The attribute that counts if keep is "most" or "least".')

    def __post_init__(self) -> None:
        super().__post_init__()
        named = (
            "the name of an attribute" if self.keep in ("most", "least") else 'None unless keep is "most" or "least"'
        )
        require(self, (self.attribute is not None) == (self.keep in ("most", "least")), "attribute", named)

    @property
    def moves_points(self) -> bool:
        return self.keep == "mean"

    @property
    def halo(self) -> tuple[float, float, float]:
        from gppcs.methods.voxel.grid import COLUMNS

        return (1.0, 1.0, math.inf if self.keep in COLUMNS else 1.0)

    @property
    def reads_attribute(self) -> str | None:
        return self.attribute

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.methods.sample_elimination.elimination import thin
        from gppcs.methods.voxel.grid import cell_edge, check_columns, in_cells, occupied, representatives, worth
        from gppcs.spatial.cells import first_occurrences

        points, n_points, timer = task.points, task.n_points, task.timer
        # A finer grid has more cells than whole numbers can count.
        edge = None if task.spacing is None else max(task.spacing, 1e-12)
        placed = in_cells(points, self.keep)
        if edge is None:
            if placed is not points:
                check_columns(int(first_occurrences(placed).sum()), n_points)
            with timer("size of cells"):
                n_cells = partial(occupied, placed, min_points=self.min_points)
                edge = cell_edge(float(placed.max()), n_points, n_cells)
        with timer("representatives"):
            indices, means = representatives(placed, edge, worth(points, self.keep, task.values), self.min_points)
        if not len(indices):
            raise InputError("expected cells with enough points, found none; lower min_points, or raise `spacing`")
        kept = np.arange(len(indices))
        if task.spacing is None and len(indices) > n_points:
            with timer("elimination"):
                kept, _ = thin(points[indices], n_points)
        return Selection(indices[kept], {}, means[kept] if self.keep == "mean" else None)
