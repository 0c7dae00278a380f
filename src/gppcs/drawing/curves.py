"""Draws the error of methods over the number of points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import BinaryIO

from gppcs.amounts.curve import Curve
from gppcs.clouds.quantities import Measure
from gppcs.engine.extras import require_matplotlib

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")


def draw_curves(file: BinaryIO, curves: Sequence[Curve], measure: Measure) -> None:
    """Write a PNG of curves. A ring marks the knee of each that has one."""
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5.5), dpi=120, layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    for number, each in enumerate(curves):
        colour, errors = COLOURS[number % len(COLOURS)], each.errors[measure]
        shown = errors > 0.0  # on a logarithmic axis
        axes.plot(each.sizes[shown], errors[shown], "o-", color=colour, markersize=4, label=str(each.method))
        knee = (each.sizes == each.knee(measure)) & each.has_knee & shown
        axes.plot(each.sizes[knee], errors[knee], "o", color=colour, markersize=12, markerfacecolor="none")
    axes.set(xscale="log", yscale="log", xlabel="points kept", ylabel=f"{measure} error, unit of the coordinates")
    axes.grid(which="major", color="0.9")
    axes.legend(frameon=False)
    figure.savefig(file, format="png")
