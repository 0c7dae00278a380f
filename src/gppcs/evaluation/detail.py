"""How far attributes of a cloud are from those of a simplified one: colours, numbers and classes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.ranges import AttributeRange
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.scaling import normalised
from gppcs.surface.local_surface import LocalSurface

AT_ONCE = 1 << 20  # Original points whose attributes are compared at once.


class AttributeErrors(NamedTuple):
    """How far an attribute of each of N original points is from that of the simplified cloud there, in ranges."""

    # (N,), from the values interpolated linearly in the nearest triangle of the local surface.
    interpolated: NDArray[np.float64]
    nearest: NDArray[np.float64]  # (N,), from the value of the nearest kept point


def attribute_errors(original: PointCloud, simplified: PointCloud, names: list[str]) -> dict[str, AttributeErrors]:
    """Return the errors of some attributes. Both clouds have finite coordinates."""
    ranges = [AttributeRange.of(original, name) for name in names]
    places, corner, exponent = normalised(simplified.points)
    first = first_occurrences(places)
    kept = simplified.take(np.flatnonzero(first))
    surface = LocalSurface.from_points(places[first])
    found = {name: AttributeErrors(np.empty(len(original)), np.empty(len(original))) for name in names}
    of_kept = [known.values(kept).astype(np.float64) for known in ranges]
    for start in range(0, len(original), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        chunk = original.take(np.arange(len(original))[some])
        queries = np.ldexp(chunk.points - corner, -exponent)
        nearest = surface.tree.nearest_of(queries, 1)[0][:, 0]
        for known, values in zip(ranges, of_kept, strict=True):
            true, errors = known.values(chunk), found[known.name]
            errors.interpolated[some] = np.linalg.norm(surface.values_at(queries, values) - true, axis=1)
            errors.nearest[some] = np.linalg.norm(values[nearest] - true, axis=1)
    return found
