"""The topology of meshes, against shapes whose topology is known."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from shapes import ball, sheet


def grid_torus(n=6, m=5):
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))

    def at(a, b):
        return a % n * m + b % m

    return np.concatenate(
        [np.column_stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)]),
         np.column_stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)])]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("faces", "expected"),
    [
        (ball(40)[2], (0, 0, 0, 1, 0)),
        (sheet(100)[2], (0, 0, 1, 1, 0)),
        (sheet(400, hole=0.2)[2], (0, 0, 2, 1, 0)),
        (grid_torus(), (0, 0, 0, 1, 1)),
        (np.concatenate([grid_torus(), ball(40)[2] + 100]), (0, 0, 0, 2, 1)),
        (np.array([[0, 1, 2], [0, 3, 4]]), (0, 1, 2 - 1, 1, None)),  # a bow-tie; its borders meet
        (np.array([[0, 1, 2], [0, 1, 3]]), (1, 0, 1, 1, None)),  # not oriented alike
        (np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]), (1, 0, 1, 1, None)),  # three triangles at an edge
    ],
)
def test_known_topologies(faces, expected):
    assert topology_of(faces) == expected
    assert topology_of(np.random.default_rng(0).permutation(10_000)[faces]) == expected
