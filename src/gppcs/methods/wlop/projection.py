"""Weighted locally optimal projection: samples pulled onto the surface and pushed apart (Huang et al. 2009)."""

from collections.abc import Callable

import numpy as np

from gppcs.engine.arrays import Floats
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.box_distances import squared_distance_to_box
from gppcs.spatial.kdtree import LEAF_SIZE, KdTree, first_leaf, leaf_range, leaves_near, measure_boxes

SAME_PLACE = 1e-10  # points whose squared distance is below this fraction of the squared radius ignore each other


def project(
    tree: KdTree,
    samples: Floats,
    radius: float,
    iterations: int = 35,
    mu: float = 0.45,
    require_uniform: bool = False,
    on_progress: Callable[[int], None] | None = None,
) -> Floats:
    r"""Move samples, (M, 3), to the weighted mean of the points of a tree and away from each other, repeatedly.

    Let theta(r) = exp(-4 r^2 / h^2) for r up to h, and zero beyond. In each iteration, every sample x moves to

        x + sum_j alpha_j (p_j - x) / sum_j alpha_j + mu sum_k beta_k (x - x_k) / sum_k beta_k,

    with alpha_j = theta(\|x - p_j\|) w_j of the points, and beta_k = omega_k theta(r_k) / r_k^2 of the other samples at
    distances r_k. These are CGAL's weights, so that results can be compared; those of Huang et al. (2009) differ. As in
    CGAL, fewer than two others within h do not repel, and a point at the position of a sample does not attract.
    """
    weights = np.ones(len(tree.order), dtype=np.float64)
    if require_uniform:
        weights /= _crowding(*tree.arrays, radius)
    # Samples move little, so their tree stays good if only its boxes are updated.
    now = KdTree.build(samples)
    positions, lower, upper = now.arrays
    for _ in range(iterations):
        # Like CGAL, the density of a sample counts the sample itself twice.
        omega = 1 + _crowding(positions, lower, upper, radius)
        moved = np.empty_like(positions)
        on_ranges(_move, now.leaves, *tree.arrays, weights, positions, lower, upper, omega, radius, mu, moved)
        positions = moved
        measure_boxes(positions, lower, upper)
        if on_progress:
            on_progress(1)
    projected = np.empty_like(samples)
    projected[now.order] = positions.T
    return projected


@kernel(allocates=False)
def _theta(t):
    """Return exp(-4 t) for t from 0 to 1, to eleven digits, and zero beyond; it has no calls, so it is vectorised."""
    s = 0.25 - 0.5 * t
    e = 1 + s / 8 * (1 + s / 9)
    e = 1 + s / 4 * (1 + s / 5 * (1 + s / 6 * (1 + s / 7 * e)))
    e = 1 + s * (1 + s / 2 * (1 + s / 3 * e))
    e *= e
    e *= e
    e *= e
    return e * np.exp(-2.0) if t <= 1.0 else 0.0


