"""`gppcs sample`."""

import json
from pathlib import Path

import gppcs


def test_samples_are_the_same_for_the_same_seed(printed):
    options = ("--points", 300, "--noise", 0.001, "--outliers", 0.1, "--uneven", 0.5)
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        assert printed("sample", "fan", "-o", f"{name}.ply", *options, "--seed", seed) == f"{name}.ply: 300 points\n"
    assert Path("a.ply").read_bytes() == Path("b.ply").read_bytes() != Path("c.ply").read_bytes()
    expected = gppcs.sample("fan", 300, noise=0.001, outliers=0.1, uneven=0.5)
    assert gppcs.read("a.ply").points.tobytes() == expected.points.tobytes()


def test_sample_json_says_what_was_made(printed):
    out = printed("sample", "fan", "-o", "a.ply", "--points", 300, "--noise", 0.001, "--json")
    options = {"noise": 0.001, "outliers": 0.0, "uneven": 0.0, "seed": 0}
    expected = {"output": "a.ply", "name": "fan", "points": 300, **options, "version": gppcs.__version__}
    assert json.loads(out) == expected
