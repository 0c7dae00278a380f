"""What pictures and pages show of the surface of any cloud."""

import numpy as np
import pytest

import gppcs
from gppcs.drawing.estimates import disc_radii, estimates, thin_on_lines

POINTS = gppcs.sample("sphere", 2000).points


def test_they_are_the_features_of_the_cloud():
    expected = gppcs.estimate_features(POINTS)
    variation, normals, *_ = estimates(POINTS)
    near = expected.neighbours >= 8
    assert near.mean() > 0.99
    assert variation[near] == pytest.approx(expected.surface_variation[near])
    assert np.abs(np.einsum("ij,ij->i", normals, expected.normals))[near] == pytest.approx(np.ones(near.sum()))


def test_sparse_parts_of_a_scan_are_measured_too():
    points = np.random.default_rng(0).random((4000, 3)) * [1, 1, 0]
    points[::10] = points[::10] * 10 + [2, 0, 0]
    variation, normals, *_ = estimates(points)
    assert (variation == 0).all()
    assert np.abs(normals[:, 2]) == pytest.approx(np.ones(4000))


def test_neighbourhoods_of_noise_reach_across_it(sphere):
    noisy = sphere[:8000] * np.random.default_rng(0).normal(1.0, 0.04, (8000, 1))
    wide, narrow = (
        np.median(np.arccos(np.abs(np.einsum("ij,ij->i", normals, sphere[:8000]))))
        for normals in (estimates(noisy)[1], gppcs.estimate_features(noisy).normals)
    )
    assert wide < 0.25 * narrow


@pytest.mark.parametrize(("exponent", "times"), [(-600, 1), (600, 1), (0, 3)])
def test_neither_the_unit_of_length_nor_repeats_make_a_difference(exponent, times):
    found = estimates(np.repeat(np.ldexp(POINTS, exponent), times, axis=0))
    for one, other in zip(found[:2], estimates(POINTS)[:2], strict=True):
        np.testing.assert_array_equal(one[::times], other)


@pytest.mark.parametrize("turn", [np.eye(3), np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]])
def test_a_plane_has_no_relief_of_rounding_errors(turn):
    plane = np.random.default_rng(0).random((30, 3)) * [1, 1, 0]
    assert (estimates(plane @ turn)[0] == 0).all()


def wires_over_plane(gap):
    """Return the points of two wires near each other and of a plane below, and which are of the wires."""
    rng = np.random.default_rng(0)
    plane = rng.random((4000, 3)) * [8, 8, 0]
    along = np.linspace(0, 8, 34)
    wires = np.vstack([np.column_stack([along, np.full(34, y), np.full(34, 6.0)]) for y in (4 - gap / 2, 4 + gap / 2)])
    return np.vstack([plane, wires]), np.arange(4068) >= 4000


@pytest.mark.parametrize("gap", [0.4, 1.6])
def test_wires_are_drawn_thin_and_planes_closed(gap):
    """Two wires near each other would be a band if their discs were as large as the gaps between points around them."""
    points, is_wire = wires_over_plane(gap)
    tree = estimates(points)[2]
    scale = np.ptp(points, axis=0).max() / np.ptp(tree.points, axis=1).max()
    radii = scale * disc_radii(tree)
    assert np.median(radii[is_wire]) < 8 / 33
    assert np.median(radii[~is_wire]) == pytest.approx(np.sqrt(6 / (np.pi * 4000 / 64)), rel=0.1)


def test_wires_of_simplified_clouds_are_those_of_the_original():
    points, is_wire = wires_over_plane(0.4)
    kept = slice(0, None, 7)
    tree = estimates(points)[2]
    radii = thin_on_lines(np.ones(len(points[kept])), tree, tree.points.T[tree.positions()][kept])
    assert np.median(radii[is_wire[kept]]) < 0.5
    assert np.mean(radii[~is_wire[kept]] == 1) > 0.95


def test_stray_points_are_drawn_no_larger_than_others():
    rng = np.random.default_rng(0)
    surface = rng.random((4000, 3)) * [8, 8, 0]
    strays = np.array([[2.0, 2, 0.4], [6, 2, 0.6], [4, 6, 0.8]])
    radii = disc_radii(estimates(np.vstack([surface, strays]))[2])
    assert radii[-3:].max() <= 1.1 * np.median(radii)
