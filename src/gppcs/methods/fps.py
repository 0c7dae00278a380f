"""The method `fps`: farthest point sampling."""

from dataclasses import dataclass

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task


@dataclass(frozen=True)
class FarthestPoint(Method):
    """Farthest point sampling."""

    name = "fps"
    summary = "farthest point sampling: the most even cover"
    description = (
        "Starts with the points to keep, or with the one nearest the centroid. Each further point is the farthest from "
        "all points chosen before it; this is exact. A smaller selection is the start of a larger one."
    )
    source = "Eldar, Lindenbaum, Porat and Zeevi 1997"
    supports = {
        Feature.RANKING: RANKING,
        Feature.KEEP: "The choice starts with the points to keep: a single one is the start point.",
        Feature.SPACING: "No two kept points are nearer to each other. Every original point has a kept one within it.",
    }
    _bytes_per_point = 150

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.spatial.farthest_points import farthest_points

        fixed, minimum = task.fixed, task.spacing or 0.0
        if fixed == task.n_points:
            return Selection(np.arange(fixed))
        total = task.n_points - fixed if task.spacing is None else None
        with task.timer("farthest points", total) as on_progress:
            indices, _ = farthest_points(
                task.points[fixed:],
                task.n_points - fixed,
                on_progress=on_progress,
                before=task.points[:fixed],
                minimum=minimum,
            )
        return Selection(np.append(np.arange(fixed), indices + fixed))
