"""The dense points that a mesh is made from: without repeats, with signed normals, freed from thick noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gppcs.meshing.coverage import RANK, Cover
from gppcs.meshing.halfedges import Flags, Floats, Ints
from gppcs.meshing.uneven_noise import FITTED, UnevenNoise
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.even_sample import even_sample
from gppcs.spatial.kdtree import KdTree, nearest_distances
from gppcs.surface.noise import THICK, layer_of, projections
from gppcs.surface.normals import EDGES, normals_of, with_signs

LEVEL_OF_NOISY = 3  # points of the first mesh for each vertex of the result, of a noisy cloud: more follow the noise
PER_VERTEX = 32  # dense points for each vertex of the result: more make the quadrics hardly better
NOISY = 0.25  # least noise that counts, in distances to the neighbour of rank `RANK`
FITS = 20, 40  # points of the quadrics that tell noise from detail; points go to the feet on those of the second
FITS_OF_THICK, FITTED_TO_THICK = (40, 80, 160, 320, 640), 160  # the same for noise thicker than those fits reach
FALLEN = 0.85  # a layer is noise if wider fits lower its share of their radius to this; it does not fall in a volume
WIDEST_COVER = 2.0  # how far a point covers the surface at most, in median distances that its neighbours cover
STEPS = 2  # such projections


@dataclass(frozen=True)
class DensePoints:
    """Points of a cloud, in the order of their tree."""

    rows: Ints  # (n,): the row of each in the cloud
    raw: Floats  # (n, 3): where the cloud has them
    places: Floats  # (n, 3): where they lie on the surface: the same, unless the cloud is noisy
    normals: Floats  # (n, 3): unit normals with signs
    cover: Cover  # what the places cover
    noise: float  # root mean square distance of the points from the surface; 0 if it is too small to count
    uneven: bool = False  # whether the noise differs from place to place

    @classmethod
    def of(cls, points: Floats, n_vertices: int, chosen: Ints, thick: bool = False) -> DensePoints | None:
        """Take enough points of a cloud for a mesh, evenly."""
        rows = _some_rows(points, n_vertices, chosen)
        tree = KdTree.build(points[rows])
        uneven = None if thick else UnevenNoise.of(tree)
        if uneven:
            return cls._of_uneven(rows[tree.order], tree, uneven, LEVEL_OF_NOISY * n_vertices)
        noise = _thick_noise(tree) if thick else _noise(tree)
        if thick and not noise:
            return None
        rows, raw = rows[tree.order], np.ascontiguousarray(tree.points.T)
        near, squared = tree.neighbours(min(EDGES, len(rows) - 1))
        normals = normals_of(tree.in_own_order(), near, noise > 0.0)
        places = raw
        if noise:
            fitted = FITTED_TO_THICK if thick else FITS[1]
            for _ in range(STEPS):
                feet, _ = projections(tree, KdTree.over(np.ascontiguousarray(places.T)), fitted)
                places = np.ascontiguousarray(feet.T)
            tree = KdTree.build(places)
            rows, raw, places, normals = (
                rows[tree.order], raw[tree.order], places[tree.order], normals[tree.order]
            )  # fmt: skip
            near, squared = tree.neighbours(min(RANK, len(rows) - 1))
        reaches = _reaches(near[:, :RANK], squared[:, :RANK])
        cover = Cover(tree.points, tree.low, tree.high, normals, reaches)
        return cls(rows, raw, places, normals, cover, noise)

    @classmethod
    def _of_uneven(cls, rows: Ints, tree: KdTree, uneven: UnevenNoise, joined: int) -> DensePoints:
        """Take points to the surface across noise that differs from place to place; rows in the order of the tree.

        `joined` is the number of points of the first mesh.
        """
        raw = np.ascontiguousarray(tree.points.T)
        feet, normals, fitted = uneven.projected(tree)
        tree = KdTree.build(feet)
        rows, raw, places = rows[tree.order], raw[tree.order], np.ascontiguousarray(tree.points.T)
        near, squared = tree.neighbours(RANK)
        normals = _signed(tree, normals[tree.order], max(1, len(rows) // joined))
        # A point covers the surface as far as it would in the thinned cloud that its quadric is fitted to, and as it
        # would among the joined points: these cannot tell a gap that is no wider than they are apart.
        reaches = _reaches(near, squared) * max(1.0, len(rows) / joined) ** 0.5
        reaches = np.maximum(reaches, fitted[tree.order] * (RANK / FITTED) ** 0.5)
        cover = Cover(tree.points, tree.low, tree.high, normals, reaches)
        return cls(rows, raw, places, normals, cover, float(np.sqrt((uneven.noise**2).mean())), True)

    def turned(self, some: Ints, turned: Flags, tree: KdTree) -> DensePoints:
        """Return these points with the normals of some turned; all others take the sign of the nearest of these.

        The tree is over the places of these.
        """
        signed = np.where(turned[:, None], -self.normals[some], self.normals[some])
        return replace(self, normals=_following(tree, signed, self.places, self.normals))


def _signed(tree: KdTree, normals: Floats, step: int) -> Floats:
    """Give normals, (n, 3), of the points of a tree, in its order, signs that agree, told by every `step`-th of them.

    Points that are much nearer to each other lie beside each other across what noise is left, not along the surface.
    """
    some = tree.in_own_order().thinned(step)
    near, _ = some.neighbours(EDGES)
    return _following(some, with_signs(some, near, normals[::step].copy()), tree.points.T, normals)


def _following(some: KdTree, signed: Floats, places: Floats, normals: Floats) -> Floats:
    """Give normals, (n, 3), at places, (n, 3), the signs of those at the nearest points of a tree."""
    nearest, _ = some.nearest_of(places, 1)
    turned = np.einsum("ij,ij->i", signed[nearest[:, 0]], normals) < 0.0
    return np.where(turned[:, None], -normals, normals)


def _some_rows(points: Floats, n_vertices: int, chosen: Ints) -> Ints:
    """Return rows of points without repeats, ascending: all, or about `PER_VERTEX` for each vertex."""
    distinct = first_occurrences(points)
    step = int(np.count_nonzero(distinct)) // (PER_VERTEX * n_vertices)
    if step <= 1:
        return np.flatnonzero(distinct)
    return np.union1d(even_sample(points, distinct, step), chosen)


def _reaches(near: Ints, squared: Floats) -> Floats:
    """Return how far each point covers the surface: to its last neighbour, but not much farther than neighbours do.

    Otherwise a stray point would cover all the way to the surface. Neighbours and squared distances are (N, k).
    """
    reaches = np.sqrt(squared[:, -1])
    usual = np.partition(reaches[near], (near.shape[1] - 1) // 2, axis=1)[:, (near.shape[1] - 1) // 2]
    return np.minimum(reaches, WIDEST_COVER * usual)


def _noise(tree: KdTree) -> float:
    """Return the noise of the points of a tree, 0 if it is small or if it is detail of the surface.

    The distance of noise from quadrics does not depend on how many points these are fitted to. That of detail grows
    about as the radius of the fits.
    """
    if len(tree.order) <= 2 * FITS[1]:
        return 0.0
    fine, wide = (layer_of(tree, k) for k in FITS)
    spacing = float(np.median(nearest_distances(tree, RANK)))
    return wide.level if wide.level > NOISY * spacing and wide.level * fine.radius <= fine.level * wide.radius else 0.0


def _thick_noise(tree: KdTree) -> float:
    """Return the noise of the points of a tree, 0 if no fits reach across it, as in a volume."""
    largest = 0.0
    for k in FITS_OF_THICK:
        if len(tree.order) <= 2 * k:
            break
        layer = layer_of(tree, k)
        ratio = layer.level / layer.radius
        largest = max(largest, ratio)
        if ratio < FALLEN * largest and largest > THICK:
            return layer.level
    return 0.0
