from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.methods.voxel.grid import cell_edge, occupied, representatives


def edge_for(points, n_points):
    return cell_edge(points.max(), n_points, partial(occupied, points))


def members_of_cells(points, edge):
    cells = defaultdict(list)
    for index, point in enumerate(points):
        cells[tuple(np.floor(point / edge))].append(index)
    return list(cells.values())


@given(st.integers(1, 300), st.floats(0.01, 2.0), st.booleans(), st.integers(0, 99))
def test_representatives_are_nearest_the_means_of_their_cells(n, edge, on_lattice, seed):
    rng = np.random.default_rng(seed)
    points = rng.permutation(np.indices((7, 7, 7)).reshape(3, -1).T / 8)[:n] if on_lattice else rng.random((n, 3))
    indices, means = representatives(points, edge)
    of_cells = members_of_cells(points, edge)
    assert occupied(points, edge) == len(of_cells) == len(indices)
    for members in of_cells:
        (position,) = np.flatnonzero(np.isin(indices, members))
        np.testing.assert_allclose(means[position], points[members].mean(axis=0), rtol=1e-13)
        distances = np.linalg.norm(points[members] - means[position], axis=1)
        assert np.linalg.norm(points[indices[position]] - means[position]) <= (1 + 1e-8) * distances.min()


@pytest.mark.parametrize("n_points", [1, 10, 500, 7_001, 39_999])
def test_the_edge_gives_hardly_more_cells_than_asked_for(sphere, n_points):
    points = sphere - sphere.min(axis=0)
    count = occupied(points, edge_for(points, n_points))
    assert n_points <= count <= 1.01 * n_points + 8


@pytest.mark.parametrize("keep", ["nearest", "mean"])
def test_each_point_lies_in_a_cell_of_its_own(bracket, keep):
    points = bracket - bracket.min(axis=0)
    edge = edge_for(points, 1_000)
    selection = gppcs.Voxel(keep=keep)(gppcs.Task(points, 1_000))
    assert set(selection.indices) <= set(representatives(points, edge)[0])
    assert (np.diff(selection.indices) > 0).all()
    kept = points[selection.indices] if selection.points is None else selection.points
    assert len(set(map(tuple, np.floor(kept / edge)))) == 1_000
    assert occupied(points, edge) > 1_000  # so that some had to go


def best_of_cells(points, edge, worth, axes):
    best = {}
    for point, value in zip(points, worth, strict=True):
        cell = tuple(np.floor(point[:axes] / edge))
        best[cell] = max(value, best.get(cell, value))
    return best


@pytest.mark.parametrize(
    ("keep", "sign", "axes"), [("highest", 1, 2), ("lowest", -1, 2), ("most", 1, 3), ("least", -1, 3)]
)
@given(seed=st.integers(0, 99), edge=st.floats(0.05, 1.0))
def test_the_extreme_point_of_each_cell_is_kept(keep, sign, axes, seed, edge):
    rng = np.random.default_rng(seed)
    points = np.concatenate([np.zeros((1, 3)), rng.random((200, 3))])  # so that cells begin at the origin
    worth = np.where(rng.random(201) < 0.1, np.nan, rng.integers(0, 9, 201))  # with ties, and values that are missing
    cloud = gppcs.PointCloud(points, {"worth": worth})
    method = gppcs.Voxel(keep=keep, attribute="worth" if axes == 3 else None)
    kept = gppcs.simplify(cloud, spacing=edge, method=method).indices
    expected = sign * np.where(np.isnan(worth), -sign * 99, worth) if axes == 3 else sign * points[:, 2]
    best = best_of_cells(points, edge, expected, axes)
    assert best_of_cells(points[kept], edge, expected[kept], axes) == best
    assert len(kept) == len(best)


@pytest.mark.parametrize("keep", ["nearest", "lowest"])
def test_cells_with_few_points_keep_none(tmp_path, keep):
    points = np.random.default_rng(0).random((3_000, 3))
    points[:, 2] *= 0.01
    points[:500] += [5, 0, 0]  # sparse there
    points[:500] *= [3, 1, 1]
    method = gppcs.Voxel(keep=keep, min_points=5)
    cells = members_of_cells((points - points.min(axis=0)) * ([1, 1, 0] if keep == "lowest" else [1, 1, 1]), 0.1)
    kept = gppcs.simplify(points, spacing=0.1, method=method).indices
    assert sum(len(members) >= 5 for members in cells) == len(kept) < len(cells)
    assert all(np.isin(kept, members).sum() == (len(members) >= 5) for members in cells)
    assert len(gppcs.simplify(points, n_points=100, method=method).indices) == 100
    with pytest.raises(gppcs.InputError, match="expected 2,000 cells with enough points"):
        gppcs.simplify(points, n_points=2_000, method=method)
    with pytest.raises(gppcs.InputError, match="found none; lower min_points"):
        gppcs.simplify(points, spacing=1e-6, max_gap=1.0, method=method)
    gppcs.write(tmp_path / "a.npy", points)
    on_disk = gppcs.simplify(tmp_path / "a.npy", spacing=0.1, method=method, workers=ThreadPoolExecutor(1))
    assert len(on_disk.indices) == len(kept)


def test_too_few_columns_are_told():
    points = np.random.default_rng(0).random((100, 3)) * [1, 0, 1]
    points[:, 0] = np.floor(10 * points[:, 0])
    with pytest.raises(gppcs.InputError, match=r"at 20 or more different places in x and y, found 10; ask for fewer$"):
        gppcs.simplify(points, n_points=20, method=gppcs.Voxel(keep="highest"))
    assert len(gppcs.simplify(points, n_points=10, method=gppcs.Voxel(keep="highest")).indices) == 10
