"""Converts values to colours, and draws the colour bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLOURS, DARKEST = "viridis", 0.22  # a colour map, from this place on: darker colours would hide the shading
NO_VALUE = 0.6  # grey level of NaN


def colour_scale(clouds: Sequence[Array]) -> ScalarMappable:
    """Return one colour scale for the values of several clouds.

    Parameters
    ----------
    clouds : sequence of (N,) arrays
        The values of each cloud; NaN and infinite ones are ignored.

    Returns
    -------
    matplotlib.cm.ScalarMappable
        From 0, or the least value if that is negative, to the largest of the clouds' 98th percentiles. Colours follow
        the square root of the value, since most values are small.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, PowerNorm

    limits = np.array([_limits(values) for values in clouds])
    shades = ListedColormap(colormaps[COLOURS](np.linspace(DARKEST, 1.0, 256)))
    return ScalarMappable(PowerNorm(0.5, limits[:, 0].min(), limits[:, 1].max(), clip=True), shades)


def colours_of(scale: ScalarMappable, values: Array) -> Array:
    """Return the colours of values.

    Parameters
    ----------
    scale : matplotlib.cm.ScalarMappable
        The colour scale.
    values : (N,) array, float64
        Values beyond the ends of the scale get the colours of the ends.

    Returns
    -------
    (N, 3) array, float64
        Red, green and blue, from 0 to 1; grey for NaN.
    """
    colours: Array = scale.to_rgba(values)[:, :3]
    colours[np.isnan(values)] = NO_VALUE
    return colours


def add_bar(figure: Figure, place: tuple[float, float, float, float], scale: ScalarMappable, size: float) -> None:
    """Add a colour bar for surface variation to a figure.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    place : (left, bottom, width, height)
        In shares of the figure's size.
    scale : matplotlib.cm.ScalarMappable
        The colour scale.
    size : float
        Size of the label in typographic points.
    """
    from matplotlib.ticker import MaxNLocator

    low, high = scale.get_clim()
    ticks = [tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high]
    axes = figure.add_axes(place)
    bar = figure.colorbar(scale, cax=axes, orientation="horizontal", extend="max", ticks=ticks)
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=size - 2.0, color="0.5", labelcolor="0.35", length=3)
    bar.set_label("surface variation", fontsize=size, color="0.25")


def _limits(values: Array) -> tuple[float, float]:
    """Return the ends of the colour scale for the values (N,) of one cloud."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return 0.0, 1.0
    low, high = min(0.0, float(finite.min())), float(np.percentile(finite, 98))
    return low, high if high > low else low + 1.0
