"""The method `top-variation`: the points of largest surface variation."""

from dataclasses import dataclass

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class TopVariation(Method):
    """The points of largest surface variation."""

    name = "top-variation"
    summary = "the points of largest surface variation, and no others"
    description = "Chooses the points of largest surface variation. Flat parts of the surface keep no points."
    source = "baseline; surface variation: Pauly, Gross and Kobbelt 2002"
    supports = {Feature.RANKING: RANKING}
    _bytes_per_point = 150

    neighbours: int = parameter(25, "About how many points a neighbourhood holds.", minimum=3)

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.surface.surface_variation import estimate_features

        with task.timer("surface variation"):
            variation = estimate_features(task.points, self.neighbours).surface_variation
        return Selection(np.argsort(-variation, kind="stable")[: task.n_points])
