"""The promise of the method: less error of surface and features than even and random choices."""

from functools import cache

import pytest

import gppcs
from scans import sample

FIGURES = "surface_mean", "feature_error"


@cache
def original(name):
    return sample(name, n_points=30_000)


def errors(name, method, ratio):
    kept = gppcs.simplify(original(name), ratio=ratio, method=method).cloud
    report = gppcs.evaluate(original(name), kept)
    return [getattr(report, figure) for figure in FIGURES]


@pytest.mark.parametrize("ratio", [0.01, 0.03, 0.1])
@pytest.mark.parametrize("name", ["bracket", "medallion", "statue"])
def test_gp_has_less_error_of_surface_and_features(name, ratio):
    of_gp = errors(name, "gp", ratio)
    for method in ("fps", "voxel", "random"):
        for figure, error, other in zip(FIGURES, of_gp, errors(name, method, ratio), strict=True):
            assert error < other, (method, figure)
