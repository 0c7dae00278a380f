"""The method `random`: random sampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, parameter

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gppcs.spatial.boxes import Each
    from gppcs.spatial.chunks import ChunkedPoints


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
        "Chooses the first points of a random permutation, so a smaller selection is the start of a larger one. Of "
        "files larger than memory it chooses other points, which are as random."
    )
    source = "baseline"
    ranks = True
    bytes_per_point: ClassVar[int] = 60

    seed: int = parameter(0, "Seed of the permutation.", least=0)

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        import numpy as np

        stages = Stages.of(stages)
        with stages("permutation"):
            return Selection(np.random.default_rng(self.seed).permutation(len(points))[:n_points])

    def in_tiles(
        self, points: ChunkedPoints, n_points: int, folder: Path, stages: Stages, each: Each = map
    ) -> Selection:
        """Choose other points than in memory, as random, in one pass without files; see `Method.in_tiles`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        folder : path
            Unused.
        stages : Stages
            Times "sample".
        each : callable, optional
            Applies a function to each tile, like `map`.

        Returns
        -------
        Selection
        """
        import numpy as np

        from gppcs.spatial.chunks import first_repeats
        from gppcs.spatial.row_sample import PlaceSample

        sample = PlaceSample(n_points, self.seed)
        with stages("sample", len(points)) as advanced:
            for chunk in points.chunks():
                sample.add(chunk)
                advanced(len(chunk))
        return Selection(np.concatenate([sample.rows, first_repeats(sample.rows, n_points)]))

    def memory_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much memory `in_tiles` takes; see `Method.memory_in_tiles`.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        return 120 * n_points
