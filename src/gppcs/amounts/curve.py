"""The error of a simplification over its number of points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.amounts.accuracy import Original
from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.quantities import MEASURES, Measure, size_of
from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import Timer
from gppcs.errors import ParameterError, one_of, shown
from gppcs.methods import Method

SHARES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # sizes of a curve, if no others are asked for
FEWEST = 10  # points of such a size, at least
FEWEST_FOR_KNEE = 3  # sizes: between two there is none


@dataclass(frozen=True, eq=False)
class Curve(ComparedByValue):
    """The errors of simplifications of one cloud to several numbers of points.

    Attributes
    ----------
    method : Method
        What has made them.
    sizes : (k,) array, int64
        Numbers of points, ascending.
    errors : mapping of str to (k,) array
        "mean", "rms", "p95" and "max": the figures `surface_mean` to `surface_max` of `gppcs.Report`, in the unit of
        the cloud.
    diagonal : float
        Of the bounding box of the original.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> (curve,) = gppcs.curve(cloud, ["fps"], sizes=[50, 100, 200])
    >>> isinstance(curve, gppcs.Curve)
    True
    >>> curve.sizes, curve.errors["mean"].shape, curve.knee()
    (array([ 50, 100, 200]), (3,), 100)
    """

    method: Method
    sizes: NDArray[np.int64]
    errors: Mapping[Measure, NDArray[np.float64]]
    diagonal: float

    @property
    def has_knee(self) -> bool:
        """Whether there are enough sizes for a knee between the ends of the curve: at least three."""
        return len(self.sizes) >= FEWEST_FOR_KNEE

    def knee(self, measure: Measure = "p95") -> int:
        """Return the size from which on more points gain little.

        It is the point of the curve that is farthest below the line between its ends, if the errors and the numbers of
        points are both scaled to 0 to 1 (Satopää et al. 2011). So it depends on the range of the sizes.

        Parameters
        ----------
        measure : str
            Which error counts.

        Returns
        -------
        int
            One of the sizes. It means little unless `has_knee`.

        Raises
        ------
        ParameterError
            If there is no such error.
        """
        one_of("measure", measure, MEASURES)
        below = 1.0 - _scaled(self.sizes) - _scaled(self.errors[measure])
        return int(self.sizes[int(np.argmax(below))])


def _scaled(values: NDArray[Any]) -> NDArray[np.float64]:
    least, most = float(values.min()), float(values.max())
    return (values - least) / (most - least) if most > least else np.zeros(len(values))


def measured_curve(
    original: PointCloud, method: Method, sizes: NDArray[np.int64], kept: Callable[[int], PointCloud], timer: Timer
) -> Curve:
    """Measure simplifications of a cloud. Shapes: sizes (k,)."""
    from gppcs.spatial.cells import first_occurrences
    from gppcs.spatial.scaling import Frame, bounds

    low, high = bounds(original.points)
    frame = Frame.around(low, high)
    places = frame.local(original.points)
    measured = Original.of(places[first_occurrences(places)])
    found = []
    for size in sizes[::-1].tolist():
        simplified = kept(size).points
        with timer("accuracy"):
            found.append(measured.errors(np.ldexp(simplified - frame.corner, -frame.exponent)))
    with np.errstate(over="ignore", under="ignore"):
        errors = {name: np.ldexp([each[name] for each in found[::-1]], frame.exponent) for name in MEASURES}
        diagonal = float(np.ldexp(np.linalg.norm(np.ldexp(high - low, -frame.exponent)), frame.exponent))
    return Curve(method, sizes, errors, diagonal)


def checked_sizes(sizes: Any, n: int) -> NDArray[np.int64]:
    """Return the numbers of points, ascending, that sizes such as 500, "5k" and "1%" of n points mean."""
    is_list = isinstance(sizes, list | tuple) or (isinstance(sizes, np.ndarray) and sizes.ndim == 1)
    if not is_list or not len(sizes):
        raise ParameterError(f"expected sizes such as [0.01, 0.1] or [500, 5000], found {shown(sizes)}")
    wanted = [size_of("sizes", size) for size in sizes]
    counts = [max(1, round(size * n)) if size < 1 else min(size, n) for size in wanted]
    return np.unique(np.array(counts, dtype=np.int64))


def usual_sizes(n: int) -> NDArray[np.int64]:
    """Return the sizes of a curve of a cloud. Shapes: returns (k,)."""
    return np.unique([min(max(FEWEST, round(share * n)), n) for share in SHARES])


def halves(n: int) -> NDArray[np.int64]:
    """Return the sizes of the curve of a ranking. Shapes: returns (k,)."""
    sizes = n // 2 ** np.arange(n.bit_length())
    return np.unique(sizes[(sizes >= FEWEST) | (sizes == n)])
