"""Prepares a COPC file for the page that shows it by level: it holds the first levels, and asks for other nodes."""

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import unit_of
from gppcs.drawing.camera import GUESSED, Viewpoint
from gppcs.drawing.colours import Colourable
from gppcs.drawing.web.contents import Page
from gppcs.drawing.web.layers import CloudSurface, Layer, Named, spread
from gppcs.drawing.web.packing import UNKNOWN, Blocks, Quantised, octahedral, quantised_values
from gppcs.io.copc import CopcNodes

NODE_MEASURED = 4_000  # points of a node: a page waits for many nodes, one after the other
FIRST = 20_000  # points of the first levels, at least: they are the first picture, and give the ranges of values


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
        named = Named(name, self._varying(cloud))
        layer = _FirstLevels(blocks, named, "original", CloudSurface.from_cloud(named))
        indices = np.concatenate([nodes.starts[i] + np.arange(counts[i]) for i in first])
        layer.described["blocks"]["rows"] = blocks.add(indices[layer.shown].astype(np.uint32))
        total = int(counts.sum())
        layer.described |= {"points": total, "octree": self._described()}
        layer.note(f"{len(cloud):,} of {total:,} points are here at once, the others as far as you look at them.")
        self._values, self._full = layer.described["values"], Colourable.from_cloud(named.cloud).full
        said: dict[str, Any] = {"title": name, "lead": f"{total:,} points, shown by level", "made": made}
        page = Page.from_layers([layer], blocks, viewpoint, **said, diagonal=0.0, unit=unit_of(cloud.header) or "")
        policy = b"default-src 'none';"  # the page may load nothing but nodes
        self.page = page.content().replace(policy, policy + b" connect-src 'self';", 1)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self._nodes.entries)

    def _described(self) -> dict[str, Any]:
        """Return what the page needs to know of the octree, as JSON."""
        nodes, info = self._nodes, self._nodes.info
        entries = zip(nodes.entries, nodes.starts, strict=True)
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
        """Return the points of a node, in the order of the file, for `readNode` in viewer/src/octree.ts."""
        with self._lock:  # to read and to estimate takes all cores
            integers, cloud = self._nodes.read([number])
            surface = CloudSurface.from_cloud(Named(self._name, cloud), maximum=NODE_MEASURED)
            usual, spreads = spread(surface.spacings, float(self._nodes.las.scales.max()) * 100)
        attributes, lower = Colourable.from_cloud(self._varying(cloud), self._full), integers.min(axis=0)
        columns = {"z": cloud.points[:, 2]} | {f"attribute:{key}": column for key, column in attributes.columns.items()}
        parts = [
            np.array([*lower, usual], "<f8"),
            (integers - lower).astype("<u4"),
            *(_numbers(columns[held["key"]], held).astype("<u2") for held in self._values),
            octahedral(surface.normals),
            spreads,
            *([] if attributes.rgb is None else [attributes.rgb]),
        ]
        return b"".join(part.tobytes() for part in parts)

    def _varying(self, cloud: PointCloud) -> PointCloud:
        """Return a cloud without the attributes that are the same at all points of the first levels."""
        return PointCloud(cloud.points, {name: cloud.attributes[name] for name in self._names}, header=cloud.header)


class _FirstLevels(Layer):
    """The first levels, whose values leave room for those of deeper ones."""

    def _add_estimates(self, surface: CloudSurface) -> None:
        """Add the height; surface variation would differ from level to level, as the spacing does."""
        self.add_values("z", "coordinate z", "as in the file", self.cloud.points[:, 2])

    def _held(self, values: NDArray[Any]) -> Quantised:
        """Return a quantity (K,) in a range that holds all that its type can, or twice the range found."""
        if values.dtype.kind in "iu" and values.dtype.itemsize <= 2:
            lower, step = np.array(np.iinfo(values.dtype).min, np.float64), np.ones(())
        else:
            held = quantised_values(values)
            lower, step = np.array(held.lower - held.step * (UNKNOWN // 2)), np.array(2 * held.step)
        described = {"low": lower, "step": step, "categories": None}
        return Quantised(_numbers(values, described), lower, step)


def _numbers(values: NDArray[Any], held: dict[str, Any]) -> NDArray[np.uint16]:
    """Return a quantity (N,) in the numbers by which the page holds it."""
    if held["categories"]:
        kinds = np.array(held["categories"])
        numbers = np.minimum(np.searchsorted(kinds, values), len(kinds) - 1)
        return np.where(kinds[numbers] == values, numbers, UNKNOWN).astype(np.uint16)
    with np.errstate(invalid="ignore"):
        numbers = np.round((values.astype(np.float64) - held["low"]) / (held["step"] or 1.0))
    finite = np.isfinite(numbers)
    return np.where(finite, np.clip(numbers, 0, UNKNOWN - 1, where=finite, out=numbers), UNKNOWN).astype(np.uint16)
