"""The claims of the README hold in the tables that were measured."""

import re
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


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


FOUND_ON, HELD_OUT = "Summary: the rules were found on these clouds", "Summary: held-out clouds"
H_MEAN = "H mean, times the best rival's"
MEAN_ERROR = "mean distance to the local surface"
BY_CONDITION = "gp divided by the best rival under each condition"


def ratios(heading, name=H_MEAN):
    """Return a column of a summary by cloud, where it has a figure."""
    rows = [row for row in tables("quality")[heading] if "geometric mean" not in row["cloud"]]
    return {row["cloud"]: number(row[name]) for row in rows if row[name]}


def test_the_margins_in_h_mean_are_those_of_the_table():
    for heading in (FOUND_ON, HELD_OUT):
        values = ratios(heading)
        (mean,) = (number(row[H_MEAN]) for row in tables("quality")[heading] if "geometric mean" in row["cloud"])
        assert mean < 1
        assert abs(mean - np.exp(np.mean(np.log(list(values.values()))))) < 0.002  # of rounded figures
        assert_stated_together(sum(value < 1 for value in values.values()), len(values), round(100 * (1 - mean), 1))
    others = ratios(HELD_OUT)
    behind = {cloud.split("_")[0].split(":")[0] for cloud, ratio in others.items() if ratio > 1}
    assert behind == {"turbine", "blade", "tum", "bracket", "fan", "plant"}
    assert_stated_together(round(100 * (max(others.values()) - 1), 1))


def test_the_errors_and_gaps_on_scenes_are_those_of_the_table():
    rows = {
        row["measure"]: number(row["all"]) for row in tables("scenes")["Summary: geometric means of gp divided by fps"]
    }
    scenes = {row["condition"].split(":")[0] for row in tables("scenes")[BY_CONDITION]}
    (gaps,) = (row for measure, row in rows.items() if measure.startswith("99.9th percentile"))
    errors = [rows[f"{MEAN_ERROR}{kind}, 1e-4 diagonals"] for kind in ("", ", by area")]
    assert_stated_together(len(scenes), *(round(100 * (1 - error), 1) for error in errors))
    assert_stated_together(round(100 * (gaps - 1), 1))
    for row in tables("scenes")["Geometric means, gp divided by each rival"]:
        errors = [number(cell) for measure, cell in row.items() if measure != "rival" and "99.9th" not in measure]
        assert len(errors) == 5
        assert max(errors) < 1
