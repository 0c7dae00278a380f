"""Comparisons as tables."""

import csv
import io

import pytest

import gppcs
from gppcs.app.tables import SHOWN, as_csv, as_markdown, columns_of, record_of
from gppcs.evaluation.report import definition_of


@pytest.fixture(scope="module")
def entries():
    return gppcs.compare(gppcs.sample("bracket", 2000), ["random", "fps"], ratio=0.1)


def csv_of(entries):
    return list(csv.DictReader(io.StringIO(as_csv([*map(record_of, entries)]))))


def markdown_of(entries):
    """Return the rows of the table, the first of which holds the titles."""
    table = as_markdown([str(entry.method) for entry in entries], columns_of([*map(record_of, entries)]))
    lines = table.split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in (lines[0], *lines[2:])]


def test_csv_holds_every_figure_raw_and_relative(entries):
    for row, entry in zip(csv_of(entries), entries, strict=True):
        raw, relative = entry.report.figures(), entry.report.figures(relative=True)
        assert row["method"] == entry.method.name
        assert {name: float(row[name]) for name in raw} == raw
        lengths = {name for name in raw if definition_of(name).power} - {"diagonal"}
        assert {name: float(row[f"{name}_relative"]) for name in lengths} == {name: relative[name] for name in lengths}


def test_markdown_has_a_row_for_each_method_and_the_best_in_bold(entries):
    titles, random, fps = markdown_of(entries)
    radius = titles.index("covering radius")
    best = 1e4 * entries[1].report.covering_radius / entries[1].report.diagonal
    assert (random[0], random[titles.index("points")], fps[radius]) == ("random", "200", f"**{best:.3g}**")
    assert "*" not in random[radius]
    assert "surface mean" in titles
    assert "hausdorff mean" not in titles
    assert all(definition_of(name) for name in SHOWN if name != "seconds")
