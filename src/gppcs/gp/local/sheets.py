"""Thin parts: where another sheet of the surface is nearer than the target spacing, and what features one sheet has.

The ball of the features (Eq. (2)) holds both sheets there. Its flattest direction may then be any, since two disks at
a distance of about their radius are as thick as they are wide.
"""

import math

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.density import roundness_of
from gppcs.gp.local.settings import (
    MIN_ROUGHNESS,
    MUCH_THIN,
    PLANE_POINTS,
    SHEET_GAP,
    SHEET_SPACINGS,
    SHEET_VARIATION,
    THIN_FRACTION,
)
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, first_leaf, leaf_range, leaves_near, points_near
from gppcs.spatial.leaves import MANY_LEAVES, pack, radius_of_nearest, search_buffer
from gppcs.surface.moments import MOMENTS, flattest_of, moments_in_ball, with_step

SIGMAS = 3.0  # Standard deviations from this plane at least in which the other sheet lies.
FEW = 64  # Runs of points that follow each other in a tree, by which a cloud has thin parts or none.
POINTS_FOR_EACH = 625  # Of a small cloud, for each point of a run: four at least, if so many are there.


def sheets_of(tree: KdTree, points: Floats, radius: float, is_thin: bool | None = None) -> Floats | None:
    """Return what `toward_other_sheet` returns for points, (n, 3); None without thin parts.

    The tree is over the points of the surface, which may be told to have thin parts or none.
    """
    if is_thin is None:
        some = toward_other_sheet(tree, _runs_of(tree), radius, SHEET_VARIATION)
        is_thin = some.any(axis=1).mean() >= THIN_FRACTION
    return toward_other_sheet(tree, KdTree.build(points), radius) if is_thin else None


def sheet_factors_of(tree: KdTree, sheets: Floats, spacing: float) -> Floats:
    """Return the factors of the roughness of a tree's points by their own sheet and the opposite one, (n,) (Eq. (3b)).

    The rougher one, such as the inside of a tube, gets more of the points of both. All is in the order of the tree and
    in units of a spacing, but sheets, (n, 4), as `toward_other_sheet` returns them.
    """
    thin, ways = np.flatnonzero(sheets.any(axis=1)), sheets[:, :3]
    roughness = np.clip(sheets[:, 3], MIN_ROUGHNESS, math.sqrt(SHEET_VARIATION))  # what is rougher lies at a rim
    opposite = tree.in_own_order().nearest_of(tree.points.T[thin] + ways[thin] / spacing, 1)[0][:, 0]
    thin, opposite = np.stack([thin, opposite])[:, (ways[thin] * ways[opposite]).sum(axis=1) < 0.0]
    factors = np.ones(len(sheets))
    factors[thin] = 2.0 / (1.0 + np.sqrt(roughness[opposite] / roughness[thin]))
    return factors


def normal_factor_of(sheets: Floats, is_last: bool) -> float:
    """Return the factor of the weight of the normals, by the sheets of a stage's candidates, (n, 4) (Eq. (3c)).

    The kept points cannot follow the rims of thin parts, nor, in the last stage, the edges between thin flat walls. So
    the roundness of the thin candidates' own sheets is a factor there, in full from a fraction of `MUCH_THIN` on.
    """
    thin = sheets.any(axis=1)
    fraction = float(np.mean(thin))
    factor = 1.0 - fraction
    if is_last and fraction > 0.0:
        factor *= 1.0 - min(1.0, fraction / MUCH_THIN) * (1.0 - roundness_of(sheets[thin, 3]))
    return factor


