"""Several methods side by side."""

import numpy as np
import pytest

import gppcs
from meshes import hull_mesh


def test_entries_are_what_simplify_and_evaluate_give(bracket):
    entries = gppcs.compare(bracket, ["fps", gppcs.Random(seed=5)], ratio=0.02)
    assert [entry.result.method for entry in entries] == [gppcs.FarthestPoint(), gppcs.Random(seed=5)]
    for entry in entries:
        expected = gppcs.simplify(bracket, ratio=0.02, method=entry.result.method)
        np.testing.assert_array_equal(entry.result.indices, expected.indices)
        assert entry.report == gppcs.evaluate(bracket, expected.cloud)
        assert entry.seconds > 0
        assert entry.failure is None


def test_all_methods_by_default():
    entries = gppcs.compare(gppcs.sample("bracket", 300), n_points=30)
    assert [entry.result.method.name for entry in entries] == list(gppcs.METHODS)


def test_a_surface_that_cannot_be_rebuilt_costs_no_other_figure(sphere):
    pytest.importorskip("pymeshlab")
    few, enough = (gppcs.compare(sphere, ["random"], n_points=n, mesh=hull_mesh(sphere[:500]))[0] for n in (2, 500))
    assert few.report.rebuilt is None
    assert "gave no surface" in few.failure
    assert few.report == gppcs.evaluate(sphere, few.result.cloud)
    assert enough.report.rebuilt.hausdorff_mean > 0
    assert enough.failure is None


def test_what_cannot_be_compared_is_refused(sphere):
    with pytest.raises(gppcs.ParameterError, match="no method 'fsp'"):
        gppcs.compare(sphere, ["fsp"], ratio=0.1)
    with pytest.raises(gppcs.ParameterError, match="found neither"):
        gppcs.compare(sphere, ["fps"])
    with pytest.raises(gppcs.InputError, match="empty"):
        gppcs.compare(np.empty((0, 3)), ["fps"], ratio=0.1)
