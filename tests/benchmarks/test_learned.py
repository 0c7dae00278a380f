"""The learned methods: the training set, the networks in NumPy beside PyTorch, the choice, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

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


@pytest.mark.parametrize(("kind", "count"), [("gears", 17), ("glasses", 2048), ("aircraft", 100_000)])
def test_any_number_of_points_lies_on_the_surface_of_a_shape(training_set, kind, count):
    """A step along the normal leaves all parts, a step against it enters one, but for points at concave edges."""
    number = list(training_set.KINDS).index(kind)
    rng = np.random.default_rng((number, 5))
    parts = training_set.KINDS[kind](rng.uniform, rng)
    points, normals = training_set.draw(number, 5, count, upright=True)
    assert len(np.unique(points, axis=0)) == count
    assert training_set.draw(number, 5, count, upright=True)[0].tobytes() == points.tobytes()
    outside, inside = (
        np.any([part.holds(points + step * normals) for part in parts], axis=0) for step in (1e-6, -1e-6)
    )
    assert outside.mean() < 1e-4
    assert inside.mean() > 1 - 1e-4


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


def plain_farthest(points, count):
    nearest, chosen = ((points - points.mean(axis=0)) ** 2).sum(axis=1), []
    for _ in range(count):
        chosen.append(int(nearest.argmax()))
        squared = ((points - points[chosen[-1]]) ** 2).sum(axis=1)
        nearest = squared if len(chosen) == 1 else np.minimum(nearest, squared)
    return chosen


def test_farthest_latent_points_of_one_part_equal_plain_ones():
    points = np.random.default_rng(0).random((500, 11)).astype(np.float32)
    assert latent.farthest(points, 100).tolist() == plain_farthest(points, 100)


def test_farthest_latent_points_of_parts_cover_as_plain_ones_do(on_threads):
    """Parts differ in extent: with equally many points from each, the radius would be 1.77 times as large."""
    tree = KdTree.build(np.random.default_rng(0).random((10_000, 3)) ** 3)
    points = np.ascontiguousarray(tree.points.T, dtype=np.float32)
    one, *several = on_threads(lambda: latent.farthest(points, 1000).tolist())
    assert all(chosen == one for chosen in several)
    assert len(one) == len(set(one)) == 1000
    radius, plain = (cKDTree(points[c]).query(points)[0].max() for c in (one, plain_farthest(points, 1000)))
    assert radius <= 1.15 * plain


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
