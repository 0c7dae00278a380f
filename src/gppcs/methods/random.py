"""The method `random`: random sampling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from gppcs.methods.method import RANKING, Method, Selection, Wanted
from gppcs.methods.parameters import parameter

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

PART = 1 << 18  # Points of a part at most.


@dataclass(frozen=True)
class Random(Method):
    """Random sampling.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=10, method=gppcs.Random(seed=1)).indices)
    10
    """

    name = "random"
    summary = "random points, all equally likely"
    description = (
        "Chooses the first points of a random permutation, so a smaller selection is the start of a larger one."
    )
    source = "baseline"
    supports: ClassVar[Mapping[str, str]] = {"ranking": RANKING, "files": "Other points than in memory, as random."}
    _bytes_per_point: ClassVar[int] = 60

    seed: int = parameter(0, "Seed of the permutation.", least=0)

    def __call__(self, wanted: Wanted) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        with wanted.timer("permutation"):
            if wanted.stored is not None:
                return Selection(self._of_stored(wanted))
            return Selection(np.random.default_rng(self.seed).permutation(len(wanted.points))[: wanted.n_points])

    def _of_stored(self, wanted: Wanted) -> NDArray[np.int64]:
        """Return the rows of the different places with the smallest hashes."""
        import numpy as np

        from gppcs.spatial.row_sample import smallest_hashes

        assert wanted.stored is not None
        hashes, rows = np.empty(0, dtype=np.uint64), np.empty(0, dtype=np.int64)
        choose = partial(smallest_hashes, wanted.stored, wanted.n_points, self.seed)
        for of_part in wanted.each(choose, wanted.stored.parts(PART)):
            hashes, rows = np.concatenate([hashes, of_part[0]]), np.concatenate([rows, of_part[1]])
            order = np.argsort(hashes)[: wanted.n_points]
            hashes, rows = hashes[order], rows[order]
        return rows
