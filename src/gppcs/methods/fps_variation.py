"""Farthest points, then the points of largest surface variation: what the paper's published tables come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, largest, random_candidates

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class FarthestPointVariation(Method):
    """Farthest points, then the points of largest surface variation among the rest.

    Parameters
    ----------
    k_init : int, optional
        The number of farthest points; a third of the points asked for where not given.
    neighbours : int
        About how many points a neighbourhood holds.
    candidates : int, optional
        Choose among so many random points, as the paper does on large clouds; among all where not given. The
        surface variation is that of the whole cloud either way.
    seed : int
        Of that choice.
    """

    name = "fps-variation"
    summary = "farthest points, then the points of largest surface variation"
    source = "the paper's ablation table is reproduced by it; see benchmarks/paper/ablation.py"

    k_init: int | None = None
    neighbours: int = 25
    candidates: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.k_init is None or self.k_init >= 1, "k_init", "at least 1")
        self.require(self.neighbours >= 3, "neighbours", "at least 3")
        self.require(self.candidates is None or self.candidates >= 1, "candidates", "at least 1")
        self.require(self.seed >= 0, "seed", "at least 0")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        from gppcs.spatial.farthest_points import farthest_points
        from gppcs.surface.surface_variation import estimate_features

        stages = stages or Stages()
        with stages("surface variation"):
            variation = estimate_features(points, self.neighbours).surface_variation
        subset = random_candidates(len(points), self.candidates, n_points, self.seed)
        points, variation = points[subset], variation[subset]
        k_init = min(self.k_init or max(1, n_points // 3), n_points)
        with stages("farthest points", k_init) as advanced:
            initial, _ = farthest_points(points, k_init, advanced=advanced)
        variation[initial] = -np.inf
        indices = np.concatenate([initial, largest(variation, n_points - k_init)])
        return Selection(subset[indices])
