"""The method `pc-simp`: selection by a high-pass filter on the neighbour graph."""

from dataclasses import dataclass

from gppcs.methods.method import Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class PCSimp(Method):
    """Selection by a high-pass filter on the neighbour graph (PC-Simp)."""

    name = "pc-simp"
    summary = "graph filter: points that differ from the mean of their neighbours, balanced with an even choice"
    description = (
        "Prefers points that lie far from the mean of their neighbours, and keeps about as many points in every "
        "neighbourhood. It solves the quadratic programme of the publication, but on the whole cloud instead of cells, "
        'and for exactly M points. The diagnostics are "iterations" and "gap", an upper bound of how far the solution '
        "is from the optimum, relative to its value."
    )
    source = "Qi, Hu and Guo 2019"
    _bytes_per_point = 1500

    neighbours: int = parameter(
        15, "k: the number of nearest points in a neighbourhood; fewer in clouds that have no more.", minimum=1
    )
    uniformity: float = parameter(
        0.1,
        "Weight of an even choice against the loss of features, lambda in the publication. There it depends on the "
        "unit of length. Here feature strengths are divided by the squared spacing: the median over all points of the "
        "mean squared distance to their neighbours. With values above about 10, 1000 iterations may not be enough; "
        'check "gap".',
        minimum=1e-12,
        maximum=1e6,
    )
    tolerance: float = parameter(
        1e-4, "The relative duality gap at which the programme counts as solved.", minimum=1e-16, maximum=1
    )
    iterations: int = parameter(1000, "Most iterations.", minimum=1)

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.methods.pc_simp.graph_filter import NeighbourGraph, Programme, high_pass_strength, solve
        from gppcs.spatial.kdtree import KdTree

        points, n_points, timer = task.points, task.n_points, task.timer
        neighbours = min(self.neighbours, len(points) - 1)
        with timer("neighbour graph"):
            tree = KdTree.build(points)
            graph = NeighbourGraph.build(tree, neighbours)
        with timer("feature strength"):
            strength = high_pass_strength(points[tree.order], graph) / graph.squared_spacing
        with timer("quadratic programme"):
            programme = Programme(strength, graph.adjacency, neighbours, self.uniformity, n_points)
            solution, gap, iterations = solve(programme, self.tolerance, self.iterations)
        selection = np.empty(len(points), dtype=np.float64)
        selection[tree.order] = solution
        indices = np.argsort(-selection, kind="stable")[:n_points]
        return Selection(indices, {"gap": gap, "iterations": float(iterations)})
