"""Random choice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Random(Method):
    """The first points of a random permutation, so that a smaller choice is the start of a larger one.

    Parameters
    ----------
    seed : int
        Of the permutation.
    """

    name = "random"
    summary = "points drawn at random, all alike"
    source = "baseline"

    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.seed >= 0, "seed", "at least 0")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        stages = stages or Stages()
        with stages("permutation"):
            return Selection(np.random.default_rng(self.seed).permutation(len(points))[:n_points])
