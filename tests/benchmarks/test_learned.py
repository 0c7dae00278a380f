"""The learned methods: any number of points, where they move, and what is refused."""

import numpy as np
import pytest

import gppcs
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs_learned import APES, APESGlobal, Potamias
from gppcs_learned.weights import NEIGHBOURS

LEARNED = [APES(), APESGlobal(), Potamias()]
CLOUD = gppcs.sample("bracket", 1500).points


@pytest.mark.parametrize("method", LEARNED, ids=str)
def test_any_number_of_points_is_kept(method):
    for count in (1, 17, 200, 900, 1499):
        kept = gppcs.simplify(CLOUD, n_points=count, method=method).indices
        assert len(set(kept.tolist())) == count


def test_potamias_moves_points_within_their_neighbourhood():
    snapped, moved = (gppcs.simplify(CLOUD, n_points=300, method=Potamias(snap=snap)).cloud for snap in (True, False))
    assert np.isin(snapped.points, CLOUD).all()
    away = np.linalg.norm(moved.points - snapped.points, axis=1)
    assert 0 < np.median(away) < np.sqrt(nearest_others(KdTree.build(CLOUD), NEIGHBOURS)[1][:, -1]).mean()


@pytest.mark.parametrize("method", LEARNED, ids=str)
def test_too_few_points_are_refused(method):
    rng = np.random.default_rng(0)
    with pytest.raises(
        gppcs.InputError, match=r"looks at the 16 nearest .* needs at least 17 different points, found 16"
    ):
        gppcs.simplify(rng.random((16, 3)), n_points=5, method=method)
    assert len(gppcs.simplify(rng.random((17, 3)), n_points=5, method=method).indices) == 5
