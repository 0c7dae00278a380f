"""Golden indices: what each method, and each option of `gp`, chooses of clouds that stay the same.

A change of numerics changes hashes. `PYTHONPATH=benchmarks python tests/golden/test_indices.py` writes the table
anew; look at the tables of quality before you commit it.
"""

import hashlib
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import gppcs
from scans import sample

TABLE = Path(__file__).with_name("indices.json")
SAMPLES = {
    "bracket": {},
    "medallion": {"noise": 0.0005},
    "fan": {},
    "statue": {"uneven": 0.9},
    "sphere": {"noise": 0.003},
    "plate": {},
    "room": {},
    "avenue": {},
    "forest": {},
    "terrain": {"outliers": 0.02},
}
METHODS = ("gp", "gp-spectral", "fps", "voxel", "sample-elimination", "random", "hc", "qem")
PAINTED, LARGE = ("painted", 12_000, {}), ("painted", 36_000, {})  # of which four parts choose at once
OPTIONS = {
    "parts": (LARGE, {"ratio": 0.05}),
    "parts, detail": (LARGE, {"ratio": 0.05, "detail": "rgb"}),
    "parts, weight": (LARGE, {"ratio": 0.05, "weight": "red"}),
    "cells of some points": (("statue", 150_000, {}), {"ratio": 0.002}),  # and a survey of a sample
    "few outliers": (("bracket", 12_000, {"outliers": 0.0005}), {"ratio": 0.02}),
    "thick noise": (("sphere", 12_000, {"noise": 0.02}), {"ratio": 0.05}),
    "denoised": (("medallion", 12_000, {"noise": 0.002}), {"ratio": 0.05, "method": gppcs.LocalGP(denoise=True)}),
    "detail": (PAINTED, {"ratio": 0.05, "detail": {"rgb": 0.5, "nx": 1.0}}),
    "weight": (PAINTED, {"ratio": 0.05, "weight": "red"}),
    "keep": (PAINTED, {"ratio": 0.05, "keep": range(0, 12_000, 60)}),
    "quota": (PAINTED, {"ratio": 0.05, "quota": {"nz > 0": "80%"}}),
    "error": (PAINTED, {"ratio": 0.05, "method": gppcs.LocalGP(feature_weight=0.8)}),
    "many points": (PAINTED, {"ratio": 0.5}),
    "tolerance": (PAINTED, {"tolerance": "0.5%"}),
    "spacing": (PAINTED, {"spacing": "2%"}),
    "largest gap": (PAINTED, {"max_gap": "4%"}),
    "outliers dropped": (("terrain", 12_000, {"outliers": 0.02}), {"ratio": 0.05, "drop_outliers": True}),
}


@cache
def cloud_of(name, n_points, **flaws):
    return sample(name, n_points=n_points, **flaws)


def digest(cloud, options):
    indices = gppcs.simplify(cloud, **options).indices
    return hashlib.sha256(np.ascontiguousarray(indices, dtype="<i8").tobytes()).hexdigest()[:16]


def blas():
    """The processor for which BLAS was chosen: eigenvectors, so "gp-spectral", differ in their last digits."""
    np.linalg.eigh(np.eye(2))
    return next((library["architecture"] for library in threadpool_info() if "architecture" in library), "unknown")


def cases():
    """The name of a cloud, what is asked for, and both as arguments."""
    for name, flaws in SAMPLES.items():
        for method in METHODS:
            yield pytest.param(name, method, (name, 12_000, flaws), {"ratio": 0.05, "method": method})
    for name, (cloud, options) in OPTIONS.items():
        yield pytest.param("options of gp", name, cloud, options)


@pytest.mark.parametrize(("of", "which", "cloud", "options"), list(cases()))
def test_the_same_points_are_chosen_as_ever(of, which, cloud, options):
    golden = json.loads(TABLE.read_text())
    if which == "gp-spectral" and blas() != golden["blas"]:
        pytest.skip(f"its hashes were made with BLAS for {golden['blas']}, this is {blas()}")
    name, n_points, flaws = cloud
    assert digest(cloud_of(name, n_points, **flaws), options) == golden[of][which]


if __name__ == "__main__":
    table = {"blas": blas()}
    for of, which, (name, n_points, flaws), options in (case.values for case in cases()):
        table.setdefault(of, {})[which] = digest(cloud_of(name, n_points, **flaws), options)
    TABLE.write_text(json.dumps(table, indent=2) + "\n")
