"""The colours of values, and the legend that explains them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.lookup import bounded

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

SURFACE_VARIATION = "surface variation"  # its title
COLOUR_MAP, DARKEST = "viridis", 0.22  # a colour map, from this place on: darker colours would hide the shading
# The palette of Okabe and Ito, for kinds; the page for the browser has the same.
KINDS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8a7f00", "#7a5195")
NO_VALUE = 0.6  # grey level of NaN
ROOT_SHARE = 98.0  # percentile at which a colour scale of skewed values ends
LINEAR_SHARES = 1.0, 99.0  # percentiles at which other colour scales begin and end


@dataclass(frozen=True)
class Legend:
    """What the colours of a picture show; RGB has no scale."""

    title: str
    scale: ScalarMappable | None = None
    kinds: NDArray[Any] | None = None

    @classmethod
    def of_amounts(cls, clouds: Sequence[NDArray[Any]], title: str = SURFACE_VARIATION, root: bool = True) -> Legend:
        """Return the legend of one quantity, (N,) each, of several clouds."""
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import ListedColormap, Normalize, PowerNorm

        lows, highs = zip(*(scale_ends(values, root) for values in clouds), strict=True)
        low, high = min(lows), max(highs)
        high = high if high > low else low + 1.0
        norm = PowerNorm(0.5, low, high, clip=True) if root else Normalize(low, high, clip=True)
        shades = ListedColormap(colormaps[COLOUR_MAP](np.linspace(DARKEST, 1.0, 256)))
        unknown = any(np.isnan(values).any() for values in clouds)
        return cls(f"{title} (grey: unknown)" if unknown else title, ScalarMappable(norm, shades))

    @classmethod
    def of_kinds(cls, kinds: NDArray[Any], title: str) -> Legend:
        """Return a legend with one colour for each kind (K,)."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import BoundaryNorm, ListedColormap

        norm = BoundaryNorm(np.arange(len(kinds) + 1) - 0.5, len(kinds))
        return cls(title, ScalarMappable(norm, ListedColormap(KINDS[: len(kinds)])), kinds)

    def colours_of(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Return the colours (N, 3) of values (N,)."""
        assert self.scale is not None
        places = values if self.kinds is None else np.searchsorted(self.kinds, values)
        colours = self.scale.to_rgba(places.astype(np.float64))[:, :3]
        colours[np.isnan(values)] = NO_VALUE
        return colours

    def add_bar(self, figure: Figure, place: tuple[float, float, float, float], size: float) -> None:
        """Add a colour bar to a figure; none for RGB."""
        from matplotlib.colors import PowerNorm
        from matplotlib.ticker import MaxNLocator

        if self.scale is None:
            return
        axes = figure.add_axes(place)
        if self.kinds is None:
            extend = "max" if isinstance(self.scale.norm, PowerNorm) else "both"
            low, high = self.scale.get_clim()
            ticks = [tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high]
            bar = figure.colorbar(self.scale, axes, orientation="horizontal", extend=extend, ticks=ticks)
        else:
            bar = figure.colorbar(self.scale, axes, orientation="horizontal")
            bar.set_ticks(range(len(self.kinds)), labels=[f"{float(kind):g}" for kind in self.kinds])
            bar.minorticks_off()
        bar.outline.set_visible(False)
        axes.tick_params(labelsize=size - 2.0, color="0.5", labelcolor="0.35", length=3)
        bar.set_label(self.title, fontsize=size, color="0.25", parse_math=False)


def scale_ends(values: NDArray[Any], root: bool) -> tuple[float, float]:
    """Return where a colour scale of values (N,) begins and ends, so that a few extreme ones do not spoil it."""
    known = bounded(values[np.isfinite(values)])
    if len(known) == 0:
        return 0.0, 1.0
    first, last = np.percentile(known, (0.0, ROOT_SHARE) if root else LINEAR_SHARES)
    return float(min(0.0, first) if root else first), float(last)
