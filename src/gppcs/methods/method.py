"""The base class of all simplification methods: a frozen dataclass of parameters with one call."""

from __future__ import annotations

import dataclasses
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import Timer
from gppcs.methods.parameters import WIDTH, Parameter, check_parameter, completed, described

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.spatial.boxes import Each
    from gppcs.spatial.stored import StoredPoints

RANKING = "The first k kept points are a simplification to k points, for any k."


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is wanted of a method: of which points, how many, and what else is known.

    Attributes
    ----------
    points : (N, 3) array, float64
        Finite and without repeats, about of unit size. If the points are `stored`, only those to keep, (fixed, 3).
    n_points : int
        M, from 1 to N - 1; N if a `spacing` is wanted instead.
    spacing : float, optional
        A spacing in place of a number, for methods whose `supports` has "spacing".
    fixed : int
        The first so many points, at most M, are chosen first, for methods whose `supports` has "keep".
    weights : (N,) array, float64, optional
        Multiplies the density of the chosen points, for methods whose `supports` has "weight". Above 0.
    detail : (N, k) array, float32, optional
        Attributes that count beside the shape, for methods whose `supports` has "detail". A change by 1 counts as much
        as a sharp edge.
    values : (N,) array, float64, optional
        Of the attribute that the method's parameter `attribute` names, if it has one.
    timer : Timer
        Measures the time of each stage, and reports progress.
    stored : StoredPoints, optional
        Points on disk, where they do not fit into memory, for methods whose `supports` has "files". They may repeat
        each other; the method chooses all different places if there are no more than M.
    rows : (fixed,) array, int64, optional
        Rows of the points to keep, if the points are stored.
    each : callable
        Applies a function to each part of stored points, like `map`: in threads, processes or on a cluster.

    Examples
    --------
    >>> import gppcs
    >>> points = gppcs.sample("sphere", n_points=1000).points
    >>> gppcs.Random(seed=3)(gppcs.Wanted(points, 10)).indices.shape
    (10,)
    """

    points: NDArray[np.float64]
    n_points: int
    spacing: float | None = None
    fixed: int = 0
    weights: NDArray[np.float64] | None = None
    detail: NDArray[np.float32] | None = None
    values: NDArray[np.float64] | None = None
    timer: Timer = field(default_factory=Timer)
    stored: StoredPoints | None = None
    rows: NDArray[np.int64] | None = None
    each: Each = map


@dataclass(frozen=True, eq=False)
class Selection(ComparedByValue):
    """The points that a method chose.

    Attributes
    ----------
    indices : (M,) array, int64
        The rows of the chosen points: unique, in the order chosen.
    diagnostics : mapping of str to float
        Figures that the method reports about its run, such as fitted hyperparameters.
    points : (M, 3) array, float64, optional
        The new positions of the chosen points, if the method moves them.
    attributes : mapping of str to (M,) array
        Values that the method reports about each chosen point, such as scores.
    ranked : bool
        Whether the first points are a choice of fewer, if the method ranks its points. They are not where all points
        but repeats are chosen, in the order of the cloud.
    normals : (M, 3) array, float64, optional
        Unit normals at the new positions, whose signs have no meaning, if the method finds them.

    Examples
    --------
    >>> import gppcs
    >>> points = gppcs.sample("sphere", n_points=1000).points
    >>> selection = gppcs.FarthestPoint()(gppcs.Wanted(points, 10))
    >>> isinstance(selection, gppcs.Selection), len(selection.indices)
    (True, 10)
    """

    indices: NDArray[np.int64]
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    points: NDArray[np.float64] | None = None
    attributes: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    ranked: bool = True
    normals: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Method(ABC):
    """Base class of all methods. A subclass is a frozen dataclass whose fields are its parameters.

    Import heavy packages and kernels inside `__call__`, so that listing the methods stays fast. The docstring of a
    subclass is completed with its description and its parameters. `str` of a method is its name and, in brackets, all
    parameters that differ from their defaults.

    Attributes
    ----------
    name : str
        The name in `gppcs.METHODS` and on the command line.
    summary : str
        One line for lists of methods.
    description : str
        What the method does, in a paragraph.
    source : str
        The publication.
    attributes : tuple of str
        Names of the `Selection.attributes` that the method reports, if any.
    supports : mapping of str to str
        What else the method can do, and what that means for it. "ranking": the first k of the chosen points are a
        simplification to k points. "spacing": it chooses as many points as have a spacing. "keep", "weight",
        "detail": it keeps given points, weighs points, and looks at attributes. "files": it takes points on disk.
        "denoise": it moves points onto the surface below their noise, by its parameter `denoise`.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import gppcs
    >>> @dataclass(frozen=True)
    ... class EveryNth(gppcs.Method):
    ...     name, summary, source = "every-nth", "points at equal steps", "an example"
    ...     description = "Points at equal steps in the order of the input."
    ...     def __call__(self, wanted):
    ...         return gppcs.Selection(np.arange(wanted.n_points) * len(wanted.points) // wanted.n_points)
    >>> gppcs.simplify(np.random.default_rng(0).random((100, 3)), n_points=4, method=EveryNth()).indices
    array([ 0, 25, 50, 75])
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    description: ClassVar[str] = ""
    source: ClassVar[str]
    attributes: ClassVar[tuple[str, ...]] = ()
    supports: ClassVar[Mapping[str, str]] = {}
    _bytes_per_point: ClassVar[int] = 200

    def __init_subclass__(cls) -> None:
        """Complete the docstring, unless `python -OO` has removed it."""
        super().__init_subclass__()
        if cls.__doc__:
            inherited = {each.name: each for each in dataclasses.fields(cls)}
            own = {name: value for name, value in vars(cls).items() if isinstance(value, dataclasses.Field)}
            source = f"Source: {cls.source}." if hasattr(cls, "source") else ""
            texts = [textwrap.fill(text, WIDTH) for text in (cls.description, source) if text]
            cls.__doc__ = completed(cls.__doc__, texts, described(cls, inherited | own))

    def __post_init__(self) -> None:
        """Check all parameters. Subclasses that check more call this first."""
        for each in dataclasses.fields(self):
            if getattr(self, each.name) is not each.default:
                check_parameter(self, each)

    @abstractmethod
    def __call__(self, wanted: Wanted) -> Selection:
        """Choose points of a cloud.

        Parameters
        ----------
        wanted : Wanted

        Returns
        -------
        Selection
            M points.
        """

    def __str__(self) -> str:
        changed = [
            f"{each.name}={getattr(self, each.name)}"
            for each in dataclasses.fields(self)
            if getattr(self, each.name) != each.default
        ]
        return f"{self.name} ({', '.join(changed)})" if changed else self.name

    def memory(self, n: int, n_points: int) -> int:
        """Return about how much memory a call takes, beyond the points themselves.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        return self._bytes(n, n_points)

    def _bytes(self, n: int, n_points: int) -> int:
        return self._bytes_per_point * n

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the descriptions of all parameters.

        Returns
        -------
        dict of str to Parameter
            By name, in the order of the fields. The texts are those given to `parameter`.
        """
        return described(cls, {each.name: each for each in dataclasses.fields(cls)})


def random_candidates(n: int, candidates: int | None, n_points: int, seed: int) -> NDArray[np.int64]:
    """Choose a random subset of n points. Shapes: returns (size,)."""
    import numpy as np

    if candidates is None:
        return np.arange(n)
    return np.sort(np.random.default_rng(seed).permutation(n)[: max(candidates, n_points)])


def largest(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the indices of the largest values. Shapes: values (N,); returns (count,)."""
    import numpy as np

    if count == 0:
        return np.empty(0, dtype=np.int64)
    least = np.partition(values, len(values) - count)[len(values) - count]
    candidates = np.flatnonzero(values >= least)
    return candidates[np.argsort(-values[candidates], kind="stable")[:count]]
