"""Selection by a filter on the neighbour graph as a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, largest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class PCSimp(Method):
    """Points that differ from the mean of their neighbours, and about as many in every neighbourhood.

    The quadratic programme of the source, but on the whole cloud in place of cells, and for exactly M points. Its
    diagnostics are "gap", by how much the value may lie above the least, relative, and "iterations".

    Parameters
    ----------
    neighbours : int
        k: how many nearest points are a neighbourhood; fewer in clouds that have no more.
    uniformity : float
        Weight of an even choice against the loss of features, lambda in the source. There it depends on the unit of
        length; here strengths are in units of the squared spacing, the median over the points of the mean squared
        distance to their neighbours. From about 10 on, 1000 iterations may not suffice; "gap" tells.
    tolerance : float
        Relative duality gap at which the programme is taken as solved.
    iterations : int
        The number of steps after which it is in any case.
    """

    name = "pc-simp"
    summary = "graph filter: what differs from the mean of its neighbours, balanced with an even choice"
    source = "Qi, Hu and Guo 2019"

    neighbours: int = 15
    uniformity: float = 0.1
    tolerance: float = 1e-4
    iterations: int = 1000

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.neighbours >= 1, "neighbours", "at least 1")
        self.require(self.uniformity > 0, "uniformity", "above 0")
        self.require(self.tolerance > 0, "tolerance", "above 0")
        self.require(self.iterations >= 1, "iterations", "at least 1")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        from gppcs.methods.pc_simp.graph_filter import NeighbourGraph, Programme, high_pass_strength, solve
        from gppcs.spatial.kdtree import KdTree

        stages = stages or Stages()
        neighbours = min(self.neighbours, len(points) - 1)
        with stages("neighbour graph"):
            tree = KdTree.build(points)
            graph = NeighbourGraph.build(tree, neighbours)
        with stages("feature strength"):
            strength = high_pass_strength(points[tree.order], graph) / graph.squared_spacing
        with stages("quadratic programme"):
            programme = Programme(strength, graph.adjacency, neighbours, self.uniformity, n_points)
            solution = solve(programme, self.tolerance, self.iterations)
        selection = np.empty(len(points), dtype=np.float64)
        selection[tree.order] = solution.selection
        diagnostics = {"gap": solution.gap, "iterations": float(solution.iterations)}
        return Selection(largest(selection, n_points), diagnostics)
