"""The dense points that a mesh is made from: without repeats, with signed normals, freed from thick noise."""

from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple, Self

import numpy as np

from gppcs.engine.arrays import Flags, Floats, Ints
from gppcs.engine.threads import beside
from gppcs.meshing.coverage import RANK, Cover
from gppcs.meshing.uneven_noise import FITTED, projected_across, uneven_noise
from gppcs.spatial.cells import distinct_in_single
from gppcs.spatial.farthest_points import farthest_points
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_others
from gppcs.spatial.samples import even_sample
from gppcs.spatial.spacing import nearest_distances
from gppcs.surface.noise import FEWEST, SAMPLES, THICK, WIDE, layer_of, projections, two_sheets
from gppcs.surface.normals import ACROSS, EDGES, NARROW, SHARP, normals_of, with_signs
from gppcs.surface.quadrics import COEFFICIENTS, TWO_PEAKS, fit_quadrics

JOINED = 8  # points of the first mesh for each vertex of the result
JOINED_OF_SHEETS = 24  # where sheets are near each other
JOINED_OF_NOISY = 3  # of a noisy cloud: more follow the noise
PER_VERTEX = 32  # dense points for each vertex: more hardly help
MIXED = 0.012  # fraction of normals that narrower fits turn by 60 degrees: at most 0.0021 on smooth and sharp bodies
LIKELY = 2.3  # kurtosis below which fits see two sheets where a cloud has noisy ones: noise alone has 3
WIDER = 1.15  # fraction of fits that see two sheets, over that of narrower ones, from which on wider ones are taken
CURVED = 3.0  # noise of each sheet in wider fits, over that in narrower ones, from which on it is curvature
NARROW_RADIUS = 0.85  # of fits to one of two noisy sheets, in distances of these
NEAR_SPACINGS = 3.0  # distance of sheets, in those of points, below which more points help
MAX_FOR_SHEETS = 2_000_000  # dense points at most, after they are doubled to tell near sheets apart


class _Layer(NamedTuple):
    """The noise of dense points, and the fits that reach across it."""

    sigma: float  # of each sheet if there are two; 0 if it is too small to count, or grows as detail does
    fitted: int = ACROSS  # points of each fit
    narrow: int = ACROSS  # points of fits that hardly see the other sheet of two
    apart: float = 0.0  # distance of two sheets that fits see; 0 if there are none
    spacing: float = 0.0  # distance of points

    @property
    def has_two_sheets(self) -> bool:
        """Whether there are sheets that are farther apart than points."""
        return self.apart > self.spacing

    @property
    def joined(self) -> float:
        """Distance between two sheets that are taken for noise, as points are farther apart; 0 if there are none."""
        return 0.0 if self.has_two_sheets or self.apart <= 0.25 * self.spacing else self.apart

    def needs_more(self, denser: float) -> bool:
        """Return whether up to `denser` times as many points would tell sheets apart, or even out their noise."""
        is_near = self.spacing < self.apart * np.sqrt(denser) and self.apart < NEAR_SPACINGS * self.spacing
        return is_near and (self.sigma > 0.0 or not self.has_two_sheets)


