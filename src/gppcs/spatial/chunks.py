"""Points that come in chunks: an array in memory, or files larger than memory, by the same code.

A pass reads all chunks. What it looks for is found in each chunk, and then again among the finds of several chunks. So
it does not depend on where one chunk ends and the next begins, and an array is nothing but a single chunk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gppcs.spatial.cells import first_occurrences, greatest_in_cells

Advanced = Callable[[int], None]  # Called with the number of points that a pass has read since the last call.

FINDS_AT_ONCE = 1 << 18  # Finds of chunks wait until there are so many, as looking through few at a time costs more.


def _ignore(steps: int) -> None:
    pass


class SparseValues(NamedTuple):
    """A value for each point, 0 for most.

    Attributes
    ----------
    rows : (n,) array, int64
        The points with another value, ascending.
    values : (n,) array, float32

    Examples
    --------
    >>> values = gppcs.SparseValues(np.array([2, 5]), np.array([1, 7], dtype=np.float32))
    >>> values.dense(1, 4)
    array([0., 1., 0.], dtype=float32)
    """

    rows: NDArray[np.int64]
    values: NDArray[np.float32]

    def dense(self, begin: int, end: int) -> NDArray[np.float32]:
        """Return the values of the points from `begin` to `end`.

        Parameters
        ----------
        begin, end : int

        Returns
        -------
        (end - begin,) array, float32
        """
        first, last = np.searchsorted(self.rows, [begin, end])
        found = np.zeros(end - begin, dtype=np.float32)
        found[self.rows[first:last] - begin] = self.values[first:last]
        return found

    def take(self, rows: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the values of some points.

        Parameters
        ----------
        rows : (m,) array, int64

        Returns
        -------
        (m,) array, float32
        """
        found = np.zeros(len(rows), dtype=np.float32)
        known = np.isin(rows, self.rows)
        found[known] = self.values[np.searchsorted(self.rows, rows[known])]
        return found

    def every(self, step: int) -> SparseValues:
        """Return the values of every `step`-th point.

        Parameters
        ----------
        step : int
            At least 1.

        Returns
        -------
        SparseValues
        """
        taken = self.rows % step == 0
        return SparseValues(self.rows[taken] // step, self.values[taken])


ALIKE = SparseValues(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.float32))  # All points have the value 0.


class Places(NamedTuple):
    """Some of the points.

    Attributes
    ----------
    rows : (n,) array, int64
        Ascending.
    points : (n, 3) array, float64
    values : (n,) array, float32

    Examples
    --------
    >>> places = gppcs.Places(np.array([4, 9]), np.eye(3)[:2], np.zeros(2, dtype=np.float32))
    >>> places.take(np.array([1])).rows
    array([9])
    """

    rows: NDArray[np.int64]
    points: NDArray[np.float64]
    values: NDArray[np.float32]

    def take(self, indices: NDArray[np.int64]) -> Places:
        """Return some of them.

        Parameters
        ----------
        indices : (m,) array, int64
            Ascending.

        Returns
        -------
        Places
        """
        return Places(self.rows[indices], self.points[indices], self.values[indices])


