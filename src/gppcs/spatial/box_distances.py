"""Distances between boxes, and between points and boxes; corners are (3,)."""

from gppcs.engine.kernels import kernel


@kernel(fastmath=False, allocates=False)
def squared_distance_to_box(lower, upper, x, y, z):
    """Return the squared distance of (x, y, z) to a box, rounded to at most that to any point in it."""
    dx = max(lower[0] - x, x - upper[0], 0.0)
    dy = max(lower[1] - y, y - upper[1], 0.0)
    dz = max(lower[2] - z, z - upper[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel(fastmath=False, allocates=False)
def squared_distance_of_boxes(lower, upper, other_lower, other_upper):
    """Return the squared distance between two boxes, rounded to at most that between any two points in them."""
    dx = max(lower[0] - other_upper[0], other_lower[0] - upper[0], 0.0)
    dy = max(lower[1] - other_upper[1], other_lower[1] - upper[1], 0.0)
    dz = max(lower[2] - other_upper[2], other_lower[2] - upper[2], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel(fastmath=False, allocates=False)
def squared_span_of_boxes(lower, upper, other_lower, other_upper):
    """Return the largest squared distance between a point of one box and a point of another; corners are (3,)."""
    dx = max(upper[0] - other_lower[0], other_upper[0] - lower[0])
    dy = max(upper[1] - other_lower[1], other_upper[1] - lower[1])
    dz = max(upper[2] - other_lower[2], other_upper[2] - lower[2])
    return dx * dx + dy * dy + dz * dz
