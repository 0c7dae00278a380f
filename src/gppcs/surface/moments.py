"""Moments of neighbourhoods, and the smallest eigenvalue of their covariance with its eigenvector.

The moments of a neighbourhood are ten numbers: the number of its points, the sums of x, y and z, and the sums of xx,
xy, xz, yy, yz and zz, all relative to an origin.
"""

import numpy as np

from gppcs.engine.kernels import kernel

MOMENTS = 10  # numbers per neighbourhood, see above
AT_ONCE = 32  # neighbourhoods that one vectorised loop handles: those of all points in a leaf of the tree

# The polynomial -cos(2/3 arccos((1 + x) / 2)) for x from -1 to 1, highest power first, exact to a few roundings.
_CHEBYSHEV = np.polynomial.Chebyshev.interpolate(lambda x: -np.cos(2 / 3 * np.arccos((1 + x) / 2)), 18)
SMALLEST_ROOT = np.polynomial.chebyshev.cheb2poly(_CHEBYSHEV.coef)[::-1].copy()


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def moments_in_ball(packed, count, x, y, z, squared_radius, moments, p):
    """Fill column p of `moments`, (10, n), with those of the packed points, (3, m), within a radius of (x, y, z)."""
    along_x, along_y, along_z = packed[0][:count], packed[1][:count], packed[2][:count]
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for j in range(len(along_x)):
        dx, dy, dz = along_x[j] - x, along_y[j] - y, along_z[j] - z
        inside = dx * dx + dy * dy + dz * dz <= squared_radius
        one = 1.0 if inside else 0.0
        sums = with_step(sums, one, dx if inside else 0.0, dy if inside else 0.0, dz if inside else 0.0)
    for m in range(MOMENTS):
        moments[m, p] = sums[m]


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def with_step(sums, one, x, y, z):
    """Return moments, a tuple, with those of one more point at (x, y, z); where all is 0, there is none."""
    n, sx, sy, sz, sxx, sxy, sxz, syy, syz, szz = sums
    return (
        n + one, sx + x, sy + y, sz + z, sxx + x * x, sxy + x * y, sxz + x * z, syy + y * y, syz + y * z, szz + z * z,
    )  # fmt: skip


@kernel(inline="always")
def middle(lower, upper):
    """Return the middle of a box. Shapes: lower, upper (3,)."""
    return 0.5 * (lower[0] + upper[0]), 0.5 * (lower[1] + upper[1]), 0.5 * (lower[2] + upper[2])


@kernel(fastmath=False, allocates=False)
def add_shifted(moments, x, y, z, total):
    """Add moments relative to one origin to moments relative to another origin. Shapes: moments (10,), total (10,)."""
    n, sx, sy, sz = moments[0], moments[1], moments[2], moments[3]
    total[0] += n
    total[1] += sx + n * x
    total[2] += sy + n * y
    total[3] += sz + n * z
    total[4] += moments[4] + 2.0 * x * sx + n * x * x
    total[5] += moments[5] + x * sy + y * sx + n * x * y
    total[6] += moments[6] + x * sz + z * sx + n * x * z
    total[7] += moments[7] + 2.0 * y * sy + n * y * y
    total[8] += moments[8] + y * sz + z * sy + n * y * z
    total[9] += moments[9] + 2.0 * z * sz + n * z * z


@kernel(inline="always")
def flattest(xx, xy, xz, yy, yz, zz, normal):
    """Find the smallest eigenvalue of a symmetric 3 x 3 matrix (Smith 1961), and its eigenvector, `normal`, (3,)."""
    trace = xx + yy + zz
    normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
    if not trace > 0.0:
        return 0.0
    xx, xy, xz, yy, yz, zz = xx / trace, xy / trace, xz / trace, yy / trace, yz / trace, zz / trace
    off = xy * xy + xz * xz + yz * yz
    a, b, c = xx - 1 / 3, yy - 1 / 3, zz - 1 / 3
    p = np.sqrt((a * a + b * b + c * c + 2 * off) / 6)
    if p < 1e-12:
        return 1 / 3
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = np.arccos(min(1.0, max(-1.0, determinant / (2 * p**3)))) / 3
    smallest = 1 / 3 + 2 * p * np.cos(angle + 2 * np.pi / 3)
    _null_vector(xx - smallest, xy, xz, yy - smallest, yz, zz - smallest, normal)
    return max(0.0, smallest)


