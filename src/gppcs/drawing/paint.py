"""Colours a cloud by RGB or an attribute, or by surface variation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.drawing.attributes import RGB, Colourable, kinds_of
from gppcs.drawing.cloud_images import ColouredCloud
from gppcs.drawing.colours import add_bar, colour_scale, colours_of, kinds_scale

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SURFACE_VARIATION = "surface variation"  # its title


@dataclass(frozen=True)
class Legend:
    """What the colours of a picture show."""

    title: str
    scale: ScalarMappable | None = None
    kinds: NDArray[Any] | None = None

    @classmethod
    def of_amounts(cls, title: str, clouds: Sequence[Array], root: bool) -> Legend:
        """Return the legend of one quantity of several clouds.

        Shapes: clouds (N,).
        """
        unknown = any(np.isnan(values).any() for values in clouds)
        return cls(f"{title} (grey: unknown)" if unknown else title, colour_scale(clouds, root))

    def colours_of(self, cloud: ColouredCloud) -> Array:
        """Return the colours (N, 3) of a cloud: its own if it has some, otherwise those of its values."""
        if cloud.colours is not None:
            return cloud.colours
        assert self.scale is not None
        return colours_of(self.scale, cloud.values)

    def add_bar(self, figure: Figure, place: tuple[float, float, float, float], size: float) -> None:
        """Add a colour bar to a figure, as the function `add_bar` does; none for RGB."""
        if self.scale is not None:
            add_bar(figure, place, self.scale, size, self.title, self.kinds)


@dataclass(frozen=True)
class Paint:
    """The colours of a cloud."""

    legend: Legend
    colours: Array | None

    @classmethod
    def of(cls, attributes: Colourable, colour: str) -> Paint:
        """Return colours by an attribute or by RGB."""
        attributes.require(colour)
        if colour == RGB and RGB not in attributes.columns:
            assert attributes.rgb is not None
            return cls(Legend("RGB"), attributes.rgb / 255.0)
        values = attributes.columns[colour]
        kinds = kinds_of(values)
        if kinds is None:
            return cls.by_amounts(colour, values.astype(np.float64), root=False)
        scale = kinds_scale(kinds)
        return cls(Legend(colour, scale, kinds), colours_of(scale, np.searchsorted(kinds, values).astype(np.float64)))

    @classmethod
    def by_amounts(cls, title: str, values: Array, root: bool) -> Paint:
        """Return colours by the values (N,) of a quantity; title and root are as for `Legend.of_amounts`."""
        legend = Legend.of_amounts(title, [values], root)
        assert legend.scale is not None
        return cls(legend, colours_of(legend.scale, values))


def painted(cloud: PointCloud, colour: str | None) -> tuple[ColouredCloud, Legend | None]:
    """Return a cloud as the original of a picture that compares."""
    original, attributes = ColouredCloud.by_surface_variation(cloud.points), Colourable.of(cloud)
    if colour is None or attributes.means_variation(colour):
        return original, None
    paint = Paint.of(attributes, colour)
    return replace(original, colours=paint.colours), paint.legend