@dataclass(frozen=True, eq=False)
class ChunkedValues:
    """Values of N points that come in chunks, as often as they are asked for.

    Attributes
    ----------
    count : int
        N, at least 1.
    chunks : callable() -> iterable of arrays, float64
        Begins a pass over the points, which are the same in each pass. Each array has a value, or a row of values, for
        each point of a chunk. No chunk is empty.

    Examples
    --------
    >>> weights = gppcs.ChunkedValues(3, lambda: [np.array([0.5, 1.0]), np.array([0.25])])
    >>> weights.take(np.array([0, 2]))
    array([0.5 , 0.25])
    """

    count: int
    chunks: Callable[[], Iterable[NDArray[np.float64]]]

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> Self:
        """Return the values of an array as a single chunk.

        Parameters
        ----------
        values : (N, ...) array, float64

        Returns
        -------
        ChunkedValues
            Of this class.
        """
        return cls(len(values), lambda: [values])

    def __len__(self) -> int:
        return self.count

    def each(self, work: Callable[[int, NDArray[np.float64]], Any], advanced: Advanced = _ignore) -> Iterator[Any]:
        """Do some work on each chunk, in one pass.

        Parameters
        ----------
        work : callable
            Given the row of the first point of a chunk, and the chunk. For points in files it may run in another
            process, which sends its result back.
        advanced : callable, optional

        Yields
        ------
        object
            What it returns, in the order of the chunks.
        """
        for first, chunk in self._pass(advanced):
            yield work(first, chunk)

    def take(self, rows: NDArray[np.int64], advanced: Advanced = _ignore) -> NDArray[np.float64]:
        """Return the values of some of the points, in one pass.

        Parameters
        ----------
        rows : (n,) array, int64
            Ascending.
        advanced : callable, optional

        Returns
        -------
        (n, ...) array, float64
        """
        found = None
        for first, chunk in self._pass(advanced):
            if found is None:
                found = np.empty((len(rows), *chunk.shape[1:]))
            begin, end = np.searchsorted(rows, [first, first + len(chunk)])
            found[begin:end] = chunk[rows[begin:end] - first]
        assert found is not None
        return found

    def at(self, rows: NDArray[np.int64], advanced: Advanced = _ignore) -> NDArray[np.float64]:
        """Return the values of some of the points in any order, in one pass.

        Parameters
        ----------
        rows : (n,) array, int64
        advanced : callable, optional

        Returns
        -------
        (n, ...) array, float64
        """
        order = np.argsort(rows)
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return self.take(rows[order], advanced)[back]

    def every(self, step: int, advanced: Advanced = _ignore) -> NDArray[np.float64]:
        """Return the values of every `step`-th point, from the first on, in one pass.

        Parameters
        ----------
        step : int
            At least 1.
        advanced : callable, optional

        Returns
        -------
        (ceil(N / step), ...) array, float64
        """
        parts = [np.ascontiguousarray(chunk[-first % step :: step]) for first, chunk in self._pass(advanced)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _pass(self, advanced: Advanced) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Yield the row of the first point of each chunk, and the chunk."""
        first = 0
        for chunk in self.chunks():
            yield first, chunk
            first += len(chunk)
            advanced(len(chunk))


@dataclass(frozen=True, eq=False)
class ChunkedPoints(ChunkedValues):
    """N points that come in chunks, as often as they are asked for.

    Attributes
    ----------
    count : int
        N, at least 1.
    chunks : callable() -> iterable of (n, 3) arrays, float64
        Begins a pass over the points, which are the same in each pass. No chunk is empty.

    Examples
    --------
    >>> points = gppcs.sample("sphere", n_points=1000).points
    >>> chunked = gppcs.ChunkedPoints(1000, lambda: [points[:600], points[600:]])
    >>> (chunked.take(np.array([5, 700])) == points[[5, 700]]).all()
    np.True_
    """

    def greatest_in_cells(self, edge: float, values: SparseValues, advanced: Advanced = _ignore) -> Places:
        """Choose the point of greatest value in each occupied cell of a cubic grid, in one pass.

        Parameters
        ----------
        edge : float
            Edge length of the cells, in the unit of the points. The grid starts at the origin.
        values : SparseValues
            Of equal values in a cell, the first counts.
        advanced : callable, optional

        Returns
        -------
        Places
        """

        def greatest(found: Places) -> Places:
            return found.take(greatest_in_cells(found.points, edge, found.values))

        def of_chunks() -> Iterator[Places]:
            for first, chunk in self._pass(advanced):
                dense = values.dense(first, first + len(chunk))
                kept = greatest_in_cells(chunk, edge, dense)
                yield Places(first + kept, chunk[kept], dense[kept])

        return _merged(of_chunks(), greatest)

    def distinct(self, advanced: Advanced = _ignore) -> Places:
        """Return the points that repeat no earlier one, in one pass.

        Parameters
        ----------
        advanced : callable, optional

        Returns
        -------
        Places
            All their values are 0.
        """

        def firsts(found: Places) -> Places:
            first = first_occurrences(found.points)
            return found if first.all() else found.take(np.flatnonzero(first))

        def of_chunks() -> Iterator[Places]:
            for first, chunk in self._pass(advanced):
                rows = np.arange(first, first + len(chunk))
                yield firsts(Places(rows, chunk, np.zeros(len(chunk), dtype=np.float32)))

        return _merged(of_chunks(), firsts)


def first_repeats(distinct: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the repeats that have to be kept if there are too few different places.

    Parameters
    ----------
    distinct : (n,) array, int64
        Rows of the points that repeat no earlier one, n < count.
    count : int
        M, the number of points to keep.

    Returns
    -------
    (count - n,) array, int64
        The first of the other rows.
    """
    return np.setdiff1d(np.arange(count), distinct, assume_unique=True)[: count - len(distinct)]


def _merged(parts: Iterable[Places], reduced: Callable[[Places], Places]) -> Places:
    """Return what `reduced` leaves of the finds of all chunks.

    It is applied whenever there are three times as many finds as it left before. So it looks at each find once or
    twice, and little more than three times as many finds as it leaves are held.
    """
    waiting: list[Places] = []
    held, most = 0, FINDS_AT_ONCE
    for part in parts:
        waiting.append(part)
        held += len(part.rows)
        if held > most and len(waiting) > 1:
            waiting = [reduced(joined_places(waiting))]
            held = len(waiting[0].rows)
            most = max(3 * held, FINDS_AT_ONCE)
    return waiting[0] if len(waiting) == 1 else reduced(joined_places(waiting))


def joined_places(parts: list[Places]) -> Places:
    """Return the places of several parts, in their order.

    Parameters
    ----------
    parts : list of Places

    Returns
    -------
    Places
    """
    return Places(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