@kernel(fastmath=False, allocates=False)
def flattest_of(moments, normal):
    """Find what `flattest` finds, for the covariance of the points that have these moments, (10,)."""
    n = moments[0]
    x, y, z = moments[1] / n, moments[2] / n, moments[3] / n
    return flattest(
        moments[4] / n - x * x, moments[5] / n - x * y, moments[6] / n - x * z,
        moments[7] / n - y * y, moments[8] / n - y * z, moments[9] / n - z * z, normal,
    )  # fmt: skip


@kernel(inline="always")
def _null_vector(xx, xy, xz, yy, yz, zz, normal):
    """Fill `normal`, (3,), with a unit vector that a singular symmetric matrix maps to zero."""
    crosses = (
        (xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy),
        (xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz),
        (yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz),
    )
    longest = 1e-20
    for x, y, z in crosses:
        squared = x * x + y * y + z * z
        if squared > longest:
            longest = squared
            length = np.sqrt(squared)
            normal[0], normal[1], normal[2] = x / length, y / length, z / length
    if longest == 1e-20:
        # The matrix has rank one: any vector orthogonal to its largest row is a null vector.
        x, y, z = xx, xy, xz
        if yy > xx and yy >= zz:
            x, y, z = xy, yy, yz
        elif zz > xx:
            x, y, z = xz, yz, zz
        if abs(x) <= abs(z) or abs(y) <= abs(z):
            x, y, z = (0.0, z, -y) if abs(x) <= abs(y) else (z, 0.0, -x)
        else:
            x, y, z = y, -x, 0.0
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0:
            normal[0], normal[1], normal[2] = x / length, y / length, z / length


@kernel(fastmath={"nsz", "arcp", "contract", "reassoc"}, allocates=False)
def flattest_side_by_side(moments, variation, normals, sure):
    """Find what `flattest` finds for AT_ONCE neighbourhoods, (10, AT_ONCE), in one vectorised loop without branches."""
    for p in range(AT_ONCE):
        inverse = 1.0 / moments[0, p]
        x, y, z = moments[1, p] * inverse, moments[2, p] * inverse, moments[3, p] * inverse
        xx, xy, xz = moments[4, p] * inverse - x * x, moments[5, p] * inverse - x * y, moments[6, p] * inverse - x * z
        yy, yz, zz = moments[7, p] * inverse - y * y, moments[8, p] * inverse - y * z, moments[9, p] * inverse - z * z
        inverse = 1.0 / (xx + yy + zz)
        xx, xy, xz, yy, yz, zz = xx * inverse, xy * inverse, xz * inverse, yy * inverse, yz * inverse, zz * inverse
        off = xy * xy + xz * xz + yz * yz
        a, b, c = xx - 1 / 3, yy - 1 / 3, zz - 1 / 3
        size = np.sqrt((a * a + b * b + c * c + 2.0 * off) * (1 / 6))
        determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
        # cos(arccos(r) / 3) by arccos sqrt((1 - r) / 2), which is smooth where a neighbourhood is flat.
        t = 2.0 * np.sqrt(max(0.0, 0.5 - determinant / (4.0 * size * size * size))) - 1.0
        root = SMALLEST_ROOT[0]
        for power in range(1, len(SMALLEST_ROOT)):
            root = root * t + SMALLEST_ROOT[power]
        smallest = 1 / 3 + 2.0 * size * root
        xx, yy, zz = xx - smallest, yy - smallest, zz - smallest
        x, y, z = xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy
        longest = x * x + y * y + z * z
        u, v, w = xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz
        squared = u * u + v * v + w * w
        longer = squared > longest
        x, y, z, longest = u if longer else x, v if longer else y, w if longer else z, squared if longer else longest
        u, v, w = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
        squared = u * u + v * v + w * w
        longer = squared > longest
        x, y, z, longest = u if longer else x, v if longer else y, w if longer else z, squared if longer else longest
        inverse = 1.0 / np.sqrt(longest)
        variation[p] = max(0.0, smallest)
        normals[0, p], normals[1, p], normals[2, p] = x * inverse, y * inverse, z * inverse
        sure[p] = 1.0 if longest > 1e-20 else 0.0


@kernel(fastmath=False)
def tangents(x, y, z):
    """Return two unit vectors that are orthogonal to a unit vector and to each other."""
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        length = np.sqrt(y * y + z * z)
        u = 0.0, -z / length, y / length
    elif abs(y) <= abs(z):
        length = np.sqrt(x * x + z * z)
        u = z / length, 0.0, -x / length
    else:
        length = np.sqrt(x * x + y * y)
        u = -y / length, x / length, 0.0
    return u, (y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0])
