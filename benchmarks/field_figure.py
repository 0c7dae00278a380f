"""The figure of research/local-field.md: what the method `gp` computes on the sample scan `medallion`.

Run as `python benchmarks/field_figure.py`; needs the extra `picture`, and no data. The four panels show the last stage
of the choice: roughness, desired spacing, posterior standard deviation given the first half of the kept points, and all
kept points. It writes research/local-field.png.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

import gppcs
from gppcs.drawing.camera import Camera, Viewpoint
from gppcs.drawing.cloud_images import ColouredCloud, Original, View
from gppcs.gp.local import algorithm
from gppcs.gp.local.posterior import condition, posterior_of_all

PICTURE = Path(__file__).parents[1] / "research" / "local-field.png"
POINTS, KEPT = 200_000, 3_000
METHOD = gppcs.LocalGP()

VIEW = Viewpoint("z", (-45.0, 75.0))  # the word POINTS stands upright
PANEL = 520  # pixels
DETAIL = (280, 130, 560)  # the part that is drawn, in a view of the whole medallion
GAP, ABOVE, BELOW = 16, 40, 54  # pixels
SHOWN = (2.0, 98.0)  # percentiles at the ends of a colour scale
MAX_POINT_RADIUS = 7.0  # supersampled pixels

Values = NDArray[np.float64]


class LastStage(NamedTuple):
    """The last stage of the choice, at its n candidates.

    Attributes
    ----------
    points : (n, 3) array
        In target spacings.
    roughness, spacings, deviations : (n,) arrays
        Roughness; desired spacing, in target spacings; posterior standard deviation, in units of the prior's, given
        the points that the stages before chose.
    chosen : (M / 2,) array, int64
        Rows of these points.
    kept : (M,) array, int64
        Rows of all kept points.
    """

    points: Values
    roughness: Values
    spacings: Values
    deviations: Values
    chosen: NDArray[np.int64]
    kept: NDArray[np.int64]


def last_stage(cloud: gppcs.PointCloud) -> LastStage:
    """Run the method, record its calls, and return what the last stage computed."""
    fields, choices = Recorded(algorithm.local_field), Recorded(algorithm.extend)
    with patch.object(algorithm, "local_field", fields), patch.object(algorithm, "extend", choices):
        gppcs.simplify(cloud, n_points=KEPT, method=METHOD)
    (tree, features, *_), (field, _) = fields.last
    (_, _, chosen, _, neighbours, error_weight, *_), (kept, *_) = choices.last
    _, variances, _ = posterior_of_all(field, condition(field, tree, chosen, neighbours), error_weight)
    roughness = np.sqrt(features.surface_variation)
    return LastStage(tree.points.T.copy(), roughness, field.spacings, np.sqrt(variances), chosen, kept)


class Recorded:
    """A function that remembers the arguments and the result of its last call."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the function."""
        result = self.function(*arguments, **named)
        self.last = arguments, result
        return result


def draw(stage: LastStage) -> None:
    """Draw the four panels, with a colour bar below each that has colours, and the points chosen half way."""
    everything = ColouredCloud(stage.points, stage.roughness)
    camera = Camera.towards(stage.points, PANEL, (PANEL, PANEL), VIEW).close_up(DETAIL, PANEL)
    view = View(Original(everything), camera)
    width, height = 2 * (PANEL + GAP) + GAP, 2 * (PANEL + ABOVE + BELOW)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    nothing = np.ones((PANEL, PANEL, 3))
    coloured = (
        ("roughness", stage.roughness, nothing),
        ("desired spacing, in target spacings", stage.spacings, nothing),
        ("posterior standard deviation, half way", stage.deviations, dots(view, stage, stage.chosen)),
    )
    for number, (title, values, shade) in enumerate(coloured):
        scale = ScalarMappable(Normalize(*np.percentile(values, SHOWN), clip=True), colormaps["viridis"])
        left, bottom = place(number, height)
        put(figure, title, shade * view.surface(scale.to_rgba(values)[:, :3]), left, bottom)
        axes = figure.add_axes(
            ((left + 0.2 * PANEL) / width, (bottom - 0.4 * BELOW) / height, 0.6 * PANEL / width, 12 / height)
        )
        figure.colorbar(scale, cax=axes, orientation="horizontal").outline.set_visible(False)
    put(figure, "kept points", dots(view, stage, stage.kept), *place(3, height))
    figure.savefig(PICTURE, dpi=100)


def dots(view: View, stage: LastStage, rows: NDArray[np.int64]) -> Values:
    """Return a picture of some candidates as black points."""
    cloud = ColouredCloud(stage.points[rows], stage.roughness[rows])
    return view.points(cloud, np.full((len(rows), 3), 0.1), MAX_POINT_RADIUS)


def place(number: int, height: int) -> tuple[int, int]:
    """Return the left and lower edges of a panel, in pixels, counted from the lower left corner of the picture."""
    row, column = divmod(number, 2)
    return GAP + column * (PANEL + GAP), height - (row + 1) * (PANEL + ABOVE) - row * BELOW


def put(figure: Figure, title: str, image: Values, left: int, bottom: int) -> None:
    """Put a panel and the title above it into the figure."""
    figure.figimage(image, left, bottom, origin="upper")
    width, height = 100 * figure.get_size_inches()
    figure.text(
        (left + PANEL / 2) / width, (bottom + PANEL + 0.5 * ABOVE) / height, title, ha="center", va="center", size=15
    )


def main() -> None:
    """Draw the figure."""
    draw(last_stage(gppcs.sample("medallion", n_points=POINTS)))


if __name__ == "__main__":
    main()
