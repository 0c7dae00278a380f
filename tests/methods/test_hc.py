import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.methods.hc.clustering import hierarchical_clusters


def spread(members):
    """Centroid, principal axis and surface variation by LAPACK."""
    centroid = members.mean(axis=0)
    values, vectors = np.linalg.eigh((members - centroid).T @ (members - centroid))
    variation = values[0] / values.sum() if values.sum() > 0 else 0.0
    return centroid, vectors[:, 2], variation if variation > 1e-12 else 0.0


def parted(points, members):
    centroid, axis, _ = spread(points[members])
    negative = (points[members] - centroid) @ axis < 0
    return [members[negative], members[~negative]]


def plain_clusters(points, size, variation):
    pending, closed = [np.arange(len(points))], []
    while pending:
        members = pending.pop()
        sides = parted(points, members)
        if (len(members) > size or spread(points[members])[2] > variation) and len(sides[0]) and len(sides[1]):
            pending += sides
        else:
            closed.append(members)
    return closed


def plain_best_first(points, n_points):
    clusters = [np.arange(len(points))]
    while len(clusters) < n_points:
        ranks = [(-len(c) * spread(points[c])[2], -len(c), c[0]) if len(c) > 1 else (1,) for c in clusters]
        clusters += parted(points, clusters.pop(ranks.index(min(ranks))))
    return clusters


def squared_from_centroid(points, members):
    return ((points[members] - points[members].mean(axis=0)) ** 2).sum(axis=1)


def assert_central(points, clusters, indices):
    """One point of each cluster, none nearer the centroid; of two points, which are equally near, the first."""
    assert len(indices) == len(clusters) == len(np.unique(indices))
    chosen = np.isin(np.arange(len(points)), indices)
    for members in clusters:
        assert chosen[members].sum() == 1
        squared = squared_from_centroid(points, members)
        assert squared[chosen[members]] <= squared.min() * (1 + 1e-9)


@given(st.integers(1, 200), st.integers(1, 50), st.floats(0.001, 0.3), st.integers(0, 99))
def test_limits_give_the_clusters_of_the_plain_algorithm(n, size, variation, seed):
    points = np.random.default_rng(seed).random((n, 3))
    assert_central(points, plain_clusters(points, size, variation), hierarchical_clusters(points, size, variation))


@given(st.integers(1, 120), st.integers(0, 99), st.data())
def test_most_varied_first_gives_the_clusters_of_the_plain_algorithm(n, seed, data):
    # three points have no variation, and ties among them are broken alike
    points = np.random.default_rng(seed).random((n, 3))
    n_points = data.draw(st.integers(1, n))
    assert_central(points, plain_best_first(points, n_points), hierarchical_clusters(points, maximum=n_points))


@pytest.mark.oracle
@pytest.mark.parametrize(
    ("name", "size", "variation"),
    [("bunny", 100, 0.001), ("bunny", 10, 1 / 3), ("armadillo_50k", 1000, 0.008), ("dragon", 1000, 0.01)],
)
def test_clusters_are_those_of_cgal(shared_data, name, size, variation):
    """CGAL keeps a point of each cluster; ours, but where two are equally near and its rounding decides."""
    kernel = pytest.importorskip("CGAL.CGAL_Kernel")
    from CGAL.CGAL_Point_set_3 import Point_set_3
    from CGAL.CGAL_Point_set_processing_3 import hierarchy_simplify_point_set

    points = gppcs.read(shared_data / f"{name}.ply").points
    point_set = Point_set_3()
    for x, y, z in points.tolist():
        point_set.insert(kernel.Point_3(x, y, z))
    hierarchy_simplify_point_set(point_set, size, variation)
    theirs = np.array(list(point_set.indices()))
    ours = hierarchical_clusters(points, size, variation)
    assert len(theirs) == len(ours)
    assert len(np.setdiff1d(theirs, ours)) <= 0.005 * len(ours)
    assert_central(points, plain_clusters(points, size, variation), theirs)


def test_the_dragon_gives_as_many_points_as_in_the_paper(shared_data):
    points = gppcs.read(shared_data / "dragon.ply").points
    assert len(hierarchical_clusters(points, 1000, 0.01)) == 12_544
