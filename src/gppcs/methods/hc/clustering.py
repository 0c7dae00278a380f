"""Hierarchical clustering: split a cloud by planes until its clusters are flat or small (Pauly et al. 2002)."""

import heapq
import math

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel


def hierarchical_clusters(
    points: Floats, size: int = 1, variation: float = math.inf, maximum: int | None = None
) -> Ints:
    """Choose a point of each cluster of (N, 3), split by planes across its axis until it is small and flat.

    That of largest size times surface variation is split next, and none if there are as many as the maximum.
    """
    chosen = np.empty(len(points) if maximum is None else maximum, dtype=np.int64)
    return chosen[: _split(points.T.copy(), np.arange(len(points)), size, variation, chosen)]


@kernel
def _split(coordinates, order, size, variation, chosen):
    """Split clusters of points, (3, N), beyond the limits; fill `chosen`, (M,), and return the number of clusters."""
    n, maximum = len(order), len(chosen)
    buffer, order_buffer = np.empty((3, n), dtype=np.float64), np.empty(n, dtype=np.int64)
    begins, ends = np.zeros(maximum, dtype=np.int64), np.full(maximum, n, dtype=np.int64)
    centroids, axes = np.empty((maximum, 3), dtype=np.float64), np.empty((maximum, 3), dtype=np.float64)
    heap = [_rank(coordinates, order, 0, n, centroids[0], axes[0], 0)]
    if n <= size and heap[0][0] >= -variation * n:
        heap.clear()
    count = 1
    while heap and count < maximum:
        cluster = heapq.heappop(heap)[3]
        begin, end = begins[cluster], ends[cluster]
        middle = _part(coordinates, order, begin, end, centroids[cluster], axes[cluster], buffer, order_buffer)
        if not begin < middle < end:
            middle = (begin + end) // 2
        ends[cluster] = begins[count] = middle
        ends[count] = end
        for child in (cluster, count):
            rank = _rank(coordinates, order, begins[child], ends[child], centroids[child], axes[child], child)
            if -rank[1] > size or rank[0] < variation * rank[1]:
                heapq.heappush(heap, rank)
        count += 1
    for cluster in range(count):
        chosen[cluster] = order[_most_central(coordinates, begins[cluster], ends[cluster], centroids[cluster])]
    return count


@kernel
def _rank(coordinates, order, begin, end, centroid, axis, cluster):
    """Fill `centroid` and `axis`, (3,), of a cluster; return its key in the heap, which pops the smallest first."""
    varies = _spread(coordinates, begin, end, centroid, axis)
    members = end - begin
    return -members * varies, -members, order[begin], cluster


@kernel(fastmath={"nsz", "contract", "reassoc"})
def _spread(coordinates, begin, end, centroid, axis):
    """Fill `centroid` and principal `axis`, (3,), of the points begin..end, (3, N); return their surface variation."""
    n = end - begin
    x, y, z = coordinates[0, begin], coordinates[1, begin], coordinates[2, begin]
    sx = sy = sz = 0.0
    for i in range(begin, end):
        sx += coordinates[0, i] - x
        sy += coordinates[1, i] - y
        sz += coordinates[2, i] - z
    x, y, z = x + sx / n, y + sy / n, z + sz / n
    centroid[0], centroid[1], centroid[2] = x, y, z
    sxx = sxy = sxz = syy = syz = szz = 0.0
    for i in range(begin, end):
        dx, dy, dz = coordinates[0, i] - x, coordinates[1, i] - y, coordinates[2, i] - z
        sxx += dx * dx
        sxy += dx * dy
        sxz += dx * dz
        syy += dy * dy
        syz += dy * dz
        szz += dz * dz
    return _principal_axis(sxx, sxy, sxz, syy, syz, szz, axis)


@kernel
def _principal_axis(xx, xy, xz, yy, yz, zz, axis):
    """Fill `axis`, (3,), with the first principal axis by Jacobi's rotations; return lambda_0 / trace."""
    trace = xx + yy + zz
    if not trace > 0.0:
        axis[0], axis[1], axis[2] = 1.0, 0.0, 0.0
        return 0.0
    a = np.empty((3, 3), dtype=np.float64)
    a[0] = xx / trace, xy / trace, xz / trace
    a[1] = xy / trace, yy / trace, yz / trace
    a[2] = xz / trace, yz / trace, zz / trace
    vectors = np.eye(3)
    while abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2]) > 1e-17:
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if a[p, q] != 0.0:
                _rotate(a, vectors, p, q)
    largest = np.argmax(np.array([a[0, 0], a[1, 1], a[2, 2]]))
    axis[:] = vectors[:, largest]
    smallest = min(a[0, 0], a[1, 1], a[2, 2])
    return smallest if smallest > 1e-12 else 0.0  # less is rounding


@kernel
def _rotate(a, vectors, p, q):
    """Rotate the axes p and q of `a` and `vectors`, (3, 3), so that a[p, q] becomes zero."""
    theta = (a[q, q] - a[p, p]) / (2 * a[p, q])
    t = (1.0 if theta >= 0 else -1.0) / (abs(theta) + np.hypot(theta, 1.0))
    c = 1 / np.sqrt(t * t + 1)
    s = t * c
    r = 3 - p - q
    a[p, p], a[q, q] = a[p, p] - t * a[p, q], a[q, q] + t * a[p, q]
    a[p, r], a[q, r] = c * a[p, r] - s * a[q, r], s * a[p, r] + c * a[q, r]
    a[p, q] = a[q, p] = 0.0
    a[r, p], a[r, q] = a[p, r], a[q, r]
    for row in vectors:
        row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]


@kernel
def _part(coordinates, order, begin, end, centroid, axis, buffer, order_buffer):
    """Move the points of begin..end, (3, N), below the plane to the front, in order; return where the others start."""
    front, back = begin, 0
    for i in range(begin, end):
        x, y, z, index = coordinates[0, i], coordinates[1, i], coordinates[2, i], order[i]
        along = (x - centroid[0]) * axis[0] + (y - centroid[1]) * axis[1] + (z - centroid[2]) * axis[2]
        # Each point is written to both sides and kept on one, without a branch that could be mispredicted.
        coordinates[0, front], coordinates[1, front], coordinates[2, front], order[front] = x, y, z, index
        buffer[0, back], buffer[1, back], buffer[2, back], order_buffer[back] = x, y, z, index
        negative = int(along < 0.0)
        front += negative
        back += 1 - negative
    coordinates[:, front:end] = buffer[:, :back]
    order[front:end] = order_buffer[:back]
    return front


@kernel
def _most_central(coordinates, begin, end, centroid):
    """Return the position of the point of begin..end, (3, N), nearest the centroid, (3,); ties go to the first."""
    best, nearest = begin, np.inf
    for i in range(begin, end):
        x, y, z = coordinates[0, i], coordinates[1, i], coordinates[2, i]
        squared = (x - centroid[0]) ** 2 + (y - centroid[1]) ** 2 + (z - centroid[2]) ** 2
        if squared < nearest:
            best, nearest = i, squared
    return best
