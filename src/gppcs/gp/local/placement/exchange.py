"""The exchange of chosen points for points of their cells, all at once, in passes."""

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.gp.local.placement.attributes import best_with_attributes
from gppcs.gp.local.placement.cells import Attributes, Cells, Observed, Vertices, cells_of, hand_over
from gppcs.gp.local.placement.shape import DISTANCE_ROUNDING, best_by_shape, fill_errors
from gppcs.gp.local.settings import TRIED_ON
from gppcs.spatial.triangles import dot, minus, row
from gppcs.surface.error_quadrics import NUMBERS


def exchanged(
    observed: Observed,
    attributes: Attributes | None,
    chosen: Vertices,
    first: NDArray[np.int32],
    cells: Cells,
    widest: float,
    passes: int,
) -> tuple[Ints, Floats, Floats, Floats]:
    """Return for which point each vertex is exchanged, -1 where it stays, all positions then, a distance, and the feet.

    By the distance, that of its cell may grow: by how much the attributes' part of the mean of Eq. (20) fell in each
    pass. A vertex takes only points that it owns at `first`, (n,). Shapes: returns (m,), (m, 3), (m,) and (3, n).
    """
    new, owners = np.full(len(chosen.positions), -1), first
    gains = np.zeros(len(new))
    for later in range(passes):
        if later:
            owners = owners.copy()
            on_ranges(hand_over, len(owners), observed, chosen, owners, minimum=1024)
            cells = cells_of(owners, len(new))
        on_ranges(_exchange, len(new), observed, attributes, chosen, first, *cells, widest, new, gains, minimum=64)
        moved, positions = np.flatnonzero(new >= 0), chosen.positions.copy()
        positions[moved] = observed.points.take(new[moved], axis=1).T
        chosen = chosen._replace(positions=positions)
        if attributes is not None:
            of_vertices = attributes.of_vertices.copy()
            of_vertices[moved] = attributes.of_points[new[moved]]
            attributes = attributes._replace(of_vertices=of_vertices)
    return new, chosen.positions, DISTANCE_ROUNDING * chosen.gaps + gains, observed.feet


@kernel
def _exchange(begin, end, observed, attributes, chosen, first, members, starts, widest, new, gains):
    """Fill `new` and add to `gains`, (m,), for a range of vertices.

    Their cells are `members`, (n,), from `starts`, (m + 1,), on.
    """
    errors = np.empty(0, dtype=np.float64)
    quadric = np.empty(NUMBERS, dtype=np.float64)
    middle = np.empty(0 if attributes is None else attributes.of_points.shape[1], dtype=np.float64)
    local, squared = np.empty((3, TRIED_ON), dtype=np.float64), np.empty(TRIED_ON, dtype=np.float64)
    for v in range(begin, end):
        cell, vertex = members[starts[v] : starts[v + 1]], row(chosen.positions, v)
        if chosen.stays[v] or len(cell) < 2:
            continue
        if not _is_one_sheet(observed.feet, observed.normals, cell, vertex, row(chosen.normals, v)):
            continue
        if len(cell) > len(errors):
            errors = np.empty(2 * len(cell), dtype=np.float64)
        current = fill_errors(observed, attributes, chosen, v, cell, first, quadric, middle, errors)
        if attributes is None:
            best = best_by_shape(observed, chosen, v, cell, widest, current, errors, local, squared)
        else:
            best, gain = best_with_attributes(observed, attributes, chosen, v, cell, widest, current, errors)
            gains[v] += gain
        if best >= 0:
            new[v] = best


@kernel(allocates=False)
def _is_one_sheet(feet, normals, cell, vertex, fan_normal):
    """Return whether the planes of a cell are those of one sheet, by a vertex and the normal of its fan."""
    agreement, nearest, middle, through = 0.0, np.inf, cell[0], 0
    for q in cell:
        step = minus(row(feet.T, q), vertex)
        agreement += abs(dot(row(normals, q), fan_normal))
        if dot(step, step) < nearest:
            nearest, middle = dot(step, step), q
    if agreement < 0.4 * len(cell):
        return False
    for q in cell:
        step, normal = minus(row(feet.T, q), row(feet.T, middle)), row(normals, middle)
        if abs(dot(row(normals, q), normal)) > 0.9 and dot(step, normal) ** 2 > 0.5 * dot(step, step):
            through += 1
    return through <= 0.1 * len(cell)