@dataclass(frozen=True)
class DensePoints:
    """Points of a cloud, in the order of their tree."""

    indices: Ints  # (n,): the index of each in the cloud
    raw: Floats  # (n, 3): where the cloud has them
    positions: Floats  # (n, 3): where they lie on the surface: the same, unless the cloud is noisy
    normals: Floats  # (n, 3): unit normals with signs
    cover: Cover  # what the points cover
    joined: Ints  # which points the first mesh joins, ascending: they are evenly spread
    noise: float  # root mean square distance of the points from the surface; 0 if it is too small to count
    uneven: bool = False  # whether the noise differs from place to place
    near_sheets: bool = False  # whether sheets are so near each other that few points would not tell them apart
    joined_sheets: float = 0.0  # distance between two sheets that are taken for noise, as points are farther apart

    @classmethod
    def from_points(
        cls,
        points: Floats,
        n_vertices: int,
        chosen: Ints,
        thick: bool = False,
        near_sheets: bool = True,
        times: int = 1,
    ) -> Self | None:
        """Take enough points of a cloud for a mesh, evenly; noise may be thick, or there may be near sheets.

        Of these, so many times as many points are taken.
        """
        indices = _sample(points, times * n_vertices, chosen)
        tree = KdTree.build(points[indices])
        indices, raw = indices[tree.order], np.ascontiguousarray(tree.points.T)
        uneven = None if thick else uneven_noise(tree)
        if uneven:
            return cls._across_uneven(indices, tree, *uneven, JOINED_OF_NOISY * n_vertices, chosen)
        mixed = near_sheets and not thick and len(indices) > 4 * SHARP and _mixes_sheets(tree)
        doubles = near_sheets and 2 * times * PER_VERTEX * n_vertices <= min(len(points), MAX_FOR_SHEETS)
        if not (mixed and doubles):
            layer = _thick_noise(tree) if thick else _noise(tree)
            if thick and not layer.sigma:
                return None
            doubles = doubles and layer.needs_more(len(points) / len(indices))
        if doubles:
            dense = cls.from_points(points, n_vertices, chosen, times=2 * times)
            return dense and replace(dense, near_sheets=True)
        noise, own_sheets = layer.sigma, mixed and not layer.joined
        noisy_sheets = near_sheets and noise > 0.0 and layer.has_two_sheets
        if noise:
            count = (JOINED if noisy_sheets else JOINED_OF_NOISY) * n_vertices
        else:
            count = (JOINED_OF_SHEETS if mixed or times > 1 else JOINED) * n_vertices
        spread = cache(partial(beside, partial(_spread, indices, raw, chosen, count)))  # started once
        near, squared = nearest_others(tree, min(EDGES, len(indices) - 1))
        on_surface = raw
        if not noisy_sheets:
            normals = normals_of(tree.in_own_order(), near, noise > 0.0, own_sheets, None if noise else spread)
        if noise:
            if noisy_sheets:
                feet = _on_own_sheets(tree, layer)
            else:
                feet = _feet(tree, tree.points, layer.fitted, TWO_PEAKS if own_sheets else 0.0)
            on_surface = np.ascontiguousarray(feet.T)
            tree = KdTree.build(on_surface)
            indices, raw, on_surface = indices[tree.order], raw[tree.order], on_surface[tree.order]
            near, squared = nearest_others(tree, min(EDGES if noisy_sheets else RANK, len(indices) - 1))
            normals = normals_of(tree.in_own_order(), near, False, True) if noisy_sheets else normals[tree.order]
        joined = _spread(indices, on_surface, chosen, count) if noise else spread()()
        radii = _covered(near[:, :RANK], squared[:, :RANK])
        if noisy_sheets:  # rims are sparse
            radii = radii * (len(indices) / len(joined)) ** 0.5
        cover = Cover(*tree.arrays, normals, radii)
        return cls(indices, raw, on_surface, normals, cover, joined, noise, False, mixed or noisy_sheets, layer.joined)

    @classmethod
    def _across_uneven(
        cls, indices: Ints, tree: KdTree, sigma: Floats, strides: Ints, count: int, chosen: Ints
    ) -> Self:
        """Project points across noise that differs from place to place, for a first mesh of so many points."""
        raw = np.ascontiguousarray(tree.points.T)
        feet, normals, fitted = projected_across(tree, strides)
        tree = KdTree.build(feet)
        indices, raw, on_surface = indices[tree.order], raw[tree.order], np.ascontiguousarray(tree.points.T)
        near, squared = nearest_others(tree, RANK)
        # Signs agree between every few points only: nearer ones lie across what noise is left, not along the surface.
        step, normals = max(1, len(indices) // count), normals[tree.order]
        sparse, signed = tree.in_own_order().thinned(step), normals[tree.one_of_each(step)]
        signed = with_signs(sparse, nearest_others(sparse, EDGES)[0], signed)
        normals = _following(sparse, signed, tree.points.T, normals)
        # As far as in the thinned cloud that the quadric is fitted to, and as among the joined points, which cannot
        # tell a gap that is no wider than they are apart.
        radii = _covered(near, squared) * max(1.0, len(indices) / count) ** 0.5
        radii = np.maximum(radii, fitted[tree.order] * (RANK / FITTED) ** 0.5)
        cover = Cover(*tree.arrays, normals, radii)
        joined = _spread(indices, on_surface, chosen, count)
        return cls(indices, raw, on_surface, normals, cover, joined, float(np.sqrt((sigma**2).mean())), True)

    def turned(self, signed: Ints, turned: Flags, tree: KdTree) -> Self:
        """Turn the normals of some of the points `signed`, which the tree is over; all others follow the nearest."""
        normals = np.where(turned[:, None], -self.normals[signed], self.normals[signed])
        return replace(self, normals=_following(tree, normals, self.positions, self.normals))


def _following(tree: KdTree, signed: Floats, points: Floats, normals: Floats) -> Floats:
    """Give normals, (n, 3), at points, (n, 3), the signs of those at the nearest points of a tree."""
    nearest, _ = tree.nearest_of(points, 1)
    turned = np.einsum("ij,ij->i", signed[nearest[:, 0]], normals) < 0.0
    return np.where(turned[:, None], -normals, normals)


def _sample(points: Floats, n_vertices: int, chosen: Ints) -> Ints:
    """Return indices of points without repeats, ascending: all, or about `PER_VERTEX` for each vertex."""
    distinct = distinct_in_single(points)
    step = len(distinct) // (PER_VERTEX * n_vertices)
    if step <= 1:
        return distinct
    usable = np.zeros(len(points), dtype=np.bool_)
    usable[distinct] = True
    return np.union1d(even_sample(points, usable, step), chosen)


def _spread(indices: Ints, positions: Floats, chosen: Ints, count: int) -> Ints:
    """Return which of the points in tree order the first mesh joins, ascending: so many, with the chosen ones."""
    if count >= len(indices):
        return np.arange(len(indices))
    forced = np.flatnonzero(np.isin(indices, chosen))
    before = positions[forced] if len(forced) else None
    even, _ = farthest_points(positions, max(1, count - len(forced)), KdTree.over(positions.T), before=before)
    return np.union1d(even, forced)


def _mixes_sheets(tree: KdTree) -> bool:
    """Return whether fits of the normals of a tree's points mix near sheets, so that narrow ones differ from wide ones.

    They differ less from the narrowest, as fits of noise do.
    """
    sampled = tree.thinned(-(-len(tree.order) // SAMPLES))
    wide, narrow, narrowest = (fit_quadrics(tree, sampled, k).normals for k in (SHARP, NARROW, COEFFICIENTS))
    differ, noise = (np.mean(np.abs((a * narrow).sum(axis=0)) < 0.5) for a in (wide, narrowest))
    return bool(differ > max(MIXED, noise))


def _feet(tree: KdTree, points: Floats, neighbours: int, sheets: float = 0.0) -> Floats:
    """Return the projections, (3, m), of points in the order of a tree onto quadrics across its noise."""
    for _ in range(2):
        points, _ = projections(tree, KdTree.over(points), neighbours, sheets)
    return points


def _on_own_sheets(tree: KdTree, layer: _Layer) -> Floats:
    """Project points, each onto its own of two sheets; by narrower fits at rims, and where there is no second sheet."""
    feet = tree.points
    for _ in range(2):
        feet, fitted = projections(tree, KdTree.over(feet), layer.fitted, LIKELY)
    others = fitted.kurtosis >= LIKELY
    feet[:, others] = _feet(tree, tree.points[:, others], layer.narrow)
    return feet


def _covered(near: Ints, squared: Floats) -> Floats:
    """Return the distance of the last of k neighbours, at most twice its median there, as strays cover little."""
    radii = np.sqrt(squared[:, -1])
    middle = (near.shape[1] - 1) // 2
    return np.minimum(radii, 2.0 * np.partition(radii[near], middle, axis=1)[:, middle])


def _noise(tree: KdTree) -> _Layer:
    """Measure noise and sheets by fits that grow until they reach across noise, or see two sheets most often."""
    if len(tree.order) <= 2 * ACROSS:
        return _Layer(0.0)
    spacing = float(np.median(nearest_distances(tree, RANK)))
    narrow = layer_of(tree, ACROSS)
    sheets, fitted = two_sheets(tree, ACROSS), ACROSS
    is_noisy = narrow.sigma > 0.25 * spacing
    for k in (WIDE, 2 * WIDE, 4 * WIDE):
        seen = two_sheets(tree, k) if is_noisy and 2 * k < len(tree.order) else None
        noise, fraction = (sheets.noise, sheets.fraction) if sheets else (narrow.sigma, 0.0)
        if seen and seen.fraction > WIDER * fraction and seen.noise < CURVED * noise:
            sheets, fitted = seen, k
    if sheets and sheets.apart > spacing:
        squared = (sheets.apart / sheets.radius) ** 2  # a ball of this radius around a point has as much of both sheets
        of_own = max(FEWEST, int(NARROW_RADIUS**2 * fitted * squared / (2.0 - squared)))
        return _Layer(sheets.noise if sheets.noise > 0.25 * spacing else 0.0, fitted, of_own, sheets.apart, spacing)
    is_noise = is_noisy and narrow.ratio <= layer_of(tree, ACROSS // 2).ratio
    return _Layer(narrow.sigma if is_noise else 0.0, ACROSS, ACROSS, sheets.apart if sheets else 0.0, spacing)


def _thick_noise(tree: KdTree) -> _Layer:
    """Measure noise that is thick; it is 0 if no fits reach across it."""
    largest, fitted = 0.0, 160
    for k in (40, 80, 160, 320, 640):
        if len(tree.order) <= 2 * k:
            break
        layer = layer_of(tree, k)
        largest = max(largest, layer.ratio)
        # Wider fits lower the ratio to their radius if a layer is noise; it does not fall in a volume.
        if largest > THICK and layer.ratio < 0.85 * largest:
            return _Layer(layer.sigma, fitted)
    return _Layer(0.0)
