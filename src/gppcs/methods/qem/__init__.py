"""The method `qem`: point pair contraction by the quadric error metric."""

from dataclasses import dataclass

from gppcs.methods.method import RANKING, Feature, Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class QEM(Method):
    """Point pair contraction by the quadric error metric (QEM)."""

    name = "qem"
    summary = "quadric error metric: merges the pair of neighbours that changes the surface least, again and again"
    description = (
        "Contracts pairs of neighbours into one of the two, the pair with the smallest quadric error first. "
        "Exactly flat parts cost nothing, so they lose all their points before "
        "other parts lose any: models made of planes keep their edges, but their faces are left empty."
    )
    source = "Pauly, Gross and Kobbelt 2002; Garland and Heckbert 1997"
    supports = {Feature.RANKING: RANKING}
    _bytes_per_point = 550

    neighbours: int = parameter(
        8, "Number of neighbours of a point, used for its normal and as partners of contractions.", minimum=1
    )

    def __call__(self, task: Task) -> Selection:
        from gppcs.methods.qem.contraction import contraction_order

        with task.timer("contraction", len(task.points) - 1) as on_progress:
            return Selection(contraction_order(task.points, self.neighbours, on_progress)[: task.n_points])
