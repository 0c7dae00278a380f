"""The method `fps`: farthest point sampling."""

from __future__ import annotations

from dataclasses import dataclass

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task


@dataclass(frozen=True)
class FarthestPoint(Method):
    """Farthest point sampling."""

    name = "fps"
    summary = "farthest point sampling: the most even cover"
    description = (
        "Starts with the point nearest the centroid. Each further point is the farthest from all points chosen before "
        "it; this is exact. A smaller selection is the start of a larger one."
    )
    source = "Eldar, Lindenbaum, Porat and Zeevi 1997"
    supports = {
        Feature.RANKING: RANKING,
        Feature.SPACING: "No two kept points are nearer to each other. Every original point has a kept one within it.",
        Feature.FILES: "Other points than in memory, as far from each other.",
    }
    _bytes_per_point = 150

    def __call__(self, task: Task) -> Selection:
        from gppcs.spatial.farthest_in_parts import farthest_in_parts
        from gppcs.spatial.farthest_points import farthest_points

        if task.stored is not None:
            minimum = task.spacing or 0.0
            return Selection(farthest_in_parts(task.stored, task.n_points, task.timer, task.map_parts, minimum))
        total = task.n_points if task.spacing is None else None
        with task.timer("farthest points", total) as on_progress:
            indices, _ = farthest_points(
                task.points, task.n_points, on_progress=on_progress, minimum=task.spacing or 0.0
            )
        return Selection(indices)
