"""Selection on the neighbour graph: strong high-pass response kept, evenly spread (PC-Simp; Qi, Hu and Guo 2019)."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from gppcs.spatial.kdtree import KdTree

ROUNDING = 1e-14  # times N: as near as the sum of the selection comes to M
BOUND_STEPS = 10  # products with the adjacency, after which its bound is within a few per cent
CHECK_EVERY = 10  # steps between two looks at the duality gap, which costs as much as a step


@dataclass(frozen=True)
class NeighbourGraph:
    """The graph of nearest neighbours, points in the order of the tree.

    Both matrices are means of that of the neighbours and its transpose, so entries are halved where only one of
    two points is a neighbour of the other.

    Attributes
    ----------
    adjacency : (N, N) sparse array, float64
        One for each neighbour.
    weights : (N, N) sparse array, float64
        exp(-d^2 / sigma), with sigma the largest squared distance d^2 of any point to a neighbour.
    squared_spacing : float
        The median over the points of the mean squared distance to the neighbours. Where more than half of the points
        lie in a dot, it jumps to that of the dot, and what is measured in it grows as much.
    """

    adjacency: scipy.sparse.csr_array
    weights: scipy.sparse.csr_array
    squared_spacing: float

    @classmethod
    def build(cls, tree: KdTree, neighbours: int) -> NeighbourGraph:
        """Link each point to its nearest ones; there must be more points than `neighbours`, without repeats."""
        indices, squared = tree.neighbours(neighbours)
        starts = np.arange(len(indices) + 1) * neighbours

        def symmetric(values: NDArray[np.float64]) -> scipy.sparse.csr_array:
            directed = scipy.sparse.csr_array((values.ravel(), indices.ravel(), starts), shape=(len(indices),) * 2)
            return ((directed + directed.T) / 2).tocsr()

        weights = symmetric(np.exp(-squared / squared.max()))
        return cls(symmetric(np.ones_like(squared)), weights, float(np.median(squared.mean(axis=1))))


def high_pass_strength(points: NDArray[np.float64], graph: NeighbourGraph) -> NDArray[np.float64]:
    """Return the squared distance of each point, (N, 3) in the graph's order, to the weighted mean of its neighbours.

    That is the squared response to the high-pass filter I - D^-1 W, with W the weights and D their sums.
    """
    smoothed = (graph.weights @ points) / graph.weights.sum(axis=1)[:, None]
    return ((points - smoothed) ** 2).sum(axis=1)


@dataclass(frozen=True)
class Programme:
    r"""The least of sum_i f_i (s_i - 1)^2 + uniformity \|A s - alpha k\|^2 over 0 <= s <= 1 with sum s = M.

    The first term is paid for features that are lost; the second where a neighbourhood of k points keeps more or
    fewer than alpha k of them, alpha = M / N.

    Attributes
    ----------
    strength : (N,) array, float64
        f, not negative.
    adjacency : (N, N) sparse array, float64
        A, symmetric and not negative, with a positive entry in each row.
    neighbours : int
        k.
    uniformity : float
        Positive.
    n_points : int
        M, from 1 to N - 1.
    """

    strength: NDArray[np.float64]
    adjacency: scipy.sparse.csr_array
    neighbours: int
    uniformity: float
    n_points: int

    def excess(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return A s - alpha k."""
        return self.adjacency @ s - self.n_points / len(s) * self.neighbours

    def value(self, s: NDArray[np.float64]) -> float:
        """Return what is to be made least."""
        # no dot products here and below: those of BLAS depend on the number of threads
        return float((self.strength * (s - 1) ** 2).sum() + self.uniformity * (self.excess(s) ** 2).sum())

    def gap(self, s: NDArray[np.float64], multiplier: float) -> float:
        """Return a bound on the value of a feasible s above the least: the duality gap for a multiplier of sum s = M.

        The second term is not below its tangent at s, and with that in its place each point has its own least, at v.
        """
        f = self.strength
        slope = 2 * self.uniformity * (self.adjacency @ self.excess(s)) + multiplier
        with np.errstate(over="ignore"):
            v = np.clip(1 - slope / np.maximum(2 * f, 1e-300), 0, 1)
        return float((f * (s - 1) ** 2 - f * (v - 1) ** 2 + slope * (s - v)).sum())


