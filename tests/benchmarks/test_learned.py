"""The learned methods: the training set, the networks in NumPy beside PyTorch, the choice, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import gppcs
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs_learned import APES, APESGlobal, Potamias, latent, layers
from gppcs_learned.weights import NEIGHBOURS, part

LEARNED = [APES(), APESGlobal(), Potamias()]
CLOUD = gppcs.sample("bracket", 1500).points


@pytest.fixture
def training_set(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks" / "learned")
    import training_set

    return training_set


@pytest.fixture
def train(training_set):
    pytest.importorskip("torch", reason="PyTorch is not installed")
    import train

    return train


@pytest.mark.oracle
@pytest.mark.parametrize("method", LEARNED, ids=str)
def test_numpy_equals_pytorch(method, train):
    torch = train.torch
    torch.manual_seed(1)
    points = layers.in_unit_ball(CLOUD[:600]).astype(np.float32).astype(float)
    cloud = torch.tensor(points[None], dtype=torch.float32)
    network = train.NETWORKS[method.name][0]()
    with torch.no_grad():
        for _ in range(3):  # so that the normalisations have seen something
            network(
                cloud.repeat(2, 1, 1),
                *(() if method.name != "potamias" else (train.neighbours(cloud.repeat(2, 1, 1)), 60)),
            )
        index, ours = train.neighbours(cloud), train.arrays_of(network.eval())
        rows = index[0].numpy()
        theirs = network.embedding(cloud, index)
        features = layers.embedding(part(ours, "embedding"), points, rows)
        np.testing.assert_allclose(features, theirs[0], atol=1e-5)
        if method.name == "potamias":
            kept = train.farthest(torch.cat([cloud, train.LATENT * torch.tanh(network.latent(theirs))], 2), 60)
            assert latent.farthest(latent.coordinates(ours, points, features), 60).tolist() == kept[0].tolist()
            expected = network(cloud, index, 60)[0]
            np.testing.assert_allclose(
                latent.moved(ours, points, features, rows, kept[0].numpy()), expected[0], atol=1e-5
            )
            return
        theirs = network.attentions[0](theirs, index)
        features = layers.attended(part(ours, "attentions.0"), features, rows)
        np.testing.assert_allclose(features, theirs[0], atol=1e-5)
        expected = network.downsamplings[0](theirs, index)[0][0]
        found = method._scores(part(ours, "downsamplings.0"), features, rows)
        np.testing.assert_allclose(found, expected, atol=1e-5)


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
