"""The paper's criterion with a full-rank, local Matérn field: the default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.gp.local.ranking import Criterion


@dataclass(frozen=True)
class LocalGP(Method):
    """A local, full-rank Gaussian process of the surface variation, and greedy choice by uncertainty plus error.

    Its order is a ranking: each prefix is a simplification of its size. Its attributes are each point's score and the
    field's standard deviation there when it was chosen, in units of that before any choice. The diagnostic
    "noise_in_spacings" is the root mean square distance of the points from the surface, in target spacings. Noise below
    0.04 is ignored. It is 0 where too few points lie near each other to measure it. Detail of about the size of the
    target spacing counts as noise, too.

    Parameters
    ----------
    feature_weight : float
        From 0, an even cover, to 1, points crowded where the surface is rough.
    lengthscale : float
        Of the Matérn kernel, in units of the spacing of the points to be chosen.
    neighbours : int
        How many chosen points the field at a point is conditioned on.
    candidates : float
        How many cells of the candidates' grid there are to the square of the target spacing.
    """

    name = "gp"
    summary = "a local Gaussian process of full rank: features kept, nothing left bare, a ranking"
    source = "the criterion of GP-PCS, Algorithm 1; the field is our own, see docs/local-field.md"
    attributes = ("score", "deviation")

    feature_weight: float = 0.5
    lengthscale: float = 1.5
    neighbours: int = 4
    candidates: float = 8.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(0 <= self.feature_weight <= 1, "feature_weight", "from 0 to 1")
        self.require(0.1 <= self.lengthscale <= 100, "lengthscale", "from 0.1 to 100")
        self.require(1 <= self.neighbours <= 64, "neighbours", "from 1 to 64")
        self.require(3 <= self.candidates <= 1000, "candidates", "from 3 to 1000")

    @property
    def criterion(self) -> Criterion:
        """What the selection weighs at this `feature_weight`."""
        from gppcs.gp.local.ranking import Criterion

        return Criterion(
            density_power=2.0 * self.feature_weight,
            normal_weight=2.8 * self.feature_weight,
            error_weight=max(0.0, 2.0 * self.feature_weight - 1.0) ** 2,
            lengthscale=self.lengthscale,
            neighbours=self.neighbours,
        )

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        from gppcs.gp.local.candidates import nested_candidates
        from gppcs.gp.local.ranking import rank
        from gppcs.gp.local.survey import survey

        stages = stages or Stages()
        area, noise, sharpness = survey(points, n_points, self.candidates, stages)
        with stages("candidates"):
            candidates = nested_candidates(points, n_points, area, self.candidates, sharpness)
            del sharpness  # to free its memory
        ranking = rank(points, candidates, self.criterion, noise, stages)
        return Selection(
            ranking.indices,
            {"noise_in_spacings": noise.level / noise.spacing if noise.spacing > 0.0 else 0.0},
            attributes={"score": ranking.scores, "deviation": ranking.deviations},
        )
