import numpy as np
import pytest

import gppcs
from gppcs.gp.spectral.laplacian import Eigenfunctions, eigenpairs, local_triangles, surface_laplacian
from gppcs.spatial.farthest_points import farthest_points

DEGREES = np.repeat(np.arange(5), 2 * np.arange(5) + 1)  # l of the 25 lowest eigenfunctions of a sphere


def sphere_ratios(eigenvalues):
    """Eigenvalues of a sphere of unit area over l (l + 1), beyond the first."""
    return eigenvalues[1:25] / (4 * np.pi) / (DEGREES * (DEGREES + 1))[1:]


def test_sphere_spectrum_through_landmarks(sphere):
    eigenvalues, _ = eigenpairs(sphere, 25, farthest_points(sphere, 4_000)[0])
    assert eigenvalues[0] == pytest.approx(0, abs=1e-8)
    np.testing.assert_allclose(sphere_ratios(eigenvalues), 1, atol=0.03)


@pytest.mark.parametrize("n", [4_000, 20_000])
def test_the_area_is_that_of_the_sphere(sphere, n):
    points = sphere[:n]
    _, areas = surface_laplacian(points, local_triangles(points))
    assert areas.sum() == pytest.approx(4 * np.pi, rel=0.01)


def test_eigenvalues_depend_neither_on_the_origin_nor_on_half_a_turn(sphere):
    points = sphere[:4_000]
    eigenvalues = eigenpairs(points, 25)[0][1:]
    np.testing.assert_allclose(eigenvalues / (4 * np.pi), (DEGREES * (DEGREES + 1))[1:], rtol=0.04)
    for moved in (points + np.array([10.0, -3.0, 100.0]), points * [-1.0, -1.0, 1.0]):
        np.testing.assert_allclose(eigenpairs(moved, 25)[0][1:], eigenvalues, rtol=1e-9)


def test_full_solution_is_orthonormal(sphere):
    points = sphere[:3_000]
    _, mass = surface_laplacian(points, local_triangles(points))
    functions = eigenpairs(points, 20)[1].at(points)
    np.testing.assert_allclose(functions.T @ (functions * (mass / mass.sum())[:, None]), np.eye(20), atol=1e-9)


def test_lifted_functions_are_the_spheres_harmonics(sphere):
    """Every point's value is within 3 % of the best combination of harmonics of degree up to four."""
    x, y, z = sphere.T
    powers = [x**a * y**b * z**c for a in range(5) for b in range(5 - a) for c in range(5 - a - b)]
    harmonics = np.stack(powers, axis=1)
    lifted = eigenpairs(sphere, 16, farthest_points(sphere, 4_000)[0])[1].at(sphere)
    fitted = harmonics @ np.linalg.lstsq(harmonics, lifted, rcond=None)[0]
    assert np.sqrt(((lifted - fitted) ** 2).mean(axis=0)).max() < 0.03
    np.testing.assert_allclose((lifted**2).mean(axis=0), 1, atol=0.05)


def test_repeats_have_the_values_of_their_points(sphere):
    points = sphere[:2_000]
    expected, functions = eigenpairs(points, 4)
    repeated = np.vstack([points, points[:500]])
    eigenvalues, lifted = eigenpairs(repeated, 4)
    np.testing.assert_allclose(eigenvalues, expected, atol=1e-9)
    np.testing.assert_allclose(abs(lifted.at(repeated)), abs(functions.at(repeated)), atol=1e-6)


def test_a_line_of_points_beside_a_surface_has_the_values_of_its_end(sphere):
    """No triangle joins these points, so the surface alone has eigenfunctions."""
    line = np.linspace(3, 5, 40)[:, None] * [0.0, 0.0, 1.0]
    points = np.vstack([sphere[:2_000], line])
    eigenvalues, functions = eigenpairs(points, 4)
    np.testing.assert_allclose(eigenvalues, eigenpairs(sphere[:2_000], 4)[0], atol=1e-6)
    assert np.isfinite(functions.at(points)).all()


def test_fans_of_a_flat_grid_agree_wherever_it_lies():
    points = np.indices((30, 20, 1)).reshape(3, -1).T / 30.0
    expected = np.sort([(i / 29) ** 2 + (j / 19) ** 2 for i in range(4) for j in range(4)])[1:7] * np.pi**2 * 29 * 19
    for moved in (points, points + 10.0):
        np.testing.assert_allclose(eigenpairs(moved, 7)[0][1:], expected, rtol=0.01)


def test_points_on_a_line_have_the_eigenvalues_of_a_path():
    points = np.linspace(0, 1, 300)[:, None] * [1.0, 2.0, 3.0]
    eigenvalues, functions = eigenpairs(points, 4)
    np.testing.assert_allclose(eigenvalues[1:] / eigenvalues[1], [1, 4, 9], rtol=0.02)
    assert functions.at(points).shape == (300, 4)


@pytest.mark.parametrize("distance", [1e6, 1e9, 1e12])
def test_clusters_far_from_each_other_have_finite_eigenpairs(distance):
    for seed in range(6):
        points = np.random.default_rng(seed).random((50, 3))
        points[25:] += distance
        eigenvalues, functions = eigenpairs(points, 20)
        assert np.isfinite(eigenvalues).all()
        assert np.isfinite(functions.at(points)).all()


def test_lifting_from_landmarks_stays_near_the_full_solution():
    """The kernel of the lifted eigenpairs differs from that of the full ones by a few percent."""
    points = gppcs.sample("fan", n_points=9_000).points

    def heat_kernel(pairs):
        eigenvalues, functions = pairs[0], pairs[1].at(points)
        return (functions * np.exp(-0.01 * eigenvalues)) @ functions[:300].T

    full = heat_kernel(eigenpairs(points, 20))
    lifted = heat_kernel(eigenpairs(points, 20, farthest_points(points, 4_000)[0]))
    assert np.linalg.norm(lifted - full) < 0.1 * np.linalg.norm(full)


def test_landmarks_that_are_all_equally_far_have_the_same_weight():
    corners = np.indices((2, 2, 2)).reshape(3, -1).T + 0.0
    np.testing.assert_allclose(Eigenfunctions(corners, corners, 8).at(np.full((1, 3), 0.5)), 0.5, rtol=1e-9)
