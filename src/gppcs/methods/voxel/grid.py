"""Find a cubic grid with the right number of occupied cells, and one point for each cell."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.engine.arrays import Floats, Ints
from gppcs.errors import InputError
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.samples import point_hashes

COLUMNS = ("highest", "lowest")  # what is kept of cells without limits in z


def in_cells(points: Floats, keep: str) -> Floats:
    """Return points as the grid sees them: those of a column have the same z. Shapes: points (N, 3); returns (N, 3)."""
    return points * (1.0, 1.0, 0.0) if keep in COLUMNS else points


def check_columns(n_columns: int, n_points: int) -> None:
    """Check that there are enough columns, each with its own x and y."""
    if n_columns < n_points:
        raise InputError(
            f"expected points at {n_points:,} or more different places in x and y, found {n_columns:,}; ask for fewer"
        )


def worth(points: Floats, keep: str, values: Floats | None) -> NDArray[Any] | None:
    """Return of each point, (N, 3), what is largest for that to keep; None for the distance to the mean."""
    if keep in COLUMNS:
        values = points[:, 2]
    if values is None:
        return point_hashes(points) if keep == "random" else None
    return np.nan_to_num(values if keep in ("highest", "most") else -values, nan=-np.inf, posinf=np.inf, neginf=-np.inf)


def cell_edge(size: float, n_points: int, occupied: Callable[[float], int]) -> float:
    """Return an edge length for which at least M cells are occupied, and few more, by halving and bisection."""
    edge = size
    too_long = 2.0 * edge
    finest = 2.0**-40 * edge  # finer cells approach the rounding of coordinates
    while (fewest := occupied(edge)) < n_points:
        if not fewest:  # halves of cells hold no more points
            raise InputError(f"expected {n_points:,} cells with enough points, found fewer; lower min_points")
        too_long, edge = edge, edge / 2.0
        if edge < finest:  # division by a power of two does not round, so distinct points end in distinct cells
            edge = math.ldexp(0.5, math.frexp(edge)[1])
    best = edge
    for _ in range(30):  # to a billionth: there, the counts of real clouds no longer change
        if fewest - n_points <= 2.0**-12 * n_points:
            break
        middle = (edge + too_long) / 2.0
        count = occupied(middle)
        if count < n_points:
            too_long = middle
        else:
            edge = middle
            if count < fewest:
                best, fewest = middle, count
    return best


def occupied(points: Floats, edge: float, min_points: int = 1) -> int:
    """Return the number of cells of a grid from the origin on that hold so many points. Shapes: points (N, 3)."""
    cells = np.floor(points / edge)
    if min_points == 1:
        return int(np.count_nonzero(first_occurrences(cells)))
    return int(np.count_nonzero(np.unique(point_hashes(cells), return_counts=True)[1] >= min_points))


def representatives(
    points: Floats, edge: float, worth: NDArray[Any] | None = None, min_points: int = 1
) -> tuple[Ints, Floats]:
    """Return of each cell with enough points that of greatest worth, by default nearest the mean, and their mean.

    Shapes: points (N, 3); returns (cells,), (cells, 3).
    """
    hashes = point_hashes(np.floor(points / edge))
    order = np.argsort(hashes)
    begins = np.flatnonzero(np.diff(hashes[order], prepend=~hashes[order[0]]))
    sizes = np.diff(np.append(begins, len(points)))
    owners, members = np.repeat(np.arange(len(begins)), sizes), points[order].T
    means = np.stack([_sums(values, begins) for values in members]) / sizes
    if worth is None:
        squared = sum((values - mean[owners]) ** 2 for values, mean in zip(members, means, strict=True))
        # Two points are equally near their mean; the factor makes up for rounding.
        best = squared <= ((1 + 1e-9) * np.minimum.reduceat(squared, begins))[owners]
    else:
        best = worth[order] == np.maximum.reduceat(worth[order], begins)[owners]
    owners = owners[best]
    ranked = np.lexsort([*members[:, best], owners])  # ties go by coordinates
    indices = order[best][ranked[np.searchsorted(owners, np.arange(len(begins)))]]
    ascending = np.argsort(indices)
    ascending = ascending[sizes[ascending] >= min_points]
    return indices[ascending], means.T[ascending]


def _sums(values: Floats, begins: Ints) -> Floats:
    """Return the sums of values, (N,), from each beginning on, (cells,): of whole numbers, so in any order the same."""
    unit = 2.0 ** (math.frexp(float(np.abs(values).max(initial=0.0)))[1] + len(values).bit_length() - 62)
    return np.add.reduceat(np.rint(values / unit).astype(np.int64), begins) * unit
