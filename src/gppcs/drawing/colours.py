"""Converts values to colours, and draws the colour bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLOUR_MAP, DARKEST = "viridis", 0.22  # a colour map, from this place on: darker colours would hide the shading
# The palette of Okabe and Ito, for kinds; the page for the browser has the same.
KINDS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8a7f00", "#7a5195")
NO_VALUE = 0.6  # grey level of NaN
ROOT_SHARE = 98.0  # percentile at which a colour scale of skewed values ends
LINEAR_SHARES = 1.0, 99.0  # percentiles at which other colour scales begin and end


def scale_ends(values: NDArray[Any], root: bool) -> tuple[float, float]:
    """Return where a colour scale of values begins and ends, so that a few extreme ones do not spoil it.

    Shapes: values (N,).
    """
    known = values[np.isfinite(values)].astype(np.float64)
    if len(known) == 0:
        return 0.0, 1.0
    if root:
        return min(0.0, float(known.min())), float(np.percentile(known, ROOT_SHARE))
    first, last = np.percentile(known, LINEAR_SHARES)
    return float(first), float(last)


def colour_scale(clouds: Sequence[NDArray[Any]], root: bool = True) -> ScalarMappable:
    """Return one colour scale for the values of several clouds.

    Shapes: clouds (N,).
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize, PowerNorm

    ends = np.array([scale_ends(values, root) for values in clouds])
    low, high = ends[:, 0].min(), ends[:, 1].max()
    high = high if high > low else low + 1.0
    shades = ListedColormap(colormaps[COLOUR_MAP](np.linspace(DARKEST, 1.0, 256)))
    return ScalarMappable(PowerNorm(0.5, low, high, clip=True) if root else Normalize(low, high, clip=True), shades)


def kinds_scale(kinds: NDArray[Any]) -> ScalarMappable:
    """Return a colour scale with one colour for each kind.

    Shapes: kinds (K,).
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    return ScalarMappable(
        BoundaryNorm(np.arange(len(kinds) + 1) - 0.5, len(kinds)), ListedColormap(KINDS[: len(kinds)])
    )


def colours_of(scale: ScalarMappable, values: Array) -> Array:
    """Return the colours of values.

    Shapes: values (N,); returns (N, 3).
    """
    colours: Array = scale.to_rgba(values)[:, :3]
    colours[np.isnan(values)] = NO_VALUE
    return colours


def add_bar(
    figure: Figure,
    place: tuple[float, float, float, float],
    scale: ScalarMappable,
    size: float,
    label: str = "surface variation",
    kinds: NDArray[Any] | None = None,
) -> None:
    """Add a colour bar to a figure.

    Shapes: kinds (K,).
    """
    from matplotlib.colors import PowerNorm

    axes = figure.add_axes(place)
    extend = "neither" if kinds is not None else "max" if isinstance(scale.norm, PowerNorm) else "both"
    ticks = _ticks(scale) if kinds is None else list(range(len(kinds)))
    bar = figure.colorbar(scale, cax=axes, orientation="horizontal", extend=extend, ticks=ticks)
    if kinds is not None:
        bar.set_ticks(ticks, labels=[f"{float(kind):g}" for kind in kinds])
        bar.minorticks_off()
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=size - 2.0, color="0.5", labelcolor="0.35", length=3)
    bar.set_label(label, fontsize=size, color="0.25", parse_math=False)


def _ticks(scale: ScalarMappable) -> list[float]:
    from matplotlib.ticker import MaxNLocator

    low, high = scale.get_clim()
    return [tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high]
