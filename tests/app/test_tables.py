"""Comparisons as tables."""

import csv
import dataclasses
import io

import numpy as np
import pytest

import gppcs
from gppcs.app.tables import SHOWN, Column, Row, as_csv, as_markdown, as_text, columns_of
from gppcs.evaluation.mesh_comparison import MeshEntry
from gppcs.evaluation.report import MeshReport, Rebuilt, figures_of


def rows_of(entries):
    return [Row.of(entry) for entry in entries]


@pytest.fixture(scope="module")
def entries():
    return gppcs.compare(gppcs.sample("bracket", 2000), ["random", "fps"], ratio=0.1)


def test_csv_holds_every_figure_raw_and_relative(entries):
    rows = list(csv.DictReader(io.StringIO(as_csv(rows_of(entries)))))
    assert [row["method"] for row in rows] == ["random", "fps"]
    for row, entry in zip(rows, entries, strict=True):
        raw, relative = entry.report.figures(), entry.report.figures(relative=True)
        assert {name: float(row[name]) for name in raw} == raw
        lengths = {name for name, figure in figures_of(gppcs.Report).items() if "length" in figure.unit}
        assert {name for name in row if name.endswith("_relative")} == {
            f"{name}_relative" for name in lengths - {"diagonal"}
        }
        assert float(row["chamfer_relative"]) == relative["chamfer"]


def test_markdown_has_a_row_for_each_method_and_the_best_in_bold(entries):
    header, rule, *rows = as_markdown(rows_of(entries)).split("\n\n")[0].splitlines()
    titles = [cell.strip() for cell in header.strip("|").split("|")]
    assert rule.count("---") == len(titles)
    cells = {line.split("|")[1].strip(): [cell.strip() for cell in line.strip("|").split("|")] for line in rows}
    radius = titles.index("covering radius")
    best = 1e4 * entries[1].report.covering_radius / entries[1].report.diagonal
    assert cells["fps"][radius] == f"**{best:.3g}**"
    assert "*" not in cells["random"][radius]
    assert cells["random"][titles.index("points")] == "200"


def test_entries_of_one_method_are_told_apart(entries):
    fives = [
        dataclasses.replace(entry, result=dataclasses.replace(entry.result, method=gppcs.Random(seed=seed)))
        for entry, seed in zip(entries, (0, 5), strict=True)
    ]
    rows = list(csv.DictReader(io.StringIO(as_csv(rows_of(fives)))))
    assert [(row["method"], row["parameters"]) for row in rows] == [
        ("random", "seed=0 even=False"),
        ("random", "seed=5 even=False"),
    ]
    assert [line.split(" | ")[0] for line in as_markdown(rows_of(fives)).splitlines()[2:4]] == [
        "| random",
        "| random (seed=5)",
    ]


def test_columns_without_values_are_left_out(entries):
    titles = {column.title for column in columns_of(rows_of(entries))}
    assert "surface mean" in titles
    assert "hausdorff mean" not in titles
    assert set(SHOWN) - {f"carried_{name}" for name in figures_of(Rebuilt)} <= {
        *figures_of(gppcs.Report), *figures_of(Rebuilt), *figures_of(MeshReport)
    }  # fmt: skip


@pytest.fixture(scope="module")
def mesh_rows():
    """Rows of two ways to a mesh, the second of which has failed."""
    pytest.importorskip("pymeshlab")
    (entry,) = gppcs.compare_meshes(gppcs.sample("sphere", 1000), n_points=100, ways=["mesh"])
    failed = MeshEntry("ball-pivoting", None, None, 0.5, "no surface,\n  at all")
    return rows_of([entry, failed])


def test_tables_of_meshes_have_their_figures_and_say_which_way_failed(mesh_rows):
    report = mesh_rows[0].figures
    first, second = csv.DictReader(io.StringIO(as_csv(mesh_rows)))
    assert [*first][:2] == ["way", "seconds"]
    assert {name: float(first[name]) for name in report} == report
    assert float(first["mesh_mean_relative"]) == report["mesh_mean"] / report["diagonal"]
    assert {name: value for name, value in second.items() if value} == {
        "way": "ball-pivoting", "seconds": "0.5", "failure": "no surface, at all"
    }  # fmt: skip


def test_markdown_of_meshes_shows_topology_and_size(mesh_rows):
    table, units = as_markdown(mesh_rows).split("\n\n")
    header, _, first, second = ([cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines())
    shown_of = dict(zip(header, first, strict=True))
    expected = {"way": "mesh", "vertices": "100", "triangles": "196", "mesh pieces": "1", "borders": "0", "genus": "0"}
    assert expected.items() <= shown_of.items()
    assert shown_of["mesh mean"] == f"{1e4 * mesh_rows[0].relative['mesh_mean']:.3g}"
    assert second == ["ball-pivoting", "-", "-", "**0.5**" if mesh_rows[0].seconds > 0.5 else "0.5", *["-"] * 11]
    assert units.startswith("Lengths in 1e-4 diagonals")
    assert "Chamfer" not in units


def test_no_value_is_best_where_all_are_equal_or_none_is_better():
    assert Column("", (1.0, 2.0, None), "less").is_best(0)
    assert not any(Column("", (1.0, 2.0, None), better).is_best(0) for better in ("more", None))
    assert not Column("", (1.0, 1.0), "less").is_best(0)
    assert not Column("", (None, None), "less").is_best(0)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (13129, "13,129"),
        (0.0, "0"),
        (1.23456e-7, "1.23e-07"),
        (98765.4, "98765"),
        (np.float64(12.345), "12.3"),
        (999.4, "999"),
        (999.96, "1000"),
        (-999.96, "-1000"),
    ],
)
def test_numbers_show_three_digits(value, text):
    assert as_text(value) == text
