"""The results say by which code and on which machine they were made, and by clouds that the rules were not found on."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import gppcs

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PAGES = sorted((BENCHMARKS / "results").glob("*.md"))
OF_THE_PAPER = [page for page in PAGES if page.stem.startswith("paper_") or page.stem in ("ablation", "all_points")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_tells_commit_and_machine(page):
    text = page.read_text()
    assert re.search(r"^- gppcs \S+, commit [0-9a-f]{7,}", text, re.MULTILINE)
    assert re.search(r"^- .+, \d+ threads$", text, re.MULTILINE)


@pytest.mark.parametrize("page", OF_THE_PAPER, ids=lambda page: page.stem)
def test_no_figure_of_a_page_is_typed_in(page, script):
    report = script("report.py")
    written, mark, seal = page.read_text().partition(report.SEAL)
    assert mark
    assert seal.strip() == report.seal(written)


def test_claims_are_those_of_the_pages(script):
    claims = script("paper/claims.py")
    rows = claims.rows_of("paper_claims")
    assert [tuple(row.values()) for row in rows] == [claims.row(claim) for claim in claims.CLAIMS]


@pytest.mark.parametrize("name", ["modelnet_airplane_0001_2048", "armadillo_100k_noise_1e-2"])
def test_recipes_make_the_clouds_of_the_pages(script, shared_data, monkeypatch, name):
    data = script("data.py")
    monkeypatch.setattr(data.report, "DATA", shared_data)
    (file,) = (file for file in data.FILES if file.name == name)
    made, used = file.make(), gppcs.read(file.path).points
    assert (abs(made - used).max(axis=1) < 1e-5 * np.ptp(used)).mean() > 0.999


def test_no_held_out_cloud_took_part_in_finding_the_rules(script):
    quality = script("quality.py")
    clouds = [*quality.FOUND_ON, *quality.HELD_OUT]
    assert not {cloud.file for cloud in quality.HELD_OUT} & {cloud.file for cloud in quality.FOUND_ON}
    assert set(quality.LIDAR) < set(quality.HELD_OUT)
    assert len({cloud.name for cloud in clouds}) == len(clouds)


@pytest.mark.parametrize("path", sorted(BENCHMARKS.rglob("*.py")), ids=lambda path: path.stem)
def test_what_a_script_imports_of_gppcs_exists(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "gppcs":
            exec(ast.unparse(node), {})
