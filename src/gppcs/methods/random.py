"""The method `random`: random sampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, parameter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Random(Method):
    """Random sampling.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=10, method=gppcs.Random(seed=1)).indices)
    10
    """

    name = "random"
    summary = "random points, all equally likely"
    description = (
        "Chooses the first points of a random permutation, so a smaller selection is the start of a larger one."
    )
    source = "baseline"
    bytes_per_point: ClassVar[int] = 60

    seed: int = parameter(0, "Seed of the permutation.", least=0)

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        stages = Stages.of(stages)
        with stages("permutation"):
            return Selection(np.random.default_rng(self.seed).permutation(len(points))[:n_points])
