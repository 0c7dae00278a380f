import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.methods.qem.contraction import contraction_order
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.surface.surface_variation import features_of_nearest
from shapes import KINDS


def nearest(points, members, k):
    """For each member the k nearest others, as the tree finds them where several are as near."""
    tree = KdTree.build(points[members])
    found, _ = nearest_others(tree, min(k, len(members) - 1))
    return {members[i]: list(members[tree.order[row]]) for i, row in zip(tree.order, found, strict=True)}


def planes_around(points, known):
    """Of each point the planes that its quadric starts from: a point in each, and the normal as long as the edge."""
    normals = features_of_nearest(KdTree.build(points), 1 + len(known[0])).normals
    planes = {}
    for i, others in known.items():
        edges = points[others] - points[i]
        across = np.cross(edges, np.cross(edges, normals[i]))
        lengths, edge_lengths = np.linalg.norm(across, axis=1), np.linalg.norm(edges, axis=1)
        upright = lengths <= 1e-7 * edge_lengths**2
        across[upright] = 0
        scale = edge_lengths / np.where(upright, 1, lengths)
        planes[i] = np.tile(points[i], (len(others), 1)), across * scale[:, None]
    return planes


def plain_order(points, k, costless=False):
    """The same by looking at all pairs before each contraction."""
    known = nearest(points, np.arange(len(points)), k)
    planes = planes_around(points, known)
    memory = {}

    def squared(i, j):
        return ((points[j] - points[i]) ** 2).sum()

    def cost(gone, kept):
        if (gone, kept) not in memory:
            (places, normals), (more_places, more_normals) = planes[gone], planes[kept]
            places, normals = np.r_[places, more_places], np.r_[normals, more_normals]
            value = (((points[kept] - places) * normals).sum(axis=1) ** 2).sum()
            flat = costless or value <= 1e-14 * (normals**2).sum() * squared(gone, kept)
            memory[gone, kept] = 0.0 if flat else value
        return memory[gone, kept]

    removed = []
    while len(known) > 1:
        pairs = [(min(cost(i, j), cost(j, i)), squared(i, j), i, j) for i in known for j in known[i]]
        if not pairs:
            known = nearest(points, np.array(sorted(known)), k)
            continue
        _, _, i, j = min(pairs)
        gone, kept = (j, i) if (cost(j, i), i) < (cost(i, j), j) else (i, j)
        both = {*known[i], *known[j]} - {i, j}
        planes[kept] = tuple(np.r_[ours, theirs] for ours, theirs in zip(planes[kept], planes[gone], strict=True))
        memory = {pair: value for pair, value in memory.items() if kept not in pair}
        removed.append(gone)
        del known[gone]
        for others in known.values():
            if gone in others:
                others[others.index(gone)] = kept
                if others.count(kept) > 1:
                    others.remove(kept)
        known[kept] = sorted(both, key=lambda other: (squared(kept, other), other))[:k]
    return [*known, *removed[::-1]]


@given(st.sampled_from(["solid", "sphere", "far clumps"]), st.integers(5, 40), st.integers(3, 9), st.integers(0, 99))
def test_order_is_that_of_the_plain_algorithm(shape, n, k, seed):
    """With three neighbours and more nothing is flat, where rounding would decide."""
    points = KINDS[shape](np.random.default_rng(seed), n)
    assert contraction_order(points, k).tolist() == plain_order(points, k)


@pytest.mark.parametrize("shape", ["tilted plane", "lattice in a plane", "line"])
@pytest.mark.parametrize("n", [12, 80])
def test_in_a_plane_nothing_costs_and_the_shortest_go_first(shape, n):
    """So the order is that of lengths alone, and on a lattice, where most are equal, of indices."""
    points = KINDS[shape](np.random.default_rng(0), n)
    assert contraction_order(points, 6).tolist() == plain_order(points, 6, costless=True)
