"""The paper's criterion with a full-rank, local Matérn field: the default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, parameter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.gp.local.ranking import Criterion


@dataclass(frozen=True)
class LocalGP(Method):
    """A local Gaussian process of the surface variation, and greedy choice by uncertainty plus error."""

    name = "gp"
    summary = "a local Gaussian process of full rank: features kept, nothing left bare, a ranking"
    description = (
        "Chooses points greedily by uncertainty plus error of a local, full-rank Gaussian process of the surface "
        "variation. The order is a ranking: its first points are a simplification of their number. The attributes of "
        'a point are "score", and "deviation": the standard deviation of the field when the point was chosen, relative '
        'to the prior one. The diagnostic "noise_in_spacings" is the root mean square distance of points from the '
        "surface, in target spacings. Detail of about that size counts as noise too. A value below 0.04 counts as no "
        "noise; it is 0 if too few points lie near each other to measure it."
    )
    source = "the criterion of GP-PCS, Algorithm 1; the field is our own, see docs/local-field.md"
    attributes = ("score", "deviation")

    feature_weight: float = parameter(
        0.5, "How much denser points are where the surface is rough, from 0, an even cover, to 1."
    )
    lengthscale: float = parameter(1.5, "Lengthscale of the Matérn kernel, in target spacings.")
    neighbours: int = parameter(4, "Number of chosen points on which the field at a point is conditioned.")
    candidates: float = parameter(8.0, "Number of cells of the candidates' grid per squared target spacing.")

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
            error_weight=0.8 * self.feature_weight**5,
            lengthscale=self.lengthscale,
            neighbours=self.neighbours,
        )

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        from gppcs.gp.local.candidates import nested_candidates, sampled_tree, sharpness_of
        from gppcs.gp.local.ranking import rank
        from gppcs.spatial.spacing import surface_area
        from gppcs.surface.noise import Noise

        stages = stages or Stages()
        with stages("tree"):
            tree, sampled = sampled_tree(points, n_points)
            area = surface_area(tree)
        with stages("noise"):
            spacing = (area / n_points) ** 0.5
            noise = Noise.measure(tree, n_points, spacing)
            level, seen = noise.level, None if noise.quiet else noise.seen
        with stages("candidates"):
            sharpness = np.zeros(len(points), dtype=np.float32)  # noise would pass for edges
            if noise.quiet:
                sharpness[sampled] = sharpness_of(tree, area, self.candidates * n_points)
            candidates = nested_candidates(points, n_points, area, self.candidates, sharpness)
            del tree, sampled, noise, sharpness  # their memory is of more use, but for the tree where there is noise
        ranking = rank(points, candidates, self.criterion, seen, stages)
        return Selection(
            ranking.indices,
            {"noise_in_spacings": level / spacing if spacing > 0.0 else 0.0},
            attributes={"score": ranking.scores, "deviation": ranking.deviations},
        )
