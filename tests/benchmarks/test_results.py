"""The results say by which code and on which machine they were made, and whether `gp` has changed since."""

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


@pytest.fixture(scope="module")
def report():
    return module("report")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_tells_commit_and_machine(page):
    text = page.read_text()
    assert re.search(r"^- gppcs \S+, commit [0-9a-f]{7,}", text, re.MULTILINE)
    assert re.search(r"^- .+, \d+ threads$", text, re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_says_whether_gp_has_changed_since(report, page):
    """If this fails, run `python benchmarks/mark_stale.py`."""
    text = page.read_text()
    assert report.marked(text) == text


def test_a_page_is_marked_only_while_gp_has_changed(report, monkeypatch):
    fresh = report.text("Something", [report.Section("", ("method", "figure"), [("gp", "1")])])
    assert report.marked(fresh) == fresh
    monkeypatch.setattr(report, "code_of_gp", lambda: "0" * 16)
    stale = report.marked(fresh)
    commit = re.search(r"commit (\w+)", fresh)[1]
    assert f"- gp as of commit {commit}; the code of gp has changed since\n" in stale
    assert report.marked(stale) == stale
    monkeypatch.undo()
    assert report.marked(stale) == fresh


def test_pages_without_gp_need_no_digest(report):
    page = report.text("gp-spectral alone", [report.Section("", ("method", "figure"), [("gp-spectral", "1")])])
    assert "code of gp:" not in page
    assert report.marked(page) == page


def test_all_pages_are_made_by_one_command():
    made = [script.page for script in module("run_all").SCRIPTS]
    assert sorted(made) == [page.stem for page in PAGES]
    for script in module("run_all").SCRIPTS:
        source = (BENCHMARKS / script.file).read_text()
        assert f'"{script.page}"' in source or f'"{script.page}.md"' in source


def test_the_plot_can_be_imported_before_the_script_that_draws_it():
    pytest.importorskip("matplotlib")
    subprocess.run([sys.executable, "-c", "import speed_plot, speed"], cwd=BENCHMARKS, check=True)


KERNELS = '''
"""Kernels."""
import math

LIMIT = 2.0  # metres


def length(points):
    """Return the length."""
    return min(LIMIT, math.sqrt(sum(points)))
'''
METHOD = '''
from {package}.kernels import length
from {package}.other import unused


class Method:
    pass


class Thin(Method):
    """Thin."""

    keep: int = 3

    def __call__(self, points: list) -> float:
        """Do it."""
        if not points:
            raise ValueError("no points")
        longest = length(points)
        return longest
'''
SAME = {
    "comments and docstrings": ("kernels", "Return the length.", "Compute the length."),
    "comment": ("kernels", "# metres", "# m"),
    "message": ("method", "no points", "there are no points"),
    "annotation": ("method", "points: list", "points"),
    "name of a variable": ("method", "longest", "result"),
    "name of a constant": ("kernels", "LIMIT", "MOST"),
    "unused code": ("other", "1", "2"),
}
OTHER = {
    "constant": ("kernels", "2.0", "2.5"),
    "function of a library": ("kernels", "math.sqrt", "math.cbrt"),
    "operation": ("kernels", "min(", "max("),
    "call": ("method", "length(points)", "length(points) + 1"),
}


FILES = {"__init__": "", "kernels": KERNELS, "method": METHOD, "other": "unused = 1\n"}


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Return a function that returns the digest of a method in a package of some files."""
    code_digest = module("code_digest")
    monkeypatch.syspath_prepend(tmp_path)
    packages = (f"{tmp_path.name}_{number}" for number in range(2))

    def of(files):
        package = next(packages)
        (tmp_path / package).mkdir()
        for name, text in files.items():
            (tmp_path / package / f"{name}.py").write_text(text.replace("{package}", package))
        monkeypatch.setattr(code_digest, "PACKAGES", (package,))
        return code_digest.of_code(importlib.import_module(f"{package}.method").Thin)

    return of


def changed(file, old, new):
    """Return the files with some words of one replaced."""
    assert old in FILES[file]
    return {**FILES, file: FILES[file].replace(old, new)}


@pytest.mark.parametrize("change", SAME.values(), ids=SAME)
def test_words_names_and_unused_code_leave_the_digest(digest, change):
    assert digest(changed(*change)) == digest(FILES)


@pytest.mark.parametrize("change", OTHER.values(), ids=OTHER)
def test_other_code_has_another_digest(digest, change):
    assert digest(changed(*change)) != digest(FILES)


def test_a_move_to_another_file_leaves_the_digest(digest):
    line = "LIMIT = 2.0  # metres\n"
    kernels = KERNELS.replace(line, "from {package}.limits import LIMIT as MOST\n").replace("min(LIMIT", "min(MOST")
    assert digest({**FILES, "kernels": kernels, "limits": line}) == digest(FILES)
