"""Error quadrics: sums of squared distances to planes (Garland and Heckbert 1997).

The quadric of a point p is q(x) = (x - p) A (x - p) + 2 b (x - p) + c, relative to p so that little precision is lost.
Its ten numbers are the elements xx, xy, xz, yy, yz and zz of A, the three of b, and c.
"""

from gppcs.engine.kernels import kernel

NUMBERS = 10  # of a quadric


@kernel(allocates=False)
def add_plane(quadric, normal, height, weight):
    """Add a plane to a quadric. Shapes: quadric (10,)."""
    x, y, z = normal
    quadric[0] += weight * x * x
    quadric[1] += weight * x * y
    quadric[2] += weight * x * z
    quadric[3] += weight * y * y
    quadric[4] += weight * y * z
    quadric[5] += weight * z * z
    quadric[6] += weight * height * x
    quadric[7] += weight * height * y
    quadric[8] += weight * height * z
    quadric[9] += weight * height * height


@kernel(allocates=False)
def value(quadric, step):
    """Return the value of a quadric. Shapes: quadric (10,)."""
    x, y, z = step
    result = x * (quadric[0] * x + 2.0 * (quadric[1] * y + quadric[2] * z + quadric[6]))
    result += y * (quadric[3] * y + 2.0 * (quadric[4] * z + quadric[7]))
    result += z * (quadric[5] * z + 2.0 * quadric[8]) + quadric[9]
    return max(result, 0.0)


@kernel(allocates=False)
def add_moved(quadric, step, total):
    """Add a quadric to that of another vertex. Shapes: quadric (10,), total (10,)."""
    x, y, z = step
    at_other = value(quadric, step)
    for number in range(6):
        total[number] += quadric[number]
    total[6] += quadric[6] + quadric[0] * x + quadric[1] * y + quadric[2] * z
    total[7] += quadric[7] + quadric[1] * x + quadric[3] * y + quadric[4] * z
    total[8] += quadric[8] + quadric[2] * x + quadric[4] * y + quadric[5] * z
    total[9] += at_other
