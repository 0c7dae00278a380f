"""Golden indices: what each method chooses of clouds that stay the same.

A change of numerics changes hashes. `python tests/golden/test_indices.py` writes the table anew; look at the tables of
quality before you commit it.
"""

import hashlib
import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import gppcs
from scans import sample

TABLE = Path(__file__).with_name("indices.json")
DATA = Path(os.environ.get("GPPCS_DATA", Path(__file__).parents[3] / "shared" / "data"))
SAMPLES = {
    "bracket": {"n_points": 12_000},
    "medallion": {"n_points": 12_000, "noise": 0.0005},
    "fan": {"n_points": 12_000},
    "statue": {"n_points": 12_000, "uneven": 0.9},
    "sphere": {"n_points": 12_000, "noise": 0.003},
    "room": {"n_points": 12_000},
    "street": {"n_points": 12_000},
    "terrain": {"n_points": 12_000, "outliers": 0.02},
}
SCANS = ("bunny", "anchor_dense", "lion_takanawa", "nyu_basement")
METHODS = ("gp", "gp-spectral", "fps", "voxel", "hc", "qem")


@cache
def cloud_of(name):
    """A sample, or at most 20,000 points of a real scan."""
    if name in SAMPLES:
        return sample(name, **SAMPLES[name])
    points = gppcs.read(DATA / f"{name}.ply").points
    return gppcs.PointCloud(points[:: max(1, len(points) // 20_000)])


def digest(indices):
    return hashlib.sha256(np.ascontiguousarray(indices, dtype="<i8").tobytes()).hexdigest()[:16]


def in_memory(name, method):
    return digest(gppcs.simplify(cloud_of(name), ratio=0.05, method=method).indices)


def blas():
    """The processor for which BLAS was chosen: eigenvectors, so "gp-spectral", differ in their last digits."""
    np.linalg.eigh(np.eye(2))
    return next((library["architecture"] for library in threadpool_info() if "architecture" in library), "unknown")


def cases():
    return [(name, method) for name in (*SAMPLES, *SCANS) for method in METHODS]


@pytest.mark.parametrize(("name", "method"), cases())
def test_a_method_chooses_what_it_chose(name, method):
    golden = json.loads(TABLE.read_text())
    if name in SCANS and not DATA.is_dir():
        pytest.skip(f"no real clouds at {DATA}; set GPPCS_DATA to their folder")
    if method == "gp-spectral" and blas() != golden["blas"]:
        pytest.skip(f"its hashes were made with BLAS for {golden['blas']}, this is {blas()}")
    assert in_memory(name, method) == golden[name][method]


if __name__ == "__main__":
    table = {"blas": blas()}
    for name, method in cases():
        table.setdefault(name, {})[method] = in_memory(name, method)
    TABLE.write_text(json.dumps(table, indent=2) + "\n")
