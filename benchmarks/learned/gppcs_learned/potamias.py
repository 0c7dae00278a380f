"""The method `potamias`: farthest points of a learned latent space, moved by attention to their neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gppcs.methods.method import Method, Selection, Task
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class Potamias(Method):
    """Learned simplification of Potamias et al.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=100, method=gppcs.Potamias(snap=False)).cloud)
    100
    """

    name = "potamias"
    summary = "learned: farthest points in a latent space, moved by attention to their neighbours"
    description = (
        "A network gives each point learned coordinates beside its place. The farthest points in that space are "
        "chosen, in parts of about 2,048 points. Attention to its neighbours moves each. The weights and the network "
        "are our own, after the publication, as the authors' are not public: trained on 1,008 procedural shapes of "
        "twelve kinds."
    )
    source = "Potamias, Bouritsas and Zafeiriou 2022"
    _bytes_per_point: ClassVar[int] = 1000

    snap: bool = parameter(
        True,
        "Replace each moved point by the nearest original point that no earlier one took. Otherwise keep the moved "
        "points, with the attributes of these points.",
    )

    @property
    def moves_points(self) -> bool:
        """Whether the moved points themselves are kept."""
        return not self.snap

    def __call__(self, task: Task) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        from gppcs.engine.blas import one_blas_thread
        from gppcs.spatial.queries import nearest_unused
        from gppcs_learned import latent
        from gppcs_learned.embedded import Embedded

        timer = task.timer
        weights, tree, index, places, features = Embedded.of(self.name, task.points, timer)
        with timer("farthest points"), one_blas_thread():
            kept = latent.farthest(latent.coordinates(weights, places, features), task.n_points)
        with timer("attention"), one_blas_thread():
            moved = latent.moved(weights, tree.points.T, features, index, kept)
        with timer("nearest points"):
            indices = nearest_unused(moved, tree)
        return Selection(indices, {}, None if self.snap else np.ascontiguousarray(moved))
