"""The arguments of `gppcs.mesh`, checked."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from gppcs.clouds.quantities import Length, Tolerance, count_of, ratio_of, units_of
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.blas import one_blas_thread
from gppcs.errors import NoSurfaceError, ParameterError, shown, whole_number
from gppcs.spatial.cells import distinct_in_single
from gppcs.spatial.kdtree import KdTree

MIN_VERTICES = 4  # those of a tetrahedron


@dataclass(frozen=True)
class Size:
    """How large a mesh shall be: the arguments of `mesh` with these names, checked without the cloud."""

    n_points: int | None
    ratio: float | None
    n_faces: int | None
    tolerance: Tolerance | None  # of the mean or the largest distance
    fill_holes: Length | None

    @classmethod
    def from_arguments(
        cls,
        *,
        n_points: int | str | None,
        ratio: float | str | None,
        n_faces: int | str | None,
        tolerance: float | str | None,
        unit: str | None,
        keep: Any | None,
        fill_holes: float | str | None,
    ) -> Self:
        """Check the arguments; `keep` is only looked at for being there."""
        values = {"`n_points`": n_points, "`ratio`": ratio, "`n_faces`": n_faces, "`tolerance`": tolerance}
        values |= {"points to keep": keep}
        names = [name for name, value in values.items() if value is not None]
        if len(names) != 1:
            raise ParameterError(f"expected exactly one of {', '.join(values)}, found {' and '.join(names) or 'none'}")
        units_of(unit, None)
        allowed = None if tolerance is None else Tolerance.from_value(tolerance)
        if allowed and allowed.measure not in (None, "mean"):
            raise ParameterError(
                "expected `tolerance` to be a maximum distance, such as '1mm', or a mean with :mean behind it, found "
                f"{shown(tolerance)}"
            )
        return cls(
            None if n_points is None else count_of("n_points", n_points, MIN_VERTICES),
            None if ratio is None else ratio_of("ratio", ratio),
            None if n_faces is None else count_of("n_faces", n_faces, MIN_VERTICES),
            allowed,
            None if fill_holes is None else Length.from_value("fill_holes", fill_holes),
        )

    @property
    def bounds_largest(self) -> bool:
        """Whether the largest distance of the points is to be within a tolerance."""
        return self.tolerance is not None and self.tolerance.measure is None

    def n_vertices(self, n: int) -> int:
        """Return M, the number of vertices of a mesh of n points; 0 if another argument decides that."""
        if self.ratio is None:
            return self.n_points or 0
        if round(self.ratio * n) < MIN_VERTICES:
            raise ParameterError(
                f"expected a ratio that keeps at least {MIN_VERTICES} of the {n} points, found {self.ratio:g}"
            )
        return round(self.ratio * n)


def checked_effort(effort: Any, keep: Any | None) -> int:
    """Return the effort, 0, 1 or 2; it must be 0 if points are to become vertices."""
    value = whole_number("`effort`", effort, 0)
    if value > 2:
        raise ParameterError(f"expected `effort` to be 0, 1 or 2, found {value}")
    if value and keep is not None:
        raise ParameterError(
            f"expected an effort of 0 where points are to become vertices, found {value}: more effort moves vertices "
            "away; leave out the points to keep, or `effort`"
        )
    return value


def indices_to_keep(keep: ArrayLike | None, finite: Ints, points: Floats, n: int) -> Ints:
    """Return the indices to keep among the finite points, ascending; of repeats, that of the first."""
    if keep is None:
        return np.empty(0, dtype=np.int64)
    try:
        indices = np.asarray(keep)
    except ValueError:  # rows of different lengths
        indices = np.empty(0)
    if indices.ndim != 1 or not np.issubdtype(indices.dtype, np.integer) or len(indices) < MIN_VERTICES:
        raise ParameterError(f"expected keep to be at least {MIN_VERTICES} indices of rows, found {shown(keep)}")
    unusable = np.setdiff1d(indices, finite)
    if len(unusable):
        raise ParameterError(
            f"expected keep to be rows of the cloud from 0 to {n - 1} with finite coordinates, found {unusable[0]}"
        )
    distinct = distinct_in_single(points)
    nearest, _ = KdTree.build(points[distinct]).nearest_of(points[np.searchsorted(finite, indices)], 1)
    return np.unique(distinct[nearest[:, 0]])


@one_blas_thread()
def require_surface(points: Floats) -> None:
    """Raise an error if the points, (N, 3), are too few or lie on a line."""
    distinct = len(np.unique(points[: 10 * MIN_VERTICES], axis=0))
    if len(points) <= 10 * MIN_VERTICES and distinct < MIN_VERTICES:
        raise NoSurfaceError(f"expected at least {MIN_VERTICES} points on a surface, found {distinct}")
    extents = np.sqrt(np.abs(np.linalg.eigvalsh(np.cov(points.T))))
    if extents[1] <= 1e-6 * extents[2]:
        raise NoSurfaceError(f"expected points on a surface, found {len(points)} points on a line")
