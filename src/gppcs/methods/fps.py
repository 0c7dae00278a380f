"""The method `fps`: farthest point sampling."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from gppcs.methods.method import RANKING, Method, Selection, Wanted


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
        "it; this is exact. A smaller selection is the start of a larger one."
    )
    source = "Eldar, Lindenbaum, Porat and Zeevi 1997"
    supports: ClassVar[Mapping[str, str]] = {
        "ranking": RANKING,
        "spacing": "No two kept points are nearer to each other. Every original point has a kept one within it.",
        "files": "Other points than in memory, as far from each other.",
    }
    _bytes_per_point: ClassVar[int] = 150

    def __call__(self, wanted: Wanted) -> Selection:
        """Choose the points; see `Method.__call__`."""
        from gppcs.spatial.farthest_in_parts import farthest_in_parts
        from gppcs.spatial.farthest_points import farthest_points

        if wanted.stored is not None:
            least = wanted.spacing or 0.0
            return Selection(farthest_in_parts(wanted.stored, wanted.n_points, wanted.timer, wanted.each, least))
        total = wanted.n_points if wanted.spacing is None else None
        with wanted.timer("farthest points", total) as advanced:
            indices, _ = farthest_points(wanted.points, wanted.n_points, advanced=advanced, least=wanted.spacing or 0.0)
        return Selection(indices)
