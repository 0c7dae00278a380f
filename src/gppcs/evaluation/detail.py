"""How far attributes of a cloud are from those of a simplified one: colours, numbers and classes."""

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.ranges import AttributeRange
from gppcs.engine.arrays import Floats
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import normalised
from gppcs.surface.local_surface import LocalSurface

Pair = tuple[Floats, Floats]


def attribute_errors(original: PointCloud, simplified: PointCloud, names: list[str]) -> dict[str, Pair]:
    """Return how far attributes of the original are from those of the simplified cloud, in ranges, (N,) each.

    First from the values interpolated in the nearest triangle of the local surface, then from the nearest kept point.
    Both clouds have finite coordinates.
    """
    if not names:
        return {}
    ranges = [AttributeRange.from_cloud(original, name) for name in names]
    points, frame = normalised(simplified.points, original.units)
    first = first_occurrences(points)
    kept = simplified.take(np.flatnonzero(first))
    surface = LocalSurface.from_points(points[first])
    errors = {name: (np.empty(len(original)), np.empty(len(original))) for name in names}
    of_kept = [attribute.values(kept).astype(np.float64) for attribute in ranges]
    at_once = 1 << 20  # points, to bound the memory
    for start in range(0, len(original), at_once):
        part = slice(start, start + at_once)
        chunk = original.take(np.arange(len(original))[part])
        queries = frame.near(chunk.points)
        nearest = surface.tree.nearest_of(queries, 1)[0][:, 0]
        for attribute, values in zip(ranges, of_kept, strict=True):
            true, (interpolated, of_nearest) = attribute.values(chunk), errors[attribute.name]
            interpolated[part] = np.linalg.norm(surface.values_at(queries, values) - true, axis=1)
            of_nearest[part] = np.linalg.norm(values[nearest] - true, axis=1)
    return errors
