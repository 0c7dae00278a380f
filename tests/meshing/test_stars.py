"""One vertex is fitted to the points around it: its energy is what it says, and falls."""

import numpy as np
import pytest

from dense import distances_to_triangles
from gppcs.meshing.stars import add_around, empty, fit_star, room_for_star, store
from meshes import energy, fitted_mesh
from shapes import ball, faults


def refit(fitted, v, extra):
    """Fit a vertex as it stands; return its energy before and after."""
    star, here = room_for_star(len(fitted.points)), tuple(fitted.vertices[v])
    empty(star, here)
    before = add_around(fitted, star, v, -1, extra)
    after, place = fit_star(fitted, star, here, extra)
    if after < before:
        store(fitted, star, v, place, extra)
    return before, min(before, after)


@pytest.mark.parametrize("extra", [0.0, 1e-3])
def test_fits_lower_the_energy_as_they_say_and_points_are_at_their_triangles(extra):
    points, _, faces = ball(80)
    dense, normals, _ = ball(3000, seed=1)
    fitted = fitted_mesh(points, faces, dense, normals)
    for v in range(80):
        total = energy(fitted, extra)
        before, after = refit(fitted, v, extra)
        assert energy(fitted, extra) <= total + after - before + 1e-12  # a point may be nearer to another triangle
    assert energy(fitted, extra) < 0.7 * energy(fitted_mesh(points, faces, dense, normals), extra)
    assert faults(fitted.mesh) == []
    triangles = fitted.vertices[fitted.mesh.origin.reshape(-1, 3)[fitted.assigned.face]]
    s, t = fitted.assigned.weights.T
    feet = np.einsum("ij,ijk->ik", np.column_stack([1 - s - t, s, t]), triangles)
    assert ((dense - feet) ** 2).sum(axis=1) == pytest.approx(fitted.assigned.squared)
    nearest = distances_to_triangles(dense, fitted.vertices[fitted.mesh.faces()])
    assert np.quantile(np.sqrt(fitted.assigned.squared) - nearest, 0.95) < 1e-3
