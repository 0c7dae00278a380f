"""Detail: attributes that count beside the shape, as further outputs of the field over one metric.

A jump of an attribute counts as distance (Eq. (18)), and its variation as roughness (Eq. (19)).
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.settings import DETAIL_DISTANCE, DETAIL_ROUGHNESS
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, first_leaf, leaf_range, leaves_near, points_near
from gppcs.spatial.leaves import MANY_LEAVES, pack, search_buffer
from gppcs.surface.moments import MOMENTS, with_step

FIT_RADIUS = 1.5  # Within which an attribute varies, in edge lengths of the candidates' cells.


class Detail(NamedTuple):
    """What counts of k attributes of n points."""

    values: NDArray[np.float32]  # (n, k), the attributes, in ranges, and less where noise is part of them
    variation: NDArray[np.float32]  # (n,), what they add to the surface variation; 0 where it was not measured

    @classmethod
    def measure(cls, tree: KdTree, indices: Ints, attributes: NDArray[np.float32], edge: float) -> Detail | None:
        """Measure attributes, (N, k), of a cloud at the points, (n,), in a tree (Eq. (19)); None if all is noise."""
        measured = indices[tree.order]
        values = attributes.take(measured, axis=0).astype(np.float64)
        residual = residuals(tree, values, FIT_RADIUS * edge)
        noise = np.median(residual, axis=0)  # r_0^2: where the attributes hardly vary
        variance = np.maximum(values.var(axis=0), np.finfo(np.float32).tiny)
        # c: the fraction of their variance that linear functions explain, with a margin.
        strength = np.maximum(1.0 - 1.2 * residual.mean(axis=0) / variance, 0.0)
        if not strength.any():
            warnings.warn("the detail is only noise at this number of points: it counts for nothing", stacklevel=2)
            return None
        variation = np.zeros(len(attributes), dtype=np.float32)
        variation[measured] = DETAIL_ROUGHNESS * (np.maximum(residual - 3.0 * noise, 0.0) @ strength)
        return cls(attributes * np.sqrt(strength, dtype=np.float32), variation)

    def take(self, indices: Ints) -> Detail:
        """Return that of some of the points."""
        return Detail(self.values.take(indices, axis=0), self.variation[indices])

    @property
    def distances(self) -> Floats:
        """The attributes as distances in desired spacings, (k, n)."""
        return DETAIL_DISTANCE * np.ascontiguousarray(self.values.T, dtype=np.float64)


def residuals(tree: KdTree, values: Floats, radius: float) -> Floats:
    """Return the variances of values about linear fits to the points within a radius, both (n, k) in tree order."""
    variances = np.empty_like(values)
    on_ranges(_residuals, tree.leaves, *tree.arrays, values, radius * radius, variances)
    return variances


@kernel
def _residuals(begin, end, points, lower, upper, values, squared_radius, variances):
    """Fill `variances`, (n, k), for a range of leaves."""
    n, leaves, k = points.shape[1], first_leaf(lower), values.shape[1]
    near, buffer = np.empty(leaves, dtype=np.int64), search_buffer(MANY_LEAVES)
    packed, steps = np.zeros((k, buffer.packed.shape[1])), np.empty((4, buffer.packed.shape[1]))
    moments, products = np.empty(MOMENTS), np.empty((k, 5))
    for leaf in range(leaves + begin, leaves + end):
        count = leaves_near(lower, upper, lower[leaf], upper[leaf], squared_radius, near)
        if count * LEAF_SIZE > len(buffer.positions):
            buffer = search_buffer(2 * count)
            packed, steps = np.zeros((k, buffer.packed.shape[1])), np.empty((4, buffer.packed.shape[1]))
        count = points_near(
            points, lower, upper, near[:count], lower[leaf], upper[leaf], squared_radius, buffer.positions
        )
        full = pack(points, buffer, count)
        for c in range(k):
            for slot in range(count):
                packed[c, slot] = values[buffer.positions[slot], c]
        for i in range(*leaf_range(n, leaves, leaf)):
            _steps(buffer.packed, full, points[0, i], points[1, i], points[2, i], squared_radius, steps, moments)
            for c in range(k):
                _add_products(steps, packed[c], values[i, c], full, products[c])
            ridge = 1e-3 * squared_radius  # as points are mostly coplanar
            _variances_left(moments, products, ridge, variances[i])


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def _steps(packed, full, x, y, z, squared_radius, steps, moments):
    """Fill `steps`, (4, m), with steps to the points within a radius, and ones, 0 beyond; and `moments`, (10,)."""
    along_x, along_y, along_z = packed[0][:full], packed[1][:full], packed[2][:full]
    to_x, to_y, to_z, inside = steps[0][:full], steps[1][:full], steps[2][:full], steps[3][:full]
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for j in range(len(along_x)):
        dx, dy, dz = along_x[j] - x, along_y[j] - y, along_z[j] - z
        near = dx * dx + dy * dy + dz * dz <= squared_radius
        one = 1.0 if near else 0.0
        dx, dy, dz = dx if near else 0.0, dy if near else 0.0, dz if near else 0.0
        to_x[j], to_y[j], to_z[j], inside[j] = dx, dy, dz, one
        sums = with_step(sums, one, dx, dy, dz)
    for m in range(MOMENTS):
        moments[m] = sums[m]


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def _add_products(steps, values, value, full, products):
    """Sum, within a radius of a point, the differences of an attribute from that of the point, and products, (5,)."""
    to_x, to_y, to_z, inside = steps[0][:full], steps[1][:full], steps[2][:full], steps[3][:full]
    values = values[:full]
    s = ss = sx = sy = sz = 0.0
    for j in range(len(values)):
        d = (values[j] - value) * inside[j]
        s += d
        ss += d * d
        sx += d * to_x[j]
        sy += d * to_y[j]
        sz += d * to_z[j]
    products[0], products[1], products[2], products[3], products[4] = s, ss, sx, sy, sz


@kernel(allocates=False)
def _variances_left(moments, products, ridge, variances):
    """Fill `variances`, (k,), with what linear functions of the position leave of attributes, by moments, (10,)."""
    m, is_fitted = moments[0], moments[0] >= 6.0  # a fit to fewer values follows their noise
    x, y, z = moments[1] / m, moments[2] / m, moments[3] / m
    xx, xy, xz = moments[4] / m - x * x + ridge, moments[5] / m - x * y, moments[6] / m - x * z
    yy, yz, zz = moments[7] / m - y * y + ridge, moments[8] / m - y * z, moments[9] / m - z * z + ridge
    # Cofactors of the covariance of the positions.
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    determinant, coefficients = xx * a + xy * b + xz * c, 4.0 if is_fitted else 1.0
    for k in range(len(products)):
        value = products[k, 0] / m
        variances[k] = products[k, 1] / m - value * value
        if is_fitted:
            p, q, r = products[k, 2] / m - value * x, products[k, 3] / m - value * y, products[k, 4] / m - value * z
            explained = a * p * p + d * q * q + f * r * r + 2.0 * (b * p * q + c * p * r + e * q * r)
            variances[k] -= explained / determinant
        variances[k] = max(variances[k], 0.0) * (m / max(m - coefficients, 1.0))
