"""The scale from values to colours, and the bar that shows it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLOURS, DARKEST = "viridis", 0.22  # without its darkest part, on which no shading is seen
NO_VALUE = 0.6  # grey


def colour_scale(clouds: Sequence[Array]) -> ScalarMappable:
    """Return one scale for the values of several clouds.

    It goes from 0, or the least value if that is less, to the largest of the clouds' 98th percentiles; colours
    follow the square root, since most values are small.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, PowerNorm

    limits = np.array([_limits(values) for values in clouds])
    shades = ListedColormap(colormaps[COLOURS](np.linspace(DARKEST, 1.0, 256)))
    return ScalarMappable(PowerNorm(0.5, limits[:, 0].min(), limits[:, 1].max(), clip=True), shades)


def colours_of(scale: ScalarMappable, values: Array) -> Array:
    """Return the colours of values, (N, 3), 0 to 1; NaN is grey."""
    colours: Array = scale.to_rgba(values)[:, :3]
    colours[np.isnan(values)] = NO_VALUE
    return colours


def add_bar(figure: Figure, place: tuple[float, float, float, float], scale: ScalarMappable, size: float) -> None:
    """Add a colour bar to a figure at left, bottom, width, height in shares of it, with writing of a size."""
    from matplotlib.ticker import MaxNLocator

    low, high = scale.get_clim()
    ticks = [tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high]
    axes = figure.add_axes(place)
    bar = figure.colorbar(scale, cax=axes, orientation="horizontal", extend="max", ticks=ticks)
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=size - 2.0, color="0.5", labelcolor="0.35", length=3)
    bar.set_label("surface variation", fontsize=size, color="0.25")


def _limits(values: Array) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return 0.0, 1.0
    low, high = min(0.0, float(finite.min())), float(np.percentile(finite, 98))
    return low, high if high > low else low + 1.0
