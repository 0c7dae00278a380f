"""Prepares a COPC file for the page that shows it by level: it holds the first levels, and asks for other nodes."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import unit_of
from gppcs.drawing.attributes import Colourable
from gppcs.drawing.viewpoint import GUESSED, Viewpoint
from gppcs.drawing.web.contents import Page
from gppcs.drawing.web.layers import Layer, Named, Surface, spread
from gppcs.drawing.web.packing import UNKNOWN, Blocks, Quantised, octahedral, quantised_values
from gppcs.io.copc import CopcNodes

FIRST = 20_000  # points of the first levels, at least: they are the first picture, and tell the ranges of values
EXACT = 2  # bytes of whole numbers whose whole range the page can hold
POLICY = b"default-src 'none';"  # of the page, which may load nothing
ALSO_NODES = b" connect-src 'self';"


class Levels:
    """A COPC file by level: `page` is the page with the first levels, `node` returns what it asks for."""

    def __init__(
        self, nodes: CopcNodes, name: str, made: Sequence[tuple[str, str]], viewpoint: Viewpoint = GUESSED
    ) -> None:
        self._nodes, self._name, self._lock = nodes, name, threading.Lock()
        counts = nodes.entries["count"]
        ends = np.flatnonzero(np.diff(nodes.entries["level"], append=-1)) + 1  # of the levels
        self.inside = int(next((end for end in ends if counts[:end].sum() >= FIRST), len(counts)))
        first, blocks = range(self.inside), Blocks()
        _, cloud = nodes.read(first)
        self._names = [key for key, values in cloud.attributes.items() if (values != values[0]).any()]
        named = Named(name, self._telling(cloud))
        layer = _FirstLevels(blocks, named, "original", Surface.of(named))
        rows = np.concatenate([nodes.rows[i] + np.arange(counts[i]) for i in first])
        layer.described["blocks"]["rows"] = blocks.add(rows[layer.shown].astype(np.uint32))
        total = int(counts.sum())
        layer.described |= {"points": total, "octree": self._described()}
        layer.note(f"{len(cloud):,} of {total:,} points are here at once, the others as far as you look at them.")
        self._values, self._full = layer.described["values"], Colourable.of(named.cloud).full
        said: dict[str, Any] = {"title": name, "lead": f"{total:,} points, shown by level", "made": made}
        content = BytesIO()
        Page.of([layer], blocks, viewpoint, **said, diagonal=0.0, unit=unit_of(cloud.header) or "").write(content)
        self.page = content.getvalue().replace(POLICY, POLICY + ALSO_NODES, 1)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self._nodes.entries)

    def _described(self) -> dict[str, Any]:
        """Return what the page needs to know of the octree, as JSON."""
        nodes, info = self._nodes, self._nodes.info
        entries = zip(nodes.entries, nodes.rows, strict=True)
        return {
            "low": (info.center - info.halfsize).tolist(),
            "side": float(2 * info.halfsize),
            "spacing": float(info.spacing),
            "scales": nodes.las.scales.tolist(),
            "offsets": nodes.las.offsets.tolist(),
            "inside": self.inside,
            "nodes": [[int(e["level"]), *e["cell"].tolist(), int(e["count"]), int(row)] for e, row in entries],
        }

    def node(self, number: int) -> bytes:
        """Return the points of a node, in the order of the file, for `readNode` in viewer/src/octree.ts.

        The lowest coordinates, as whole numbers in the file's scale, and the usual spacing; then for all points what is
        added to these coordinates, each quantity in 16 bits, normals, spreads and colours.
        """
        with self._lock:  # to read and to estimate takes all cores
            whole, cloud = self._nodes.read([number])
            surface = Surface.of(Named(self._name, cloud))
            usual, spreads = spread(surface.spacings(), float(self._nodes.las.scales.max()) * 100)
        attributes, low = Colourable.of(self._telling(cloud), self._full), whole.min(axis=0)
        columns = {"z": cloud.points[:, 2]} | {f"attribute:{key}": each for key, each in attributes.columns.items()}
        parts = [
            np.array([*low, usual], "<f8"),
            (whole - low).astype("<u4"),
            *(_numbers(columns[held["key"]], held).astype("<u2") for held in self._values),
            octahedral(surface.normals),
            spreads,
            *([] if attributes.rgb is None else [attributes.rgb]),
        ]
        return b"".join(part.tobytes() for part in parts)

    def _telling(self, cloud: PointCloud) -> PointCloud:
        """Return a cloud without the attributes that are the same at all points of the first levels."""
        return PointCloud(cloud.points, {name: cloud.attributes[name] for name in self._names}, header=cloud.header)


class _FirstLevels(Layer):
    """The first levels, whose values leave room for those of deeper ones."""

    def _add_estimates(self, surface: Surface) -> None:
        """Add the height; surface variation would differ from level to level, as the spacing does."""
        self.add_values("z", "coordinate z", "as in the file", self.cloud.points[:, 2])

    def _held(self, values: NDArray[Any]) -> Quantised:
        """Return a quantity (K,) in a range that holds all that its type can, or twice the range found."""
        if values.dtype.kind in "iu" and values.dtype.itemsize <= EXACT:
            low, step = np.array(np.iinfo(values.dtype).min, np.float64), np.ones(())
        else:
            held = quantised_values(values)
            low, step = np.array(held.low - held.step * (UNKNOWN // 2)), np.array(2 * held.step)
        described = {"low": low, "step": step, "categories": None}
        return Quantised(_numbers(values, described), low, step)


def _numbers(values: NDArray[Any], held: dict[str, Any]) -> NDArray[np.uint16]:
    """Return a quantity (N,) in the numbers by which the page holds it."""
    if held["categories"]:
        kinds = np.array(held["categories"])
        places = np.minimum(np.searchsorted(kinds, values), len(kinds) - 1)
        return np.where(kinds[places] == values, places, UNKNOWN).astype(np.uint16)
    with np.errstate(invalid="ignore"):
        places = np.round((values.astype(np.float64) - held["low"]) / (held["step"] or 1.0))
    known = np.isfinite(places)
    return np.where(known, np.clip(places, 0, UNKNOWN - 1, where=known, out=places), UNKNOWN).astype(np.uint16)
