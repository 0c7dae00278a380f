"""The default method: a local, full-rank Gaussian process whose metric follows the surface."""

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
    """Greedy choice where a local Gaussian process, whose metric follows the surface, is most uncertain.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> result = gppcs.simplify(cloud, n_points=100, method=gppcs.LocalGP(feature_weight=0.8))
    >>> len(result.cloud)
    100
    """

    name = "gp"
    summary = "a local Gaussian process: features kept, nothing left bare, a ranking"
    description = (
        "Chooses, one after another, the points where a local, full-rank Gaussian process is most uncertain. Its "
        "lengthscale is small where the surface is rough, and a change of the normal counts as distance, so points are "
        "dense on features. Above a feature weight of 0.5, the error of the predicted surface variation counts, too. "
        "The order is a ranking: its first points are a simplification of their number. The attributes of "
        'a point are "score", and "deviation": the standard deviation of the field when the point was chosen, relative '
        'to the prior one. The diagnostic "noise_in_spacings" is the root mean square distance of points from the '
        "surface, in target spacings. Detail of about that size counts as noise, too. A value below 0.04 counts as no "
        "noise; it is 0 if too few points lie near each other to measure it."
    )
    source = "after GP-PCS, Algorithm 1; the field is our own, see docs/local-field.md"
    attributes = ("score", "deviation")

    feature_weight: float = parameter(
        0.5,
        "How much denser points are where the surface is rough, from 0, an even cover, to 1.",
        least=0,
        most=1,
    )
    lengthscale: float = parameter(
        1.5, "Lengthscale of the Matérn kernel, in desired spacings (docs/local-field.md).", least=0.1, most=100
    )
    neighbours: int = parameter(
        4, "Number of chosen points on which the field at a point is conditioned.", least=1, most=64
    )
    candidates: float = parameter(
        8.0, "Number of cells of the candidates' grid per squared target spacing.", least=3, most=1000
    )

    @property
    def criterion(self) -> Criterion:
        """The weights of the selection at this `feature_weight`.

        At the default, 0.5, surfaces rebuilt from the kept points have the smallest error (docs/experiments.md), and
        the error of the prediction has no weight. At 1 it has the weight that the paper gives it.

        Returns
        -------
        Criterion
        """
        from gppcs.gp.local.ranking import Criterion

        return Criterion(
            density_power=2.0 * self.feature_weight,
            normal_weight=2.8 * self.feature_weight,
            error_weight=max(0.0, 2.0 * self.feature_weight - 1.0) ** 2,
            lengthscale=self.lengthscale,
            neighbours=self.neighbours,
        )

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points: survey, candidates, then the ranking in stages; see `Method.__call__`."""
        from gppcs.gp.local.candidates import nested_candidates
        from gppcs.gp.local.ranking import rank
        from gppcs.gp.local.survey import survey

        stages = Stages.of(stages)
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