def _runs_of(tree: KdTree) -> KdTree:
    """Return a tree over `FEW` runs of points, evenly spread, as points of a run share one search."""
    n = len(tree.order)
    in_run = min(max(4, n // POINTS_FOR_EACH), LEAF_SIZE, -(-n // FEW))
    starts = (n - in_run) * np.arange(FEW) // (FEW - 1)
    return KdTree.over(tree.points[:, (starts[:, np.newaxis] + np.arange(in_run)).ravel()], leaf_size=in_run)


def toward_other_sheet(tree: KdTree, queries: KdTree, radius: float, max_variation: float = math.inf) -> Floats:
    """Return the ways from the sheets of points to another within a radius, and the roughness of the sheets, (n, 4).

    The ways are along the normals of the sheets. All is 0 where there is none, or where the surface variation of the
    point's own sheet is larger. The points are those of a tree; the result is in its input's order.
    """
    sheets = np.zeros((len(queries.order), 4))
    on_ranges(
        _fill_leaves, queries.leaves, *tree.arrays, queries.order, *queries.arrays, radius, max_variation, sheets,
        minimum=8,
    )  # fmt: skip
    return sheets


@kernel
def _fill_leaves(
    begin, end, points, lower, upper, order, queries, queries_lower, queries_upper, radius, max_variation, sheets
):
    """Fill sheets, (n, 4), at the queries, (3, n), of a range of leaves, by points, (3, N); boxes are (nodes, 3)."""
    n, leaves, squared_radius = queries.shape[1], first_leaf(queries_lower), radius * radius
    near, buffer = np.empty(first_leaf(lower), dtype=np.int64), search_buffer(MANY_LEAVES)
    scratch = np.empty(buffer.packed.shape[1], dtype=np.float64)
    moments, normal = np.empty((MOMENTS, 1), dtype=np.float64), np.empty(3, dtype=np.float64)
    for leaf in range(leaves + begin, leaves + end):
        box = queries_lower[leaf], queries_upper[leaf]
        count = leaves_near(lower, upper, *box, squared_radius, near)
        if count * LEAF_SIZE > len(buffer.positions):
            buffer = search_buffer(2 * count)
            scratch = np.empty(buffer.packed.shape[1], dtype=np.float64)
        full = pack(
            points, buffer, points_near(points, lower, upper, near[:count], *box, squared_radius, buffer.positions)
        )
        for i in range(*leaf_range(n, leaves, leaf)):
            x, y, z = queries[0, i], queries[1, i], queries[2, i]
            squared = radius_of_nearest(buffer.packed, full, x, y, z, PLANE_POINTS, squared_radius, scratch)
            if squared <= 0.0:  # there are fewer points, or repeats
                continue
            moments_in_ball(buffer.packed, full, x, y, z, squared, moments, 0)
            variation = flattest_of(moments[:, 0], normal)
            spacing, sigma = np.sqrt(np.pi * squared / PLANE_POINTS), np.sqrt(0.5 * variation * squared)
            nearest = max(SHEET_SPACINGS * spacing, SIGMAS * sigma)
            height = _height_of_other(buffer.packed, full, (x, y, z), normal, nearest, 1.5 * spacing, squared_radius)
            if height != 0.0:
                _moments_of_sheet(buffer.packed, full, (x, y, z), normal, 0.5 * height, squared_radius, moments)
                upward = normal[0], normal[1], normal[2]
                variation = flattest_of(moments[:, 0], normal)
                if variation > max_variation:
                    continue
                turn = height * (normal[0] * upward[0] + normal[1] * upward[1] + normal[2] * upward[2])
                for axis in range(3):  # assigning the array would compile a second of code
                    sheets[order[i], axis] = np.copysign(height, turn) * normal[axis]
                sheets[order[i], 3] = np.sqrt(variation)


@kernel(allocates=False)
def _height_of_other(packed, full, point, normal, nearest, width, squared_radius):
    """Return the height of the other sheet above a point, 0 if there is none: with a gap between, by packed points."""
    height = np.inf
    for j in range(full):
        step, up = _step(packed, j, point, normal)
        if nearest < abs(up) < abs(height) and step <= squared_radius and up * up > 0.5 * step:
            height = up
    if height == np.inf:
        return 0.0
    squared_width = max(0.5 * abs(height), width) ** 2
    between = beyond = 0
    for j in range(full):
        step, up = _step(packed, j, point, normal)
        if step - up * up <= squared_width:
            between += 1 if 0.3 < up / height < 0.7 else 0
            beyond += 1 if 0.7 <= up / height < 1.3 else 0
    return height if beyond >= 3 and between <= SHEET_GAP * beyond else 0.0


@kernel(allocates=False)
def _moments_of_sheet(packed, full, point, normal, middle, squared_radius, moments):
    """Fill moments, (10, 1), with those of the points within a radius on this side of the middle between two sheets."""
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for j in range(full):
        step, up = _step(packed, j, point, normal)
        if step <= squared_radius and up / middle < 1.0:
            sums = with_step(sums, 1.0, packed[0, j] - point[0], packed[1, j] - point[1], packed[2, j] - point[2])
    for m in range(MOMENTS):
        moments[m, 0] = sums[m]


@kernel(inline="always")
def _step(packed, j, point, normal):
    """Return the squared distance of a packed point from another point, and its height above that along a normal."""
    dx, dy, dz = packed[0, j] - point[0], packed[1, j] - point[1], packed[2, j] - point[2]
    return dx * dx + dy * dy + dz * dz, dx * normal[0] + dy * normal[1] + dz * normal[2]
