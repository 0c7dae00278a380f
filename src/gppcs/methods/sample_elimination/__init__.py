"""The method `sample-elimination`: weighted sample elimination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class SampleElimination(Method):
    """Weighted sample elimination.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=100, method=gppcs.SampleElimination()).indices)
    100
    """

    name = "sample-elimination"
    summary = "removes the most crowded point again and again: an even cover with blue noise"
    description = (
        "Removes the most crowded point, the one with the nearest neighbours, again and again. The order is "
        "progressive: the first half of the kept points is evenly spread too, so is the first quarter, and so on."
    )
    source = "Yuksel 2015"
    bytes_per_point: ClassVar[int] = 150

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.methods.sample_elimination.elimination import eliminate

        stages = Stages.of(stages)
        with stages("elimination", len(points) - n_points) as advanced:
            return Selection(eliminate(points, n_points, advanced))