def _crowding(points: Floats, lower: Floats, upper: Floats, radius: float) -> Floats:
    """Return 1 + sum theta over the other points, (N,), for each of the points, (3, N)."""
    crowding = np.empty(points.shape[1])
    on_ranges(_crowd, len(lower) // 2, points, lower, upper, radius, crowding)
    return crowding


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _crowd(begin, end, points, lower, upper, radius, crowding):
    """Fill `crowding`, (N,), in a range of leaves; see `_crowding`."""
    n = points.shape[1]
    leaves = first_leaf(lower)
    buffer = np.empty(leaves, dtype=np.int64)
    for leaf in range(begin, end):
        near = buffer[: leaves_near(lower, upper, lower[leaves + leaf], upper[leaves + leaf], radius * radius, buffer)]
        for i in range(*leaf_range(n, leaves, leaves + leaf)):
            x, y, z = points[0, i], points[1, i], points[2, i]
            total = 0.0
            for node in near:
                if squared_distance_to_box(lower[node], upper[node], x, y, z) > radius * radius:
                    continue
                for j in range(*leaf_range(n, leaves, node)):
                    dx, dy, dz = points[0, j] - x, points[1, j] - y, points[2, j] - z
                    total += _theta((dx * dx + dy * dy + dz * dz) / (radius * radius))
            crowding[i] = total  # the sum includes the point itself, whose theta is 1


@kernel
def _move(begin, end, points, lower, upper, weights, samples, sample_lower, sample_upper, omega, radius, mu, moved):
    """Fill `moved` with the samples, (3, M), of a range of leaves, which weight a search, after one iteration."""
    leaves = first_leaf(sample_lower)
    m = samples.shape[1]
    buffer, sample_buffer = np.empty(first_leaf(lower), dtype=np.int64), np.empty(leaves, dtype=np.int64)
    factors = np.empty(LEAF_SIZE, dtype=np.float64)
    for leaf in range(begin, end):
        box_lower, box_upper = sample_lower[leaves + leaf], sample_upper[leaves + leaf]
        near = buffer[: leaves_near(lower, upper, box_lower, box_upper, radius * radius, buffer)]
        count = leaves_near(sample_lower, sample_upper, box_lower, box_upper, radius * radius, sample_buffer)
        near_samples = sample_buffer[:count]
        for i in range(*leaf_range(m, leaves, leaves + leaf)):
            x, y, z = samples[0, i], samples[1, i], samples[2, i]
            ax, ay, az, _ = _pull(points, lower, upper, weights, near, radius, x, y, z, False, factors)
            bx, by, bz, within = _pull(
                samples, sample_lower, sample_upper, omega, near_samples, radius, x, y, z, True, factors
            )
            push = -mu if within > 2 else 0.0
            moved[0, i], moved[1, i], moved[2, i] = x + ax + push * bx, y + ay + push * by, z + az + push * bz


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"})
def _pull(points, lower, upper, weights, near, radius, x, y, z, by_square, factors):
    """Return the vector to the weighted mean of the points, (3, N), around (x, y, z), and the number within the radius.

    `factors`, (LEAF_SIZE,), is room for weights. Loops that fill it are vectorised; sums are not, to keep their order.
    """
    leaves = first_leaf(lower)
    n = points.shape[1]
    within = 0
    total = sx = sy = sz = 0.0
    for node in near:
        if squared_distance_to_box(lower[node], upper[node], x, y, z) > radius * radius:
            continue
        begin, end = leaf_range(n, leaves, node)
        xs, ys, zs, of_points = points[0, begin:end], points[1, begin:end], points[2, begin:end], weights[begin:end]
        for j in range(len(xs)):
            dx, dy, dz = xs[j] - x, ys[j] - y, zs[j] - z
            factors[j] = (dx * dx + dy * dy + dz * dz) / (radius * radius)
        if by_square:
            for j in range(len(xs)):
                within += int(factors[j] <= 1.0)
            for j in range(len(xs)):
                t, weight = factors[j], of_points[j]
                factors[j] = (weight if t >= SAME_PLACE else 0.0) * _theta(t) / max(t, SAME_PLACE)
        else:
            for j in range(len(xs)):
                t, weight = factors[j], of_points[j]
                factors[j] = (weight if t >= SAME_PLACE else 0.0) * _theta(t)
        total, sx, sy, sz = _add_up(factors, xs, ys, zs, x, y, z, total, sx, sy, sz)
    if total > 0.0:
        return sx / total, sy / total, sz / total, within
    return 0.0, 0.0, 0.0, within


@kernel(fastmath={"nsz", "contract"})
def _add_up(factors, xs, ys, zs, x, y, z, total, sx, sy, sz):
    """Add the factors, (n,) or more, and factors times the steps from (x, y, z) to n places, to four sums."""
    for j in range(len(xs)):
        weight = factors[j]
        total += weight
        sx += weight * (xs[j] - x)
        sy += weight * (ys[j] - y)
        sz += weight * (zs[j] - z)
    return total, sx, sy, sz
