"""The notebooks in `examples` run, and show what their cells print and draw."""

import json
import re
import webbrowser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOUR = ROOT / "examples" / "tour.ipynb"


def code_of(path):
    """Return the code of the cells of a notebook."""
    cells = [cell for cell in json.loads(path.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]
    shown = [cell for cell in cells if "gppcs.show(" not in "".join(cell["source"])]  # a page would be megabytes
    assert all(cell["outputs"] for cell in shown)
    assert all(output["output_type"] != "error" for cell in cells for output in cell["outputs"])
    return ["".join(cell["source"]) for cell in cells]


@pytest.mark.parametrize(
    ("points", "vertices"), [("10_000", "400"), pytest.param("100_000", "4000", marks=pytest.mark.slow)]
)
def test_the_tour_runs(points, vertices, monkeypatch, tmp_path):
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    pages = []
    monkeypatch.setattr(webbrowser, "open", lambda page: pages.append(page) or True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    names = {"__name__": "notebook"}
    for number, code in enumerate(code_of(TOUR)):
        smaller = re.sub(r"\b4000\b", vertices, code.replace("100_000", points))
        exec(compile(smaller, f"cell {number}", "exec"), names)
    plt.close("all")
    assert len(pages) == 1
    assert {path.name for path in names["folder"].iterdir()} == {"scan.ply", "small.ply", "mesh.ply"}
    assert len(names["made"].mesh.vertices) == int(vertices)
    diagonal = names["report"].diagonal
    assert names["all_points"] < 2e-3 * diagonal
    assert names["thinned"] < 5e-3 * diagonal
