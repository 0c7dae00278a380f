"""The claims of the README hold in the tables that were measured."""

import re
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
README, RESULTS = ((ROOT / page).read_text() for page in ("README.md", "docs/results.md"))


@cache
def tables(name):
    """Return the tables of a results file: by heading, then first cell, then column."""
    page = (ROOT / "benchmarks" / "results" / f"{name}.md").read_text()
    found = {}
    for section in re.split(r"^#+ ", page, flags=re.MULTILINE)[1:]:
        heading, _, body = section.partition("\n")
        cells = [
            [cell.strip() for cell in line.strip("|").split(" | ")] for line in body.splitlines() if line[:1] == "|"
        ]
        if cells:
            header, _, *rows = cells
            found[heading] = [dict(zip(header, row, strict=True)) for row in rows]
    return found


def number(cell):
    """Return the number at the start of a cell."""
    return float(cell.strip("*").split()[0].replace(",", ""))


def assert_stated_together(*figures, page=README):
    """Check that one paragraph, list item or row of a page has all figures, in whatever words."""
    blocks = [re.findall(r"\d[\d,]*(?:\.\d+)?", block) for block in re.split(r"\n\n|\n(?=- |\|)", page)]
    assert any(set(figures) <= {float(text.replace(",", "")) for text in block} for block in blocks), figures


HELD_OUT = "Summary: held-out clouds"
HELPED = {"lion", "turbine", "tum", "fan", "moth", "case", "plate"}  # these decided a rule later
H_MEAN = "H mean, times the best rival's"


def ratios():
    """Return H mean of `gp`, times the best rival's, by held-out cloud."""
    rows = [row for row in tables("quality")[HELD_OUT] if "geometric mean" not in row["cloud"]]
    return {row["cloud"]: number(row[H_MEAN]) for row in rows if row[H_MEAN]}


def test_the_headline_is_of_clouds_that_decided_nothing():
    values = [ratio for cloud, ratio in ratios().items() if re.split("[_:]", cloud)[0] not in HELPED]
    assert len(values) == 10
    assert_stated_together(sum(value < 1 for value in values), len(values))
    mean = np.exp(np.mean(np.log(values)))
    assert_stated_together(sum(value < 1 for value in values), len(values), round(100 * (1 - mean), 1), page=RESULTS)


def test_the_worst_cloud_is_named():
    worst = max(ratios(), key=ratios().get)
    assert worst.startswith("blade")
    assert_stated_together(round(100 * (ratios()[worst] - 1), 1))


def test_the_errors_on_scenes_are_those_of_the_table():
    rows = tables("scenes")["Summary: geometric means of gp divided by fps"]
    (error,) = (row for row in rows if row["measure"] == "mean distance to the local surface, 1e-4 diagonals")
    assert_stated_together(round(100 * (1 - number(error["held out"])), 1))
    for row in tables("scenes")["Geometric means, gp divided by each rival"]:
        errors = [number(cell) for measure, cell in row.items() if measure != "rival" and "99.9th" not in measure]
        assert len(errors) == 5
        assert max(errors) < 1
