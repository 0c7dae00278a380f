"""The gallery: each sample scan before and after, with the error of `gp` beside those of `fps` and `voxel`.

Run as `python benchmarks/gallery.py`; needs the extra `picture`, and no data. It writes the table results/gallery.md
and the pictures in docs/gallery.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from PIL import Image

import gppcs
import report
import scans
from gppcs.drawing.camera import Viewpoint
from gppcs.drawing.cloud_images import ColouredCloud
from gppcs.drawing.side_by_side import Column, draw_comparison
from gppcs.drawing.web.layers import Named

FOLDER = Path(__file__).parents[1] / "docs" / "gallery"
POINTS, RATIO = 200_000, 0.05
METHODS = ("gp", "fps", "voxel")
SIZE = (1000, 1000)  # of a picture at most, in pixels


class Sample(NamedTuple):
    """A sample scan of the gallery: its name, its noise in diagonals, and from where it is seen."""

    name: str
    noise: float = 0.0
    view: Viewpoint = Viewpoint()


SAMPLES = {
    "statue": Sample("statue"),
    "medallion": Sample("medallion", 1e-4),
    "bracket": Sample("bracket"),
    "fan": Sample("fan", view=Viewpoint("z", (20.0, 40.0))),
    "noisy statue": Sample("statue", 2e-3),
    "room": Sample("room", view=Viewpoint("z", (40.0, 25.0))),
    "avenue": Sample("avenue", view=Viewpoint("z", (60.0, 30.0))),
    "terrain": Sample("terrain", view=Viewpoint("z", (30.0, 35.0))),
}


def row(title: str, sample: Sample) -> tuple[str, ...]:
    """Thin a sample scan, draw it, and return its row of the table."""
    cloud = scans.sample(sample.name, POINTS, noise=sample.noise)
    entries = gppcs.compare(cloud, METHODS, ratio=RATIO)
    everything = ColouredCloud.by_surface_variation(cloud.points)
    result = entries[0].result
    kept = ColouredCloud(result.cloud.points, everything.values[result.indices])
    picture = BytesIO()
    columns = [Column(Named("original", cloud), everything), Column(Named("gp", result.cloud), kept)]
    draw_comparison(picture, columns, sample.view, close_ups=0)
    small = Image.open(picture).convert("RGB")
    small.thumbnail(SIZE, Image.Resampling.LANCZOS)
    FOLDER.mkdir(exist_ok=True)
    # A palette, which makes the file small, of colours that are all near those of the picture, also rare ones.
    palette = small.quantize(method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette.save(FOLDER / f"{title.replace(' ', '-')}.png", optimize=True)
    figures = [entry.report.figures(relative=True) for entry in entries]
    errors = [f"{1e4 * each[name]:.3g}" for name in ("surface_mean", "covering_radius") for each in figures]
    return title, f"{len(result.indices):,}", *errors


def main() -> None:
    """Thin, draw and measure each sample scan."""
    titles = [f"{figure}: {method}" for figure in ("mean error", "largest gap") for method in METHODS]
    report.write_sections(
        "gallery",
        f"Sample scans of {POINTS:,} points, of which {100 * RATIO:g} % are kept; lengths in 1e-4 diagonals",
        [report.Section("", ("scan", "kept", *titles), [row(*each) for each in SAMPLES.items()])],
        notes=["The mean error is the surface mean of gppcs.evaluate, the largest gap its covering radius."],
    )


if __name__ == "__main__":
    main()
