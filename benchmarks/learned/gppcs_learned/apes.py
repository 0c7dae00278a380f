"""The methods `apes` and `apes-global`: the points that the downsampling of a trained classifier keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.memory import available_memory, size_of
from gppcs.errors import InputError
from gppcs.methods.method import RANKING, Feature, Method, Selection, Task

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs_learned.layers import Features, Index
    from gppcs_learned.weights import Weights


@dataclass(frozen=True)
class APES(Method):
    """Attention-based point cloud edge sampling (APES), local form.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=250, method=gppcs.APES()).indices)
    250
    """

    name = "apes"
    summary = "learned: points whose attention to their neighbours is uneven, more of them near edges"
    description = (
        "Keeps the points whose attention to their neighbours has the largest standard deviation, in a network that "
        "was trained to tell shapes apart. The weights are our own, not the authors': trained on 1,008 procedural "
        "shapes of twelve kinds. Attention is to the 16 points nearest in space, so the time is linear in the number "
        "of points."
    )
    source = "Wu, Zheng, Pfrommer and Beyerer 2023"
    supports: ClassVar[Mapping[Feature, str]] = {Feature.RANKING: RANKING}
    _bytes_per_point: ClassVar[int] = 1300

    def __call__(self, task: Task) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        from gppcs.engine.blas import one_blas_thread
        from gppcs_learned.embedded import Embedded
        from gppcs_learned.layers import attended
        from gppcs_learned.weights import part

        weights, tree, index, _, features = Embedded.of(self.name, task.points, task.timer)
        with task.timer("attention"), one_blas_thread():
            features = attended(part(weights, "attentions.0"), features, index)
            scores = np.empty(len(features), dtype=np.float64)
            scores[tree.order] = self._scores(part(weights, "downsamplings.0"), features, index)
        return Selection(np.argsort(-scores, kind="stable")[: task.n_points])

    def _scores(self, weights: Weights, features: Features, index: Index) -> NDArray[np.float64]:
        """Return the score of each point, (N,)."""
        from gppcs_learned.layers import unevenness

        return unevenness(weights, features, index)


@dataclass(frozen=True)
class APESGlobal(APES):
    """Attention-based point cloud edge sampling (APES), global form.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=250, method=gppcs.APESGlobal()).indices)
    250
    """

    name = "apes-global"
    summary = "learned: points that get the most attention from all others"
    description = (
        "As apes, but each point attends to all others, and those are kept that get the most attention. The weights of "
        "N x N pairs are held in memory: more points than fit are refused. The weights of the network are our own, not "
        "the authors': trained on 1,008 procedural shapes of twelve kinds."
    )

    def memory(self, n: int, n_points: int) -> int:
        """Return the bytes of a call with the attention between all pairs; see `Method.memory`."""
        return super().memory(n, n_points) + 4 * n * n

    def __call__(self, task: Task) -> Selection:
        """Choose the points; raise an error if the attention between all pairs does not fit into memory."""
        n = len(task.points)
        free, needed = available_memory(), self.memory(n, n)
        if free is not None and needed > free:
            raise InputError(
                f"method 'apes-global' holds the attention between all pairs of points: {n:,} points need "
                f"{size_of(needed)}, found {size_of(free)} of free memory: thin the cloud first, or use "
                "apes, which attends to neighbours only"
            )
        return super().__call__(task)

    def _scores(self, weights: Weights, features: Features, index: Index) -> NDArray[np.float64]:
        """Return the score of each point, (N,)."""
        from gppcs_learned.layers import attention_received

        return attention_received(weights, features)
