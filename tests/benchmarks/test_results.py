"""The results say by which code and on which machine they were made."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PAGES = sorted((BENCHMARKS / "results").glob("*.md"))


def module(name):
    """Import a script of the benchmarks."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(BENCHMARKS))


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


def test_all_pages_are_made_by_one_command():
    made = [script.page for script in module("run_all").SCRIPTS]
    assert sorted(made) == [page.stem for page in PAGES]
    for script in module("run_all").SCRIPTS:
        source = (BENCHMARKS / script.file).read_text()
        assert f'"{script.page}"' in source or f'"{script.page}.md"' in source


def test_the_plot_can_be_imported_before_the_script_that_draws_it():
    pytest.importorskip("matplotlib")
    subprocess.run([sys.executable, "-c", "import speed_plot, speed"], cwd=BENCHMARKS, check=True)
