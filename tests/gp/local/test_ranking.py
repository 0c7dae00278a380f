from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.gp.local.algorithm import Candidates, Criterion, local_field
from gppcs.gp.local.density import graded
from gppcs.gp.local.settings import NUGGET
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.surface_variation import Features


def criterion(**changes):
    return replace(Criterion(1.0, 1.4, 0.03, 1.5, 4, 8.0), **changes)


def test_points_on_a_curve_are_spread_over_all_of_it():
    """Discs around dense points of a line cover next to nothing: by that area, all places were alike."""
    rng = np.random.default_rng(0)
    line = np.sort(rng.random(50_000))
    places = np.sort(line[gppcs.simplify(np.outer(line, [1.0, 0, 0]), n_points=20).indices])
    assert np.diff(places, prepend=0, append=1).max() < 0.1


def field_by(variation, **changes):
    rng = np.random.default_rng(0)
    n = len(variation)
    tree = KdTree.build(rng.random((n, 3)))
    normals = rng.standard_normal((n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    features = Features(variation, normals, np.full(n, 9, dtype=np.int32))
    candidates = Candidates(np.arange(n), None, np.arange(float(n)), None, None)
    field, _ = local_field(tree, features, candidates, criterion(**changes))
    return tree, features, field


@given(st.integers(2, 200), st.floats(0, 2.0), st.integers(0, 999))
def test_the_field_is_denser_where_it_is_rougher(n, power, seed):
    variation = np.random.default_rng(seed).random(n) / 3
    tree, features, field = field_by(variation, density_power=power)
    assert np.mean(field.spacings**-2) == pytest.approx(1)  # as many points as wanted on the whole
    roughness = np.sqrt(variation)
    clipped = np.minimum(roughness, 0.29)
    alike = clipped.max() - clipped.min() < 1e-12
    segregation = 0.0 if alike else clipped.var() / (clipped.mean() * (0.29 - clipped.mean()))
    density = np.maximum(roughness, 0.05) ** (power * (1 - segregation**2) ** 4)
    expected = graded(tree, np.sqrt(density.mean() / density), 0.1)
    np.testing.assert_allclose(field.spacings / field.spacings[0], expected / expected[0], rtol=1e-9)
    assert field.normal_weight == pytest.approx(1.4 * (1 - segregation**2) ** 4)
    assert np.mean(field.y) == pytest.approx(0, abs=1e-9)
    assert np.std(field.y) == pytest.approx(1)
    assert np.corrcoef(field.y, variation)[0, 1] == pytest.approx(1)
    np.testing.assert_array_equal(field.normals.T, features.normals)
    np.testing.assert_allclose(field.noise, NUGGET + np.arange(n), rtol=1e-12)


@pytest.mark.parametrize("variation", [np.zeros(20), np.full(20, 0.2), 1e-16 * np.random.default_rng(0).random(20)])
def test_a_cloud_alike_everywhere_has_one_spacing_and_no_error(variation):
    """Its surface variation differs by rounding alone."""
    _, _, field = field_by(variation)
    np.testing.assert_allclose(field.spacings, 1, rtol=1e-12)
    np.testing.assert_array_equal(field.y, 0)
