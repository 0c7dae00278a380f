"""What is done tile by tile before and after the choice: outliers, errors, gaps, points to fill a number."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gppcs.amounts.accuracy import distances_to, in_tree_order
from gppcs.amounts.quotas import first_of_parts
from gppcs.clouds.quantities import MEASURES, Measure
from gppcs.engine.arrays import Floats, Ints
from gppcs.methods import Feature
from gppcs.spatial.boxes import inside
from gppcs.spatial.farthest_points import fill_gaps
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.samples import point_hashes
from gppcs.spatial.scaling import bounds
from gppcs.streaming.rows import Rows
from gppcs.streaming.tiles import Tiling, with_signed_normals
from gppcs.surface.outliers import CLUMP_NEIGHBOURS, outliers_among

BINS = np.exp2(np.arange(-160, 161) / 16.0)  # Edges of the histogram of distances, in tolerances, which is one of them.


@dataclass(frozen=True, eq=False)
class Choice:
    """Which of the kept points of all tiles stay: the first ones of each quota, or those up to a rank."""

    tiling: Tiling
    n_staying: Ints  # (tiles, 256), of each quota
    last: float = np.inf
    added: tuple[Rows, ...] = ()  # besides

    def all_kept(self, numbers: Iterable[int], first: int = 0, last: float = np.inf) -> Rows:
        """Read the points of at least one tile that stay, and what is added to any, from an index to below another.

        The most important come first; if the method does not rank, they have the order of the files.
        """
        kept = Rows.joined([*map(self.kept, numbers), *self.added])
        kept = kept.only((kept.indices >= first) & (kept.indices < last))
        is_ranked = Feature.RANKING in self.tiling.options.algorithm.supports
        keys = [point_hashes(kept.points, size=1.0), kept.ranks] if is_ranked else [kept.indices]
        return kept.take(np.lexsort(keys))

    def kept(self, number: int) -> Rows:
        """Read the points of a tile that stay."""
        kept = Rows.read(self.tiling.file(number))
        return kept.only(first_of_parts(kept.labels, self.n_staying[number]) & (kept.ranks <= self.last))

    def near(self, number: int, margin: Floats) -> Floats:
        """Read where those points are that stay in a tile or within a margin, (3,); (n, 3)."""
        tile = self.tiling.tiles[number]
        lower, upper = tile.lower - margin, tile.upper + margin
        points = np.concatenate([self.kept(i).positions for i in self.tiling.meeting(lower, upper)])
        return points[inside(points, lower, upper)]


def outliers_in_tile(tiling: Tiling, number: int) -> tuple[Rows, Floats]:
    """Return the outliers of a tile, by a halo in which most points' neighbours and theirs lie.

    Returns also the corners, (2, 3), of the box around the other points.
    """
    own = tiling.own(number)
    points, nowhere = own.points, np.array([np.full(3, np.inf), np.full(3, -np.inf)])
    if not len(points):
        return own, nowhere
    sampled = points[:: max(1, len(points) // 1024)]
    radii = np.sqrt(KdTree.build(points).nearest_of(sampled, min(CLUMP_NEIGHBOURS + 1, len(points)))[1][:, -1])
    tile, margin = tiling.tiles[number], 6.0 * float(np.quantile(radii, 0.99))
    rows = tiling.source.read(tile.lower - margin, tile.upper + margin)
    rows = rows.only(outliers_among(tiling.frame.local(rows.points)))
    rows = rows.only(tiling.tile_of_box[rows.boxes] == number)
    others = points[~np.isin(own.indices, rows.indices)]
    return rows, np.array(bounds(others)) if len(others) else nowhere


def distances_in_tile(choice: Choice, tolerance: float, number: int) -> Floats:
    """Measure how far the points of a tile are from the local surface of the kept points.

    Returns the sums of the distances and of their squares, the largest, and how many lie between `BINS`, in one array.
    """
    points = choice.tiling.own(number).points
    kept, frame = choice.near(number, choice.tiling.halo), choice.tiling.frame
    distances = np.full(len(points), np.inf)
    if len(points) and len(kept):
        distances = distances_to(frame.near(kept), in_tree_order(frame.local(points)))
    bins = np.searchsorted(BINS, distances / tolerance)  # a distance of the tolerance counts below that edge
    histogram = np.bincount(bins, minlength=len(BINS) + 1)
    return np.array([distances.sum(), (distances**2).sum(), distances.max(initial=0.0), *histogram])


def errors_of_tiles(figures: Floats, tolerance: float) -> dict[Measure, float]:
    """Return the errors, given what `distances_in_tile` returns, (tiles, n).

    The 95th percentile is that up to 4 %: it is above the tolerance where the exact one is.
    """
    total, squared, _, *histogram = figures.sum(axis=0)
    n, largest = sum(histogram), float(figures[:, 2].max())
    below = int(np.searchsorted(np.cumsum(histogram), 0.95 * n))
    p95 = min(float(np.append(BINS, np.inf)[below]) * tolerance, largest)
    return dict(zip(MEASURES, (float(total / n), float(np.sqrt(squared / n)), p95, largest), strict=True))


def unchosen_in_tile(choice: Choice, missing: Ints, number: int) -> Rows:
    """Return as many points of a tile as are missing of each quota, (256,), or all, that it does not keep."""
    rows = choice.tiling.own(number)  # in the order of hashes
    rows = rows.only(~np.isin(rows.indices, choice.kept(number).indices))
    return _added(choice.tiling, number, rows.only(first_of_parts(rows.labels, missing)))


def fill_gaps_in_tile(
    choice: Choice, gap: float, margin: Floats, before: Sequence[Sequence[int]], number: int
) -> float:
    """Add points of a tile until none is farther than a gap from a kept one; return the largest gap that is left.

    Kept points within a margin, (3,), of the tile count, and those that were added in some tiles before each.
    """
    tiling, rows = choice.tiling, choice.tiling.own(number)
    earlier = [Rows.read(file_of_gaps(tiling, i)).points for i in before[number]]
    kept = np.concatenate([choice.near(number, margin), *earlier])
    added, largest = np.arange(0), 0.0
    if len(rows):
        added, largest = fill_gaps(tiling.frame.local(rows.points), tiling.frame.near(kept), gap)
    _added(tiling, number, rows.take(added)).write(file_of_gaps(tiling, number))
    return largest


def file_of_gaps(tiling: Tiling, number: int) -> Path:
    """Return the file of the points that are added in gaps of a tile."""
    return tiling.folder / f"{number}.gaps.npz"


def _added(tiling: Tiling, number: int, rows: Rows) -> Rows:
    """Return points that are kept besides those that were chosen."""
    kept = Rows(rows.indices, rows.points, {"label": rows.labels, "rank": np.full(len(rows), np.inf)})
    return with_signed_normals(tiling, number, kept) if tiling.options.normals else kept