@dataclass(frozen=True)
class Solution:
    """How much of each point is kept.

    Attributes
    ----------
    selection : (N,) array, float64
        s, from 0 to 1; its sum is M to rounding.
    multiplier : float
        Of the constraint on the sum; its negative parts the derivatives of what is kept and what is not.
    gap : float
        The duality gap, relative to the value: so far above the least it is at most.
    iterations : int
        Steps made.
    """

    selection: NDArray[np.float64]
    multiplier: float
    gap: float
    iterations: int


def solve(programme: Programme, tolerance: float = 1e-4, iterations: int = 1000) -> Solution:
    """Solve the programme by accelerated proximal gradient steps, until its relative duality gap is small enough.

    The gradient is that of the second term; the first is separable, and goes with the constraints into the
    proximal step, which is solved exactly. So the length of the step depends on A alone, however much the
    strengths differ. The momentum starts anew where it leads uphill (Beck and Teboulle 2009; O'Donoghue and
    Candes 2015). All sums are made in one thread.
    """
    curvature = 2 * programme.uniformity * eigenvalue_bound(programme.adjacency) ** 2
    inverse = 1 / (2 * programme.strength + curvature)
    s = np.full(len(inverse), programme.n_points / len(inverse))
    ahead, momentum, multiplier = s, 1.0, 0.0
    gap, done = np.inf, 0
    while gap > tolerance and done < iterations:
        gradient = 2 * programme.uniformity * (programme.adjacency @ programme.excess(ahead))
        numerator = 2 * programme.strength + curvature * ahead - gradient
        following, multiplier = share_out(numerator, inverse, programme.n_points, multiplier)
        step = following - s
        if ((ahead - following) * step).sum() > 0:
            momentum = 1.0
        next_momentum = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = following + (momentum - 1) / next_momentum * step
        s, momentum, done = following, next_momentum, done + 1
        if done % CHECK_EVERY == 0 or done == iterations:
            gap = programme.gap(s, multiplier)
            gap = gap / programme.value(s) if gap > 0 else 0.0
    return Solution(s, multiplier, gap, done)


def eigenvalue_bound(adjacency: scipy.sparse.csr_array) -> float:
    """Bound the largest eigenvalue of a matrix that is not negative by max (A x)_i / x_i (Collatz and Wielandt)."""
    x = np.ones(adjacency.shape[0])
    for _ in range(BOUND_STEPS):
        product = adjacency @ x
        bound = float((product / x).max())
        x = product / bound
    return bound


def share_out(
    numerator: NDArray[np.float64], inverse: NDArray[np.float64], total: float, multiplier: float = 0.0
) -> tuple[NDArray[np.float64], float]:
    """Return s = clip((numerator - multiplier) * inverse, 0, 1) and the multiplier for which its sum is `total`.

    Parameters
    ----------
    numerator, inverse : (N,) arrays, float64
        The latter positive.
    total : float
        From 0 to N.
    multiplier : float
        Where to start looking, such as that of a step before.
    """
    s = np.empty_like(numerator)
    return s, _share_out(numerator, inverse, total, multiplier, s)


@nb.njit(cache=True, nogil=True, fastmath={"nsz", "contract", "reassoc"})
def _share_out(numerator, inverse, total, multiplier, s):
    """Find the multiplier by Newton's method, halving the bracket where that leaves it."""
    low, high = np.inf, -np.inf
    for i in range(len(s)):
        low, high = min(low, numerator[i] - 1 / inverse[i]), max(high, numerator[i])
    multiplier = min(max(multiplier, low), high)
    while True:
        above, slope = -total, 0.0
        for i in range(len(s)):
            share = (numerator[i] - multiplier) * inverse[i]
            slope += inverse[i] if 0.0 < share < 1.0 else 0.0
            s[i] = min(max(share, 0.0), 1.0)
            above += s[i]
        if abs(above) <= ROUNDING * len(s):
            return multiplier
        if above > 0:
            low = multiplier
        else:
            high = multiplier
        multiplier = multiplier + above / slope if slope > 0 else low
        if not low < multiplier < high:
            multiplier = low + (high - low) / 2
            if not low < multiplier < high:
                return multiplier
