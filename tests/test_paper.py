"""Figures of the paper that are reproduced."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import gppcs

ABLATION = Path(__file__).parents[1] / "benchmarks" / "paper" / "ablation.py"


def test_ablation_table_within_two_percent(shared_data):
    specification = importlib.util.spec_from_file_location("ablation", ABLATION)
    ablation = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(ablation)
    rows = ablation.table(gppcs.read(shared_data / "bunny.ply"))
    assert len(rows) == 12
    for _name, _value, paper, ours in rows:
        assert np.median(ours) == pytest.approx(paper, rel=0.02)
