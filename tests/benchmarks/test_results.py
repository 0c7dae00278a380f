"""The results say by which code and on which machine they were made."""

import re
import subprocess
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PAGES = sorted((BENCHMARKS / "results").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_tells_commit_and_machine(page):
    text = page.read_text()
    assert re.search(r"^- gppcs \S+, commit [0-9a-f]{7,}", text, re.MULTILINE)
    assert re.search(r"^- .+, \d+ threads$", text, re.MULTILINE)


def test_each_page_is_of_a_commit_of_this_history():
    made = {re.search(r", commit ([0-9a-f]{7,})", page.read_text())[1] for page in PAGES}
    git = ["git", "-C", str(BENCHMARKS)]
    if subprocess.run([*git, "cat-file", "-e", "HEAD~50"], check=False, capture_output=True).returncode:
        pytest.skip("needs the history of the repository")
    for commit in made:
        subprocess.run([*git, "merge-base", "--is-ancestor", commit, "HEAD"], check=True)
