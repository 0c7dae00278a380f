import numpy as np
import pytest

import gppcs
from gppcs.spatial.kdtree import KdTree
from gppcs.surface import normals as module
from gppcs.surface.noise import NEIGHBOURS
from gppcs.surface.normals import estimate_normals, signs_by_votes
from shapes import noisy, odd_clouds, plate, rotation, torus


@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_signs_are_found_by_votes_of_which_some_are_wrong(wrong):
    """Points of two grids, each with its neighbours up to two steps away."""
    rng, side = np.random.default_rng(0), 30
    number = np.arange(2 * side * side).reshape(2, side, side)
    steps = [(x, y) for x in range(3) for y in range(3) if x + y]
    pairs = [(number[:, : side - x, : side - y].ravel(), number[:, x:, y:].ravel()) for x, y in steps]
    pairs = np.concatenate(pairs, axis=1)
    exact, right = rng.choice([-1, 1], number.size), np.where(rng.random(pairs.shape[1]) < wrong, -1, 1)
    pieces, signs = signs_by_votes(number.size, pairs, exact[pairs].prod(axis=0) * right * rng.random(len(right)))
    assert np.array_equal(np.unique(pieces, return_inverse=True)[1], np.repeat([0, 1], side * side))
    assert (np.abs((signs * exact).reshape(2, -1).mean(axis=1)) >= 1 - 4 * wrong).all()


def test_sheets_of_thin_blades_have_their_signs():
    fan = gppcs.sample("fan", n_points=60_000)
    assert ((estimate_normals(fan) * fan.normals()).sum(axis=1) < 0).mean() < 0.05


@pytest.mark.parametrize("thickness", [1.75, 2.0, 3.0])
@pytest.mark.parametrize("seed", range(2))
def test_both_sheets_of_a_plate_have_their_signs(thickness, seed):
    points, exact, _ = plate(8000, thickness, seed)
    assert ((estimate_normals(points) * exact).sum(axis=1) < 0).mean() < 0.06


def test_each_closed_piece_points_outward_wherever_it_lies(sphere):
    centres = np.array([[0, 0, 0], [3, 0, 0], [0, 500, 0.0]])
    sizes = np.array([1.0, 0.05, 1e-3])
    pieces = [size * sphere[k * 900 : (k + 1) * 900] + centres[k] for k, size in enumerate(sizes)]
    normals = estimate_normals(np.concatenate(pieces))
    assert ((normals * sphere[:2700]).sum(axis=1) > 0.9).all()


def test_open_pieces_point_to_the_side_that_bulges(sphere):
    bowl = sphere[sphere[:, 2] < -0.4][:3000]
    assert ((estimate_normals(bowl) * bowl).sum(axis=1) > 0).all()


def test_a_torus_and_edges_have_the_signs_of_the_surface():
    points, exact = torus(8_000, radius=1 / 3)
    assert ((estimate_normals(points) * exact).sum(axis=1) > 0.99).all()
    part = gppcs.sample("bracket", n_points=50_000)
    assert ((estimate_normals(part) * part.normals()).sum(axis=1) > 0).mean() > 0.999


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_normals_and_signs_hold_where_the_noise_is_thick(sigma, sphere):
    points = noisy(sphere, sigma)
    found = [estimate_normals(points, points[::20], k) for k in (None, NEIGHBOURS)]
    cosines = [(normals * sphere[::20]).sum(axis=1) for normals in found]
    angles = [np.degrees(np.arccos(np.abs(cosine).clip(0, 1))).mean() for cosine in cosines]
    assert angles[0] < 10
    assert angles[1] > 1.5 * angles[0]
    assert (cosines[0] > 0).mean() > 0.995
    assert (cosines[1] > 0).mean() < 0.97


def test_places_between_the_points_and_large_clouds(sphere):
    """Signs are passed on in a part of the cloud only where that is large."""
    places = np.concatenate([sphere[:500] * 1.001, sphere[500:600]])
    for normals in (estimate_normals(sphere, places), module._signed_nearby(KdTree.build(sphere), places, 18, 3_000)):
        assert ((normals * places).sum(axis=1) > 0.99).all()


def test_shift_scale_rotation_and_order_turn_the_normals_only(bracket):
    turn, plain = rotation(3), estimate_normals(bracket)
    np.testing.assert_allclose(estimate_normals(bracket + np.array([5e5, 5e6, 0])), plain, atol=1e-6)
    np.testing.assert_allclose(estimate_normals(1024 * bracket), plain, atol=1e-9)
    np.testing.assert_allclose(estimate_normals(bracket[::-1])[::-1], plain, atol=1e-6)
    assert ((estimate_normals(bracket @ turn) * (plain @ turn)).sum(axis=1) > 1 - 1e-6).mean() > 0.999


@pytest.mark.parametrize("points", odd_clouds().values(), ids=odd_clouds())
def test_any_cloud_has_unit_normals(points):
    normals = estimate_normals(points)
    assert normals.shape == points.shape
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


def test_what_cannot_be_estimated_is_refused():
    with pytest.raises(gppcs.InputError, match="the cloud is empty"):
        estimate_normals(np.empty((0, 3)))
    with pytest.raises(gppcs.InputError, match="finite coordinates in the cloud of places, found 1 points"):
        estimate_normals([[0, 0, 0]], at=[[0, 0, np.nan]])
    for far in (1e100, 1e308, -1e308, 1e9):
        with pytest.raises(
            gppcs.InputError, match=r"found 1 that are farther from it than 1e\+06 times its size.*index 1"
        ):
            estimate_normals([[0, 0, 0], [1, 0, 0], [0, 1, 0]], at=[[0, 0, 0], [0, far, 0]])
    for neighbours in (2, 31.0):
        with pytest.raises(gppcs.ParameterError, match=f"whole number from 3 on, found {neighbours}"):
            estimate_normals([[0, 0, 0]], neighbours=neighbours)


@pytest.mark.parametrize("distance", [1e2, 1e4, 9e5])
@pytest.mark.parametrize("unit", [1e-200, 1.0, 1e200])
def test_places_off_the_surface_have_unit_normals(sphere, distance, unit):
    places = np.concatenate([sphere[:50], distance * sphere[50:100], [[0, 0, distance]]])
    normals = estimate_normals(unit * sphere[:2000], unit * places)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize("method", [gppcs.WLOP(snap=False), gppcs.Voxel(keep="mean")], ids=["wlop", "voxel"])
def test_points_that_are_moved_have_the_normals_of_their_new_place(method, sphere):
    centre = np.array([1e3, 0, 0])
    cloud = gppcs.simplify(sphere[:5000] + centre, n_points=300, method=method, normals=True).cloud
    outward = cloud.points - centre
    assert ((cloud.normals() * outward).sum(axis=1) > 0.99 * np.linalg.norm(outward, axis=1)).all()
