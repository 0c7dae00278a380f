"""The default method: a local, full-rank Gaussian process whose metric follows the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter

if TYPE_CHECKING:
    from gppcs.gp.local.algorithm import Criterion


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
        "dense on features. At last each point is exchanged for the point near it that lowers the distance of the "
        "cloud from the surface most. Above a feature weight of 0.5, the error of the predicted surface variation "
        "counts, too. The order is a ranking: its first points are a simplification of their number. The attributes of "
        'a point are "score", and "deviation": the standard deviation of the field when the point was chosen, relative '
        'to the prior one. The diagnostic "noise_in_spacings" is the distance of points from the surface, in '
        "target spacings: the standard deviation if it is Gaussian noise. It is 0 if too few points lie near each "
        "other to measure it. A value below 0.04 changes nothing, nor does detail such as vegetation. The diagnostic "
        '"unconverged" is there if the solver that fits denoised points stopped before it converged.'
    )
    source = "after GP-PCS, Algorithm 1; the field is our own, see research/local-field.md"
    supports = {
        Feature.RANKING: RANKING,
        Feature.SPACING: "The mean spacing: the number of points is the area of the surface, divided by its square.",
        Feature.KEEP: "The others are chosen where the points to keep are not.",
        Feature.WEIGHT: "The density of the kept points is multiplied by the weight.",
        Feature.DETAIL: "A jump of an attribute counts as distance, as an edge does, and its variation as roughness.",
        Feature.DENOISE: "Points are chosen where the surface lies most probably, and moved there.",
        Feature.SCORES: "The score, and the standard deviation relative to the prior, when the point was chosen.",
    }

    points_per_kept = 48.0

    feature_weight: float = parameter(
        0.5, "How much denser points are where the surface is rough, from 0, an even cover, to 1.", minimum=0, maximum=1
    )
    lengthscale: float = parameter(
        1.5,
        "Lengthscale of the Matérn kernel, in desired spacings (research/local-field.md).",
        minimum=0.1,
        maximum=100,
    )
    neighbours: int = parameter(
        4, "Number of chosen points on which the field at a point is conditioned.", minimum=1, maximum=64
    )
    candidates: float = parameter(
        8.0, "Number of cells of the candidates' grid per squared target spacing.", minimum=3, maximum=1000
    )
    denoise: bool = parameter(
        False, "Move the points onto the surface that all points observe with noise, with their attributes."
    )

    @property
    def criterion(self) -> Criterion:
        """The weights of the selection: at the default, 0.5, the error has none; at 1 that of the paper."""
        from gppcs.gp.local.algorithm import Criterion

        return Criterion.from_feature_weight(self.feature_weight, self.lengthscale, self.neighbours, self.candidates)

    @property
    def moves_points(self) -> bool:
        return self.denoise

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.engine.helpers import helped
        from gppcs.gp.local.algorithm import Problem, choose, choose_denoised
        from gppcs.gp.local.first_run import compile_choice, compile_placement
        from gppcs.gp.local.greedy import PART_POINTS

        if task.n_points >= len(task.points):
            return Selection(np.arange(len(task.points)), ranked=False)
        problem = Problem(task.points, task.n_points, task.fixed, task.weights, task.detail, task.settled, task.scale)
        candidates = min(round(self.candidates * task.n_points), len(task.points), 2 * PART_POINTS)
        with helped((compile_choice, candidates), (compile_placement,)):  # at a first run
            ranking = (choose_denoised if self.denoise else choose)(problem, self.criterion, task.timer)
        attributes = {"score": ranking.scores, "deviation": ranking.deviations}
        moved, normals = (None, None) if ranking.surface is None else ranking.surface[:2]
        diagnostics = {"noise_in_spacings": ranking.noise_in_spacings}
        if not ranking.converged:
            diagnostics["unconverged"] = 1.0
        return Selection(ranking.indices, diagnostics, moved, attributes, normals=normals, scale=ranking.scale)

    def number_at(self, area: float, spacing: float) -> int:
        return max(1, round(min(area / spacing / spacing, 1e18)))

    def memory(self, n: int, n_points: int) -> int:
        from gppcs.gp.local.candidates import sample_size
        from gppcs.gp.local.settings import CELL_POINTS

        # A little more than measured, for each point of the sample, candidate, point of the cells, and point.
        sampled = (100 + 120 if self.denoise else 100) * min(n, sample_size(n_points))
        ranked = 300 * min(n, round(1.5 * self.candidates * n_points))  # 1.5 cells for each on slopes
        placed = 130 * min(n, CELL_POINTS * n_points)
        return 16 * n + max(sampled + ranked, placed)
