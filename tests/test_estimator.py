"""gppcs in scikit-learn."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

import gppcs
from gppcs.estimator import Simplifier

pytest.importorskip("sklearn")
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

# scikit-learn asks transformers for the same rows, one by one, which simplification does not give. Each has to fail.
OTHER_ROWS = dict.fromkeys(
    (
        "check_transformer_data_not_an_array",
        "check_transformer_general",
        "check_methods_sample_order_invariance",
        "check_methods_subset_invariance",
    ),
    "fewer rows come out than go in",
)


@parametrize_with_checks([Simplifier(n_points=10)], expected_failed_checks=lambda _: OTHER_ROWS)
def test_the_checks_of_scikit_learn_pass(estimator, check):
    check(estimator)


@pytest.fixture
def table(bracket):
    """Points with two more columns."""
    return np.column_stack([bracket, np.arange(len(bracket)), np.ones(len(bracket))])


def test_rows_are_those_of_simplify_and_other_columns_go_along(table, bracket):
    simplifier = Simplifier(ratio=0.02).fit(table)
    expected = gppcs.simplify(bracket, ratio=0.02).indices
    np.testing.assert_array_equal(simplifier.indices_, expected)
    np.testing.assert_array_equal(simplifier.transform(table), table[expected])
    np.testing.assert_array_equal(simplifier.transform(table.astype(np.float32)).dtype, np.float32)


def test_moved_points_get_new_coordinates(table, bracket):
    method = gppcs.Voxel(keep="mean")
    kept = Simplifier(n_points=50, method=method).fit_transform(table)
    np.testing.assert_array_equal(kept[:, :3], gppcs.simplify(bracket, n_points=50, method=method).cloud.points)
    assert len(np.unique(kept[:, 3])) == 50


def test_it_works_in_a_pipeline_and_can_be_cloned_and_pickled(table):
    pipeline = make_pipeline(Simplifier(n_points=100, method=gppcs.Random(seed=3)), StandardScaler())
    scaled = pipeline.fit_transform(table)
    np.testing.assert_allclose(scaled[:, :3].mean(axis=0), 0, atol=1e-12)
    assert len(scaled) == 100
    for copy in (clone(pipeline), pickle.loads(pickle.dumps(pipeline))):
        np.testing.assert_array_equal(copy.set_params(simplifier__n_points=10).fit_transform(table).shape, (10, 5))


@pytest.mark.parametrize(
    ("asked", "error"),
    [({}, "ratio"), ({"n_points": 0}, "whole number from 1 on, found 0"), ({"n_points": 5, "method": "best"}, "best")],
)
def test_what_is_wrong_is_told_when_it_is_used(table, asked, error):
    with pytest.raises(gppcs.ParameterError, match=error):
        Simplifier(**asked).fit(table)


def test_without_scikit_learn_the_class_says_what_is_missing():
    code = "import sys; sys.modules['sklearn'] = None; from gppcs.estimator import Simplifier; Simplifier()"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "MissingExtraError: gppcs.estimator.Simplifier needs scikit-learn" in run.stderr
