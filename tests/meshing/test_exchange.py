"""An exchange lowers the energy, and keeps the number of vertices and the topology."""

import numpy as np
import pytest

from gppcs.clouds.topology import topology_of
from gppcs.meshing.exchange import exchange
from meshes import energy, fitted_mesh
from shapes import ball, faults, sheet

THIN_COST = 1e-4


@pytest.mark.parametrize("shape", [ball, sheet])
def test_an_exchange_lowers_the_energy_with_as_many_vertices(shape):
    points, _, faces = shape(120)
    dense, normals, _ = shape(4000, seed=1)
    fitted, dense_index = fitted_mesh(points, faces, dense, normals), np.arange(120)
    before, topology, faces = energy(fitted, THIN_COST), topology_of(fitted.mesh.faces()), len(fitted.mesh.faces())
    exchange(fitted, dense_index, THIN_COST)
    assert energy(fitted, THIN_COST) < 0.8 * before
    assert np.count_nonzero(fitted.mesh.leaving >= 0) == len(np.unique(dense_index)) == 120
    assert len(fitted.mesh.faces()) == faces
    assert topology_of(fitted.mesh.faces()) == topology
    assert faults(fitted.mesh) == []
