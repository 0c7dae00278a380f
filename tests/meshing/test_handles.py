"""Small false handles are cut, true ones stay."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.topology import topology_of
from shapes import drilled_plate, noisy, torus


def scan(name, n):
    """A sample with noise of a thousandth of the diagonal of the box around it."""
    points = gppcs.sample(name, n_points=n).points
    return noisy(points, 1e-3 * np.linalg.norm(np.ptp(points, axis=0)))


def test_a_noisy_relief_has_no_handle():
    result = gppcs.mesh(scan("medallion", 20_000), n_points=500)
    assert topology_of(result.mesh.faces) == (0, 0, 1, 1, 0)
    assert len(result.mesh.vertices) == 500


@pytest.mark.parametrize("n_points", [100, 500])
def test_drilled_holes_stay_though_they_are_a_few_edges_wide(n_points):
    assert gppcs.mesh(scan("bracket", 5_000), n_points=n_points).diagnostics.genus == 5


@pytest.mark.parametrize(("radius", "thickness"), [(1.0, 3), (1.2, 2), (1.2, 3)])
def test_narrow_holes_of_a_thin_plate_stay(radius, thickness):
    """In spacings of the first mesh."""
    spacing = np.sqrt(2 / (8 * 300))
    points = drilled_plate(20_000, 4, radius * spacing, thickness * spacing)
    assert topology_of(gppcs.mesh(points, n_points=300).mesh.faces) == (0, 0, 0, 1, 16)


@pytest.mark.parametrize(("radius", "n"), [(0.4, 4000), (0.06, 1000), (0.04, 1500)])
def test_a_ring_has_one_handle_though_it_is_noisy_and_a_few_spacings_thick(radius, n):
    points = noisy(torus(n, radius=radius)[0], 0.05 * radius, seed=0)
    assert gppcs.mesh(points, n_points=300).diagnostics.genus == 1
