"""Colours a cloud by RGB or an attribute, or by surface variation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.drawing.attributes import RGB, VARIATION, Colourable, kinds_of
from gppcs.drawing.cloud_images import ColouredCloud
from gppcs.drawing.colours import Legend


def painted(cloud: PointCloud, colour: str | None) -> tuple[ColouredCloud, Legend | None]:
    """Return a cloud as the original of a picture that compares."""
    attributes = Colourable.of(cloud)
    if colour is None or (colour == VARIATION and VARIATION not in attributes.columns):
        return ColouredCloud.by_surface_variation(cloud.points), None
    colours, legend = _paint(attributes, colour)
    return replace(ColouredCloud.by_surface_variation(cloud.points), colours=colours), legend


def _paint(attributes: Colourable, colour: str) -> tuple[NDArray[np.float64], Legend]:
    """Return the colours (N, 3) of points by an attribute or by RGB."""
    attributes.require(colour)
    if colour == RGB and RGB not in attributes.columns:
        assert attributes.rgb is not None
        return attributes.rgb / 255.0, Legend("RGB")
    values = attributes.columns[colour]
    kinds = kinds_of(values)
    legend = Legend.of_amounts([values], colour, root=False) if kinds is None else Legend.of_kinds(kinds, colour)
    return legend.colours_of(values), legend
