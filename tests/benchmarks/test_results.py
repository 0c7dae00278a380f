"""The results say by which code and on which machine they were made, and by clouds that the rules were not found on."""

import ast
import re
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PAGES = sorted((BENCHMARKS / "results").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_tells_commit_and_machine(page):
    text = page.read_text()
    assert re.search(r"^- gppcs \S+, commit [0-9a-f]{7,}", text, re.MULTILINE)
    assert re.search(r"^- .+, \d+ threads$", text, re.MULTILINE)


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
