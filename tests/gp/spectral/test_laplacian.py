import numpy as np
import pytest

import gppcs
from gppcs.gp.spectral import laplacian
from gppcs.gp.spectral.laplacian import eigenpairs, surface_laplacian
from gppcs.spatial.farthest_points import farthest_points

DEGREES = np.repeat(np.arange(5), 2 * np.arange(5) + 1)  # l of the 25 lowest eigenfunctions of a sphere


def sphere_ratios(eigenvalues):
    """Eigenvalues of a sphere of unit area over l (l + 1), beyond the first."""
    return eigenvalues[1:25] / (4 * np.pi) / (DEGREES * (DEGREES + 1))[1:]


def test_sphere_spectrum_through_landmarks(sphere):
    eigenvalues, _ = eigenpairs(sphere, 25)
    assert eigenvalues[0] == pytest.approx(0, abs=1e-8)
    np.testing.assert_allclose(sphere_ratios(eigenvalues), 1, atol=0.03)


@pytest.mark.slow
def test_a_laplacian_that_lost_area_is_not_used(sphere):
    _, mass, is_whole = surface_laplacian(sphere)
    assert mass.sum() < 0.75 * np.pi  # of a sphere of unit diameter
    assert not is_whole
    ratios = sphere_ratios(eigenpairs(sphere, 25, landmarks=len(sphere))[0])
    np.testing.assert_allclose(ratios, 1, atol=0.06)  # the raw spectrum is 40 % off


def test_full_solution_is_orthonormal(sphere):
    points = sphere[:3_000]
    _, mass, _ = surface_laplacian(points)
    functions = eigenpairs(points, 20)[1]
    np.testing.assert_allclose(functions.T @ (functions * (mass / mass.sum())[:, None]), np.eye(20), atol=1e-9)


def test_lifted_functions_are_the_spheres_harmonics(sphere):
    """Every point's value is within 3 % of the best combination of harmonics of degree up to four."""
    x, y, z = sphere.T
    powers = [x**a * y**b * z**c for a in range(5) for b in range(5 - a) for c in range(5 - a - b)]
    harmonics = np.stack(powers, axis=1)
    lifted = eigenpairs(sphere, 16)[1]
    fitted = harmonics @ np.linalg.lstsq(harmonics, lifted, rcond=None)[0]
    assert np.sqrt(((lifted - fitted) ** 2).mean(axis=0)).max() < 0.03
    np.testing.assert_allclose((lifted**2).mean(axis=0), 1, atol=0.05)


def test_lifting_from_landmarks_stays_near_the_full_solution():
    """The kernel of the lifted eigenpairs differs from that of the full ones by a few percent."""
    points = gppcs.sample("fan", n_points=9_000).points

    def heat_kernel(pairs):
        eigenvalues, functions = pairs
        return (functions * np.exp(-0.01 * eigenvalues)) @ functions[:300].T

    full = heat_kernel(eigenpairs(points, 20, landmarks=9_000))
    lifted = heat_kernel(eigenpairs(points, 20, landmarks=4_000))
    assert np.linalg.norm(lifted - full) < 0.1 * np.linalg.norm(full)


@pytest.mark.parametrize("distance", [10, 1_000])
def test_a_far_point_does_not_cost_the_landmarks(bracket, distance):
    points = bracket.copy()
    points[0] = points.max() * distance
    chosen, _ = farthest_points(points, 4_000)
    assert surface_laplacian(points[chosen])[2]


def test_landmarks_that_are_all_equally_far_have_the_same_weight():
    corners = np.indices((2, 2, 2)).reshape(3, -1).T + 0.0
    np.testing.assert_allclose(laplacian._lift(corners, corners, np.full((1, 3), 0.5)), 0.5, rtol=1e-9)


@pytest.mark.parametrize("distance", [1e6, 1e9, 1e12])
def test_clusters_far_from_each_other_have_finite_eigenpairs(distance):
    for seed in range(6):
        points = np.random.default_rng(seed).random((50, 3))
        points[25:] += distance
        eigenvalues, functions = eigenpairs(points, 20)
        assert np.isfinite(eigenvalues).all()
        assert np.isfinite(functions).all()
