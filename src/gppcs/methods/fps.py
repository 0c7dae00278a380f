"""The method `fps`: farthest point sampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gppcs.spatial.boxes import Each
    from gppcs.spatial.chunks import ChunkedPoints


@dataclass(frozen=True)
class FarthestPoint(Method):
    """Farthest point sampling.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("sphere", n_points=1000)
    >>> len(gppcs.simplify(cloud, n_points=10, method=gppcs.FarthestPoint()).indices)
    10
    """

    name = "fps"
    summary = "farthest point sampling: the most even cover"
    description = (
        "Starts with the point nearest the centroid. Each further point is the farthest from all points chosen before "
        "it; this is exact. A smaller selection is the start of a larger one. Of files larger than memory it chooses "
        "other points, tile by tile, which are as far from each other."
    )
    source = "Eldar, Lindenbaum, Porat and Zeevi 1997"
    ranks = True
    spacing = "No two kept points are nearer than it, and no original point is farther from a kept one."
    bytes_per_point: ClassVar[int] = 150

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.spatial.farthest_points import farthest_points

        stages = Stages.of(stages)
        with stages("farthest points", n_points) as advanced:
            indices, _ = farthest_points(points, n_points, advanced=advanced)
        return Selection(indices)

    def at_spacing(self, points: NDArray[np.float64], spacing: float, stages: Stages) -> Selection:
        """Choose points until none is farther than the spacing from all of them; see `Method.at_spacing`.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        spacing : float
            In the unit of the points.
        stages : Stages
            Times "farthest points".

        Returns
        -------
        Selection
        """
        from gppcs.spatial.farthest_points import farthest_points

        with stages("farthest points"):
            indices, _ = farthest_points(points, len(points), least=spacing)
        return Selection(indices)

    def in_tiles(
        self, points: ChunkedPoints, n_points: int, folder: Path, stages: Stages, each: Each = map
    ) -> Selection:
        """Choose points as far from each other as in memory, with all but one tile on disk; see `Method.in_tiles`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        folder : path
            An empty folder, or that of an interrupted call.
        stages : Stages
            Times "sample", "boxes" and "farthest points".
        each : callable, optional
            Applies a function to each tile, like `map`.

        Returns
        -------
        Selection
        """
        import numpy as np

        from gppcs.spatial.chunks import first_repeats
        from gppcs.spatial.farthest_in_tiles import farthest_in_tiles
        from gppcs.spatial.stored import store

        stored, sample = store(points, folder, stages)
        rows = farthest_in_tiles(stored, sample, n_points, stages, each)
        return Selection(np.concatenate([rows, first_repeats(rows, n_points)]))

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
        return 300_000_000 + 200 * n_points

    def disk_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much disk space `in_tiles` takes; see `Method.disk_in_tiles`.

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
        from gppcs.spatial.stored import BYTES_ON_DISK

        return BYTES_ON_DISK * n
