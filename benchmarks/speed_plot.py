"""The plot of `speed.py`: seconds over the number of points, for the methods and for the stages of gp."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from clouds import TENTH
from measured import Measured

mpl.use("Agg")
from matplotlib import pyplot as plt

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999", "#7f3c8d")
NEAREST = 1.35  # labels are at least this factor apart

Line = tuple[Sequence[float], Sequence[float]]  # points, seconds


def draw(path: Path, everything: Sequence[Measured], series: Sequence[Measured], tenths: Sequence[Measured]) -> None:
    """Draw the methods on all clouds but the tenths, and the stages of gp on both series of one shape."""
    everything = [each for each in everything if each.cloud.amount != TENTH]
    scene = [each for each in everything if each not in series and each.cloud.size > 1_000_000]
    rest = [each for each in everything if each not in scene]
    figure, (left, *others) = plt.subplots(1, 3, figsize=(18, 5.5), layout="constrained")
    methods = dict.fromkeys(method for each in series for method in each.runs)
    draw_lines(left, {name: line(rest, lambda each, name=name: seconds_of(each, name)) for name in methods})
    for each in scene:
        place, colour = (each.cloud.size, seconds_of(each, "gp")), COLOURS[0]
        left.plot(*place, "D", color=colour, markerfacecolor="white", zorder=3)
        left.annotate("gp, flat scene", place, (7, -12), textcoords="offset points", color=colour, fontsize=9)
    left.set_title("methods; 5 % of the smaller two clouds kept, else 28,000 points")
    for axes, clouds, kept in zip(others, (series, tenths), ("28,000 points", "a tenth"), strict=True):
        timer = dict.fromkeys(stage for each in clouds for stage in each.runs["gp"].timer)
        draw_lines(
            axes,
            {name: line(clouds, lambda each, name=name: each.runs["gp"].timer.get(name, np.nan)) for name in timer},
        )
        axes.set_title(f"stages of gp; {kept} of the Dragon kept")
    figure.savefig(path, dpi=120)


def seconds_of(each: Measured, method: str) -> float:
    """Return the seconds of a method on a cloud; NaN if it was left out."""
    return each.runs[method].seconds if method in each.runs else np.nan


def line(measured: Sequence[Measured], seconds: Callable[[Measured], float]) -> Line:
    """Return points and seconds of several clouds. Of two clouds of one size, the one with more kept points counts."""
    kept = {each.cloud.size: each for each in sorted(measured, key=lambda each: each.cloud.n_points)}
    known = sorted((size, value) for size, each in kept.items() if np.isfinite(value := seconds(each)))
    return tuple(zip(*known, strict=True))


def draw_lines(axes: Axes, lines: Mapping[str, Line]) -> None:
    """Draw lines with their names at their ends, and a line of slope 1."""
    for (sizes, seconds), colour in zip(lines.values(), COLOURS, strict=False):
        axes.plot(sizes, seconds, "o-", color=colour, markersize=4, linewidth=1.6)
    axes.set(xscale="log", yscale="log", xlabel="points", ylabel="seconds")
    axes.grid(which="major", color="0.9")
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * 3)  # room for the names
    guide = np.array([min(sizes[0] for sizes, _ in lines.values()), max(sizes[-1] for sizes, _ in lines.values())])
    top = 2 * max(max(seconds) for _, seconds in lines.values())  # above all lines
    axes.plot(guide, top * guide / guide[1], "--", color="0.6", linewidth=1, zorder=0)
    axes.annotate("slope 1", (guide[0], top * guide[0] / guide[1]), (0, 14), textcoords="offset points", color="0.4")
    label(axes, lines)


def label(axes: Axes, lines: Mapping[str, Line]) -> None:
    """Write each name beside the end of its line, in its colour. Names that would overlap are moved up.

    If a line ends early, its name is above its end.
    """
    places: list[tuple[float, float]] = []
    ends = sorted(
        (sizes[-1], seconds[-1], name, colour)
        for (name, (sizes, seconds)), colour in zip(lines.items(), COLOURS, strict=False)
    )
    for size, value, name, colour in ends:
        height = value
        while any(size == other and height < near * NEAREST and height > near / NEAREST for other, near in places):
            height *= 1.02
        places.append((size, height))
        early = size < ends[-1][0]
        offset, side = ((0, 9), "center") if early else ((7, 0), "left")
        axes.annotate(
            name, (size, height), offset, textcoords="offset points", ha=side, va="center", color=colour, fontsize=9
        )
