import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from gppcs.methods.pc_simp.graph_filter import NeighbourGraph, Programme, eigenvalue_bound, high_pass_strength, solve
from gppcs.spatial.kdtree import KdTree


def plain_graph(points, k):
    """Adjacency, weights and feature strengths with matrices of all pairs."""
    squared = cdist(points, points, "sqeuclidean")
    np.fill_diagonal(squared, np.inf)
    near = np.zeros(squared.shape, dtype=bool)
    np.put_along_axis(near, np.argsort(squared, axis=1)[:, :k], True, axis=1)
    sigma = squared[near].max()
    adjacency, weights = (np.where(near, values, 0.0) for values in (1.0, np.exp(-squared / sigma)))
    adjacency, weights = (adjacency + adjacency.T) / 2, (weights + weights.T) / 2
    high_pass = np.eye(len(points)) - weights / weights.sum(axis=1, keepdims=True)
    return adjacency, weights, ((high_pass @ points) ** 2).sum(axis=1), np.median(squared[near].reshape(-1, k).mean(1))


def programme_of(points, n_points, uniformity=0.1, k=15):
    tree = KdTree.build(points)
    graph = NeighbourGraph.build(tree, min(k, len(points) - 1))
    strength = high_pass_strength(points[tree.order], graph) / graph.squared_spacing
    return Programme(strength, graph.adjacency, min(k, len(points) - 1), uniformity, n_points)


def plain_solution(programme):
    """The same by a general solver for smooth functions under constraints, from the formula."""
    n, alpha = len(programme.strength), programme.n_points / len(programme.strength)
    f, a, k, uniformity = programme.strength, programme.adjacency.toarray(), programme.neighbours, programme.uniformity
    hessian = 2 * (np.diag(f) + uniformity * a @ a)
    linear = -2 * (f + uniformity * alpha * k * a.sum(axis=0))
    found = minimize(
        lambda s: s @ hessian @ s / 2 + linear @ s,
        np.full(n, alpha),
        jac=lambda s: hessian @ s + linear,
        bounds=[(0, 1)] * n,
        constraints={"type": "eq", "fun": lambda s: s.sum() - programme.n_points, "jac": lambda _: np.ones(n)},
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 1000},
    )
    return found.x, found.fun + f.sum() + uniformity * n * (alpha * k) ** 2


@pytest.mark.parametrize(("n", "k"), [(2, 1), (10, 9), (40, 1), (200, 15)])
def test_graph_and_strengths_equal_the_plain_formulas(n, k):
    points = np.random.default_rng(n).random((n, 3))
    tree = KdTree.build(points)
    graph = NeighbourGraph.build(tree, k)
    adjacency, weights, strength, squared_spacing = plain_graph(points[tree.order], k)
    np.testing.assert_array_equal(graph.adjacency.toarray(), adjacency)
    np.testing.assert_allclose(graph.weights.toarray(), weights, rtol=1e-12)
    np.testing.assert_allclose(high_pass_strength(points[tree.order], graph), strength, rtol=1e-9)
    assert graph.squared_spacing == pytest.approx(squared_spacing, rel=1e-12)


@pytest.mark.parametrize("uniformity", [0.001, 0.1, 10.0])
@pytest.mark.parametrize(("n", "n_points"), [(5, 2), (30, 3), (40, 20), (60, 57)])
def test_solution_is_that_of_a_general_solver(n, n_points, uniformity):
    programme = programme_of(np.random.default_rng(n).random((n, 3)), n_points, uniformity, k=6)
    expected, least = plain_solution(programme)
    solution, gap, _ = solve(programme, 1e-11, 200_000)
    assert gap <= 1e-11
    assert programme.value(solution) == pytest.approx(least, rel=1e-7)
    np.testing.assert_allclose(solution, expected, atol=1e-4)


def test_a_far_point_does_not_spoil_the_solution():
    """Its strength is 1e20 times that of most others, and they are shared out all the same."""
    points = np.random.default_rng(0).random((200, 3)) * 1e-10
    programme = programme_of(np.r_[points, [[1.0, 1.0, 1.0]]], 50)
    solution, gap, _ = solve(programme)
    assert programme.strength.max() > 1e15 * np.median(programme.strength)
    assert gap <= 1e-4
    assert solution[np.argmax(programme.strength)] == 1
    assert ((solution > 0) & (solution < 1)).sum() > 10


@pytest.mark.parametrize("n", [2, 50, 500])
def test_the_largest_eigenvalue_is_bounded_closely(n):
    adjacency = programme_of(np.random.default_rng(n).random((n, 3)), 1).adjacency
    largest_eigenvalue = np.linalg.eigvalsh(adjacency.toarray())[-1]
    assert largest_eigenvalue * (1 - 1e-12) <= eigenvalue_bound(adjacency) <= 1.1 * largest_eigenvalue
