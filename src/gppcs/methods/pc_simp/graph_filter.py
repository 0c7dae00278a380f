"""PC-Simp: keep points with a strong upper-pass response on the neighbour graph, evenly spread (Qi et al. 2019)."""

from typing import NamedTuple, Self

import numpy as np
import scipy.sparse

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others


class NeighbourGraph(NamedTuple):
    """The graph of nearest neighbours of N points, in tree order.

    Both matrices are the mean of a directed one and its transpose. The directed `adjacency` is 1 for each neighbour,
    and `weights` exp(-d^2 / sigma) at distance d, at most sqrt(sigma).
    """

    adjacency: scipy.sparse.csr_array
    weights: scipy.sparse.csr_array
    squared_spacing: float

    @classmethod
    def build(cls, tree: KdTree, neighbours: int) -> Self:
        """Connect each point with its nearest neighbours."""
        indices, squared = nearest_others(tree, neighbours)
        starts = np.arange(len(indices) + 1) * neighbours

        def symmetric(values: Floats) -> scipy.sparse.csr_array:
            directed = scipy.sparse.csr_array((values.ravel(), indices.ravel(), starts), shape=(len(indices),) * 2)
            return ((directed + directed.T) / 2).tocsr()

        weights = symmetric(np.exp(-squared / squared.max()))
        return cls(symmetric(np.ones_like(squared)), weights, float(np.median(squared.mean(axis=1))))


def high_pass_strength(points: Floats, graph: NeighbourGraph) -> Floats:
    """Return the squared distances, (N,), of points, (N, 3), to the weighted mean of their neighbours."""
    smoothed = (graph.weights @ points) / graph.weights.sum(axis=1)[:, None]
    return ((points - smoothed) ** 2).sum(axis=1)


class Programme(NamedTuple):
    r"""The quadratic programme of PC-Simp (Qi, Hu and Guo 2019), for the whole cloud.

    Minimise sum_i f_i (s_i - 1)^2 + uniformity \|A s - alpha k\|^2 over 0 <= s <= 1 with sum s = M and alpha = M / N:
    the loss of features f, and neighbourhoods of k points, by the adjacency A, that keep more or fewer than alpha k of
    them.
    """

    strength: Floats
    adjacency: scipy.sparse.csr_array
    neighbours: int
    uniformity: float
    n_points: int

    def excess(self, s: Floats) -> Floats:
        """Return A s - alpha k, (N,)."""
        return self.adjacency @ s - self.n_points / len(s) * self.neighbours

    def value(self, s: Floats) -> float:
        """Return the objective at s, (N,), which is to be minimised."""
        # Here and below, sums of products replace BLAS dot products, whose rounding depends on the number of threads.
        return float((self.strength * (s - 1) ** 2).sum() + self.uniformity * (self.excess(s) ** 2).sum())

    def gap(self, s: Floats, multiplier: float) -> float:
        """Return a bound of the objective at s minus its minimum, from the tangent of the second term."""
        f = self.strength
        slope = 2 * self.uniformity * (self.adjacency @ self.excess(s)) + multiplier
        with np.errstate(over="ignore"):
            v = np.clip(1 - slope / np.maximum(2 * f, 1e-300), 0, 1)
        return float((f * (s - 1) ** 2 - f * (v - 1) ** 2 + slope * (s - v)).sum())


def solve(programme: Programme, tolerance: float = 1e-4, iterations: int = 1000) -> tuple[Floats, float, int]:
    """Solve the programme by accelerated proximal gradient steps (Beck and Teboulle 2009).

    Return s, (N,), its relative duality gap, and the number of iterations. The separable first term belongs to the
    proximal step, solved exactly, so the step length depends on A alone. The momentum restarts uphill (O'Donoghue and
    Candes 2015). Sums are computed in one thread, for the same bits.
    """
    curvature = 2 * programme.uniformity * eigenvalue_bound(programme.adjacency) ** 2
    inverse = 1 / (2 * programme.strength + curvature)
    s = np.full(len(inverse), programme.n_points / len(inverse))
    ahead, momentum, multiplier = s, 1.0, 0.0
    gap, done = np.inf, 0
    while gap > tolerance and done < iterations:
        gradient = 2 * programme.uniformity * (programme.adjacency @ programme.excess(ahead))
        numerator = 2 * programme.strength + curvature * ahead - gradient
        following = np.empty_like(s)
        multiplier = _fill_selection(numerator, inverse, programme.n_points, multiplier, following)
        step = following - s
        if ((ahead - following) * step).sum() > 0:
            momentum = 1.0
        next_momentum = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = following + (momentum - 1) / next_momentum * step
        s, momentum, done = following, next_momentum, done + 1
        if done % 10 == 0 or done == iterations:
            gap = programme.gap(s, multiplier)
            gap = gap / programme.value(s) if gap > 0 else 0.0
    return s, gap, done


def eigenvalue_bound(adjacency: scipy.sparse.csr_array) -> float:
    """Return an upper bound of the largest eigenvalue, max (A x)_i / x_i for a positive x (Collatz and Wielandt)."""
    x = np.ones(adjacency.shape[0])
    for _ in range(10):  # power iterations, after which the bound is within a few percent
        product = adjacency @ x
        bound = float((product / x).max())
        x = product / bound
    return bound


@kernel(fastmath={"nsz", "contract", "reassoc"})
def _fill_selection(numerator, inverse, total, multiplier, s):
    """Fill s = clip((numerator - multiplier) * inverse, 0, 1), (N,), of a given sum; return the multiplier (Newton)."""
    lower, upper = np.inf, -np.inf
    for i in range(len(s)):
        lower, upper = min(lower, numerator[i] - 1 / inverse[i]), max(upper, numerator[i])
    multiplier = min(max(multiplier, lower), upper)
    while True:
        above, slope = -total, 0.0
        for i in range(len(s)):
            value = (numerator[i] - multiplier) * inverse[i]
            slope += inverse[i] if 0.0 < value < 1.0 else 0.0
            s[i] = min(max(value, 0.0), 1.0)
            above += s[i]
        if abs(above) <= 1e-14 * len(s):
            return multiplier
        if above > 0:
            lower = multiplier
        else:
            upper = multiplier
        multiplier = multiplier + above / slope if slope > 0 else lower
        if not lower < multiplier < upper:
            multiplier = lower + (upper - lower) / 2
            if not lower < multiplier < upper:
                return multiplier
