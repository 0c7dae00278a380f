"""Make docs/animation.gif: the sample medallion and the surface through ever fewer of its kept points."""

import io
from pathlib import Path

from PIL import Image

import gppcs
from gppcs.app.pages import draw_beside
from gppcs.drawing.camera import GUESSED
from gppcs.drawing.colours import RGB
from gppcs.drawing.surfaces import surface_through
from gppcs.drawing.web.layers import Named

PICTURE = Path(__file__).parents[1] / "animation.gif"
SCAN, KEPT = 400_000, (12_000, 8_000, 5_000, 3_000, 2_000, 1_200, 800, 500)
WIDTH = 1000  # pixels
COLOURS = 64
MILLISECONDS = 900  # each picture

if __name__ == "__main__":
    scan = gppcs.sample("medallion", n_points=SCAN)
    ranked = gppcs.simplify(scan, n_points=KEPT[0]).cloud  # its first points are a good smaller result
    pictures = []
    for count in KEPT:
        file = io.BytesIO()
        kept = ranked.take(range(count))
        surface = surface_through(kept, scan)
        assert surface
        results = [
            (Named("points kept", kept), f"{count / SCAN:.2%} of the points"),
            (Named("surface", kept, surface.mesh, is_mesh=True), "the surface through them"),
        ]
        draw_beside(file, Named("scan", scan), results, GUESSED, RGB, close_ups=0)
        picture = Image.open(file).convert("RGB")
        height = round(WIDTH * picture.height / picture.width)
        pictures.append(picture.resize((WIDTH, height), Image.Resampling.LANCZOS).quantize(COLOURS))
    there_and_back = [*pictures, *pictures[-2:0:-1]]
    there_and_back[0].save(
        PICTURE, save_all=True, append_images=there_and_back[1:], duration=MILLISECONDS, loop=0, optimize=True
    )
