"""How large the page of `gppcs report` is, how soon it draws, and how fast it turns, without a graphics card.

Needs the extra `evaluate`, Chromium, Node.js, and what `npm ci` installs in `viewer`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import numpy as np

import gppcs
import report
from gppcs.drawing.web.contents import Named, report_page
from gppcs.drawing.web.levels import Levels
from gppcs.drawing.web.serving import LevelsServer
from gppcs.evaluation.comparison import rebuilt_mesh
from gppcs.io.copc import nodes_of
from scans import sample

DRAGON = report.DATA / "dragon.ply"
METHODS = "gp", "fps", "voxel", "random", "qem"
RATIO = 0.03
MANY = 1_000_000  # points, the most that a page draws of a cloud
LARGE = 20_000_000  # points of a COPC file that is shown by level
TILES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])  # of which it consists, side by side
OPENED = 5  # times
MEASURE = report.HERE.parent / "viewer" / "measure.mjs"


def pages() -> Iterator[tuple[str, Named, list[Named]]]:
    """Yield the title, the original and the results of each page."""
    dragon = gppcs.read(DRAGON)
    results = [gppcs.simplify(dragon, ratio=RATIO, method=method).cloud for method in METHODS]
    title = f"Dragon, {len(dragon):,} points, five results of {len(results[0]):,}"
    yield title, Named("dragon", dragon), list(map(Named, METHODS, results))
    whole, *meshes = (rebuilt_mesh(cloud, dragon) for cloud in (dragon, *results))
    triangles = sum(len(mesh.faces) for mesh in (whole, *meshes))
    title = f"the same with a mesh of each, {triangles:,} triangles in all"
    yield title, Named("dragon", dragon, whole), list(map(Named, METHODS, results, meshes))
    statue = sample("statue", n_points=MANY)
    kept = gppcs.simplify(statue, ratio=RATIO).cloud
    yield f"statue, {MANY:,} points, one result of {len(kept):,}", Named("statue", statue), [Named("gp", kept)]


def by_level(folder: Path, browser: str) -> tuple[str, int, dict[str, float]]:
    """Measure a COPC file that is shown by level; return the title, the size of the page, and the figures."""
    path = folder / "large.copc.laz"
    tile = sample("terrain", n_points=LARGE // len(TILES)).points
    shifts = TILES * np.ptp(tile, axis=0)
    gppcs.write(path, gppcs.PointCloud(np.concatenate([tile + shift for shift in shifts])))
    with nodes_of(path) as nodes:
        assert nodes
        with LevelsServer(Levels(nodes, path.name, [])) as server:
            Thread(target=server.serve_forever, daemon=True).start()
            found = measured(server.url, browser)
            server.shutdown()
            return f"by level, {LARGE:,} points, {found['drawn']:,} drawn", len(server.levels.page), found


def measured(page: Path | str, browser: str) -> dict[str, float]:
    """Open a page several times, and return the best figures."""
    command = ["node", MEASURE, page, browser, str(OPENED)]
    runs = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return {
        "first": min(run["first"] for run in runs),
        "loaded": min(run["loaded"] for run in runs),
        "drawn": max(run["drawn"] for run in runs),
        "rate": max(run["rate"] for run in runs),
    }


def row(title: str, size: int, found: dict[str, float]) -> tuple[str, ...]:
    """Return a row of the table."""
    return title, f"{size / 1e6:.1f}", f"{found['first']:.1f}", f"{found['loaded']:.1f}", f"{found['rate']:.0f}"


def main() -> None:
    """Make the pages, and measure them."""
    browser = shutil.which("chromium")
    assert browser, "Chromium is not installed"
    version = subprocess.run([browser, "--version"], check=True, capture_output=True, text=True).stdout.strip()
    rows = []
    for title, original, results in pages():
        with tempfile.NamedTemporaryFile(suffix=".html") as file:
            file.write(report_page(original, results, []).content())
            file.flush()
            rows.append(row(title, file.tell(), measured(Path(file.name), browser)))
    with tempfile.TemporaryDirectory() as folder:
        rows.append(row(*by_level(Path(folder), browser)))
    report.write_sections(
        "viewing",
        "The page of gppcs report in a browser without a graphics card",
        [report.Section("", ("page", "MB", "first picture, s", "all unpacked, s", "pictures a second"), rows)],
        [DRAGON],
        [
            f"{version}, headless, 1280 by 900 pixels; the processor draws (SwiftShader). The best of {OPENED} times.",
            "First picture: from the start of the navigation until a picture of points is on the canvas. All unpacked: "
            "until every colouring and the meshes can be shown; by level, until no more points are on their way.",
            "Pictures a second: those that the page draws in five seconds while the pointer turns it.",
            f"Load average of the machine: {os.getloadavg()[2]:.0f}; nice value of the browser: {os.nice(0)}.",
        ],
    )


if __name__ == "__main__":
    main()
