"""What the colours of points can show, the colours of values, and the legend that explains them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.colours import eight_bits, full_scale
from gppcs.clouds.columns import CLASS_NAMES, CLASSIFICATION
from gppcs.clouds.lookup import bounded
from gppcs.clouds.ranges import CLASSES
from gppcs.engine.arrays import Floats
from gppcs.errors import ParameterError, nearest_name, shown

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

RGB, VARIATION = "rgb", "variation"  # colourings that are no attributes; an attribute of that name wins
# The palette of Okabe and Ito, for kinds; the page for the browser has the same.
KINDS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8a7f00", "#7a5195")
MAX_CLASSES = 32  # that have a colour each; more numbers count as amounts


@dataclass(frozen=True)
class Colourable:
    """The attributes of numbers of a cloud, its RGB, and which value of it in the cloud is the brightest possible."""

    columns: dict[str, NDArray[Any]]
    rgb: NDArray[np.uint8] | None
    full: float | None = None

    @classmethod
    def from_cloud(cls, cloud: PointCloud, full: float | None = None) -> Colourable:
        """Return the attributes of a cloud as single columns; `full` is the brightest value of colours, if known."""
        columns: dict[str, NDArray[Any]] = {}
        for name, values in cloud.attributes.items():
            if values.dtype.kind in "biuf":
                flat = values.reshape(len(values), -1).T
                columns |= {name if values.ndim == 1 else f"{name} {i}": column for i, column in enumerate(flat)}
        triples = [["red", "green", "blue"], ["r", "g", "b"]]
        triples += [[f"{name} {i}" for i in range(3)] for name in ("rgb", "color", "colors")]
        names = next((names for names in triples if set(names) <= set(columns)), None)
        if names is None:
            return cls(columns, None)
        colours = np.stack([columns.pop(name) for name in names], axis=1)
        full = full or full_scale(colours)
        return cls(columns, eight_bits(colours, full), full)

    def require(self, colour: str) -> None:
        """Raise an error if the cloud cannot be coloured so."""
        names = [*([] if self.rgb is None else [RGB]), VARIATION, *self.columns]
        if colour not in names:
            actual = f"{shown(colour)}{nearest_name(colour, names)}"
            raise ParameterError(f"expected a colour or an attribute of numbers that the cloud has, found {actual}")


def kinds_of(values: NDArray[Any], title: str) -> NDArray[Any] | None:
    """Return the different values (K,) of a quantity if they are few kinds, or classes, rather than amounts."""
    if np.issubdtype(values.dtype, np.floating):
        return None
    kinds = np.unique(values)
    return kinds if 0 < len(kinds) <= (MAX_CLASSES if title in CLASSES else len(KINDS)) else None


def _kind_colours(count: int) -> Floats:
    """Return the colours (K, 3) of kinds, as the page has them: the palette, then that lightened, and so on in turn."""
    from matplotlib.colors import to_rgb

    colours = np.array([to_rgb(KINDS[number % len(KINDS)]) for number in range(count)])
    lightened = 0.55 * (np.arange(count) // len(KINDS) % 2)[:, np.newaxis]
    return colours + lightened * (1.0 - colours)


@dataclass(frozen=True)
class Legend:
    """What the colours of a picture show; RGB has no scale."""

    title: str
    scale: ScalarMappable | None = None
    kinds: NDArray[Any] | None = None

    @classmethod
    def of_amounts(cls, clouds: Sequence[NDArray[Any]], title: str = "surface variation", root: bool = True) -> Legend:
        """Return the legend of one quantity, (N,) each, of several clouds."""
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import ListedColormap, Normalize, PowerNorm

        starts, ends = zip(*(scale_ends(values, root) for values in clouds), strict=True)
        start, end = min(starts), max(ends)
        end = end if end > start else start + 1.0
        norm = PowerNorm(0.5, start, end, clip=True) if root else Normalize(start, end, clip=True)
        shades = ListedColormap(colormaps["viridis"](np.linspace(0.22, 1.0, 256)))  # darker ones would hide the shading
        unknown = any(np.isnan(values).any() for values in clouds)
        return cls(f"{title} (grey: unknown)" if unknown else title, ScalarMappable(norm, shades))

    @classmethod
    def of_kinds(cls, kinds: NDArray[Any], title: str) -> Legend:
        """Return a legend with one colour for each kind (K,)."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import BoundaryNorm, ListedColormap

        norm = BoundaryNorm(np.arange(len(kinds) + 1) - 0.5, len(kinds))
        return cls(title, ScalarMappable(norm, ListedColormap(_kind_colours(len(kinds)))), kinds)

    def colours_of(self, values: NDArray[Any]) -> Floats:
        """Return the colours (N, 3) of values (N,)."""
        assert self.scale is not None
        shown_values = values if self.kinds is None else np.searchsorted(self.kinds, values)
        colours = self.scale.to_rgba(shown_values.astype(np.float64))[:, :3]
        colours[np.isnan(values)] = 0.6
        return colours

    def add_bar(self, figure: Figure, box: tuple[float, float, float, float], size: float) -> None:
        """Add a colour bar to a figure; none for RGB."""
        from matplotlib.colors import PowerNorm
        from matplotlib.ticker import MaxNLocator

        if self.scale is None:
            return
        if self.kinds is not None:
            self._add_kinds(figure, box, size)
            return
        axes = figure.add_axes(box)
        extend = "max" if isinstance(self.scale.norm, PowerNorm) else "both"
        start, end = self.scale.get_clim()
        ticks = [tick for tick in MaxNLocator(4).tick_values(start, end) if start <= tick <= end]
        bar = figure.colorbar(self.scale, axes, orientation="horizontal", extend=extend, ticks=ticks)
        bar.outline.set_visible(False)
        axes.tick_params(labelsize=size - 2.0, color="0.5", labelcolor="0.35", length=3)
        bar.set_label(self.title, fontsize=size, color="0.25", parse_math=False)

    def _add_kinds(self, figure: Figure, box: tuple[float, float, float, float], size: float) -> None:
        """Add a colour and a name for each kind to a figure, in as many columns as fit."""
        from matplotlib.patches import Patch

        assert self.kinds is not None
        names = [name_of_kind(self.title, kind) for kind in self.kinds]
        longest = max(map(len, names)) + 5  # with the patch and what is around it
        letters = 0.9 * 72.0 * figure.get_figwidth() / (0.6 * (size - 2.0))  # that fit side by side
        patches = [Patch(color=colour) for colour in self.colours_of(self.kinds)]
        figure.legend(
            patches, names, loc="center", bbox_to_anchor=(0.5, box[1] + box[3] / 2.0), title=self.title,
            ncols=max(1, min(len(names), int(letters / longest))), fontsize=size - 2.0, title_fontsize=size,
            frameon=False, labelcolor="0.25",
        )  # fmt: skip


def name_of_kind(title: str, kind: float) -> str:
    """Return what the legend of a quantity calls a kind."""
    name = CLASS_NAMES[int(kind)] if title == CLASSIFICATION and 0 <= kind < len(CLASS_NAMES) else ""
    return f"{float(kind):g} {name}".rstrip()


def scale_ends(values: NDArray[Any], root: bool) -> tuple[float, float]:
    """Return where a colour scale of values (N,) begins and ends, so that a few extreme ones do not spoil it."""
    finite = bounded(values[np.isfinite(values)])
    if len(finite) == 0:
        return 0.0, 1.0
    first, last = np.percentile(finite, (0.0, 98.0) if root else (1.0, 99.0))
    return float(min(0.0, first) if root else first), float(last)
