"""Placement: each chosen point is exchanged for the point near it that stands best for its cell.

Of the points of its cell, those with the least quadric error are tried (Eq. (10); Garland and Heckbert 1997). The one
to whose triangles the cell lies nearest replaces it; with attributes, that with the least F of Eq. (20). Where the
cell turns out to be farther from the surface of all new points than from that of the chosen ones, by more than its
attributes gained, the point goes back. The order of choice stays, so every prefix gains as well.
"""

import numpy as np

from gppcs.engine.arrays import Floats, Ints
from gppcs.gp.local.candidates import Measured, drawn
from gppcs.gp.local.placement.cells import Attributes, Observed, Vertices, cells_of
from gppcs.gp.local.placement.check import farther
from gppcs.gp.local.placement.exchange import exchanged
from gppcs.gp.local.settings import CELL_POINTS, GAP_GROWTH, NOISY_CELL_POINTS
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.nearest import nearest_of_each
from gppcs.surface.local_surface import LocalSurface


def place(points: Floats, chosen: Ints, fixed: int, measured: Measured, passes: int = 2) -> Ints:
    """Return the points for which the chosen ones are exchanged; the first `fixed` stay.

    Where a cell would have many points, a sample of the cloud is drawn. Shapes: points (N, 3), chosen (m,); returns
    (m,).
    """
    noise, tree, detail = measured.noise, measured.tree, measured.detail
    fraction = (CELL_POINTS if noise.is_negligible else NOISY_CELL_POINTS) * len(chosen) / len(points)
    if fraction < 1.0:
        indices = drawn(measured.ranks, fraction)
        tree = KdTree.build(points.take(indices, axis=0))
        indices, measured = indices[tree.order], measured._replace(tree=None, quadrics=None, normals=None)
    else:
        tree = KdTree.build(points) if tree is None else tree
        indices = tree.order
    of_chosen = KdTree.build(points.take(chosen, axis=0))
    order, surface = of_chosen.order, LocalSurface.over(of_chosen.in_own_order())
    vertices = Vertices.from_surface(surface, order < fixed)
    owners, squared = nearest_of_each(surface.tree, tree)
    cells = cells_of(owners, len(order))
    widest = GAP_GROWTH**2 * float(squared[~vertices.stays[owners]].max(initial=0.0))
    new, positions, allowed, feet = exchanged(
        Observed.around(tree, measured),
        None if detail is None else Attributes(*(detail.values.take(of, axis=0) for of in (indices, chosen[order]))),
        vertices, owners, cells, widest, passes,
    )  # fmt: skip
    if not noise.thick:
        placed = LocalSurface.over(KdTree.over(positions.T))
        new[farther(surface, placed, vertices.near, cells, new >= 0, feet, allowed)] = -1
    result = chosen.copy()
    result[order] = np.where(new < 0, chosen[order], indices[new])
    return result
