"""The results say by which code and on which machine they were made."""

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
