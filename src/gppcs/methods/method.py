"""The base class of all simplification methods: a frozen dataclass of parameters with one call."""

from __future__ import annotations

import dataclasses
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar

from gppcs.engine.equality import ComparedByValue
from gppcs.engine.timer import Timer
from gppcs.errors import ParameterError
from gppcs.methods.parameters import WIDTH, check_parameter, completed, described

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud
    from gppcs.engine.arrays import Floats, Ints

RANKING = "The first k kept points are a simplification to k points, for any k."


class Feature(StrEnum):
    """What a method may be able to do beyond choosing a number of points."""

    RANKING = "ranking"  # the first k of the chosen points are a simplification to k points
    SPACING = "spacing"  # it chooses as many points as have a spacing
    KEEP = "keep"  # it keeps given points
    WEIGHT = "weight"  # it weighs points
    DETAIL = "detail"  # it looks at attributes beside the shape
    DENOISE = "denoise"  # it moves points onto the surface below their noise, by its parameter `denoise`
    SCORES = "scores"  # it reports the attributes `SCORES` of each chosen point


SCORES = ("score", "deviation")


@dataclass(frozen=True, eq=False)
class Task:
    """What a method is to do: of which points to choose, how many, and what else counts.

    Attributes
    ----------
    points : (N, 3) array, float64
        Finite and without repeats, about of unit size.
    n_points : int
        M, from 1 to N - 1; N if there is a `spacing` instead.
    spacing : float, optional
        A spacing in place of a number, for methods that support `Feature.SPACING`.
    fixed : int
        Number of leading points that are always kept, at most M, for methods that support `Feature.KEEP`.
    weights : (N,) array, float64, optional
        Multiplies the density of the chosen points, for methods that support `Feature.WEIGHT`. Above 0.
    detail : (N, k) array, float32, optional
        Attributes that count beside the shape, for methods that support `Feature.DETAIL`. A change by 1 counts as much
        as a sharp edge.
    values : (N,) array, float64, optional
        Of the attribute that `Method.reads_attribute` names, if any.
    settled : (N,) array, bool, optional
        Points that only show where the surface is: those of finished tiles, if the points are a part of a cloud. Fixed
        points that are not settled, the last of these, may be exchanged for points near them. The others have the order
        in which they were chosen.
    scale : object, optional
        `Selection.scale` of a choice in a sample of the whole cloud, if the points are a part of one.
    timer : Timer
        Measures the time of each stage, and reports progress.

    Examples
    --------
    >>> import gppcs
    >>> points = gppcs.sample("sphere", n_points=1000).points
    >>> gppcs.Random(seed=3)(gppcs.Task(points, 10)).indices.shape
    (10,)
    """

    points: Floats
    n_points: int
    spacing: float | None = None
    fixed: int = 0
    weights: Floats | None = None
    detail: NDArray[np.float32] | None = None
    values: Floats | None = None
    settled: NDArray[np.bool_] | None = None
    scale: Any = None
    timer: Timer = field(default_factory=Timer)


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
        Those of `SCORES`, if the method supports `Feature.SCORES`.
    ranked : bool
        Whether the first points are a choice of fewer, if the method ranks its points. They are not where all points
        but repeats are chosen, in the order of the cloud.
    normals : (M, 3) array, float64, optional
        Unit normals at the new positions, whose signs have no meaning, if the method finds them.
    scale : object, optional
        What the method measured of the whole cloud that a choice in a part of it needs. `scale.refined(other)` is that
        of a choice of fewer points together with that of a choice of more.
    """

    indices: Ints
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    points: Floats | None = None
    attributes: Mapping[str, Floats] = field(default_factory=dict)
    ranked: bool = True
    normals: Floats | None = None
    scale: Any = None

    def arranged(self, indices: Ints) -> Selection:
        """Return a selection of other indices, (K,): points that are not of this one have scores of 0."""
        import numpy as np

        is_chosen, order = np.isin(indices, self.indices), np.argsort(self.indices)
        positions = order[np.searchsorted(self.indices, indices[is_chosen], sorter=order)]
        attributes = {name: np.zeros(len(indices)) for name in self.attributes}
        for name, values in attributes.items():
            values[is_chosen] = self.attributes[name][positions]
        points, normals = (
            None if values is None or not is_chosen.all() else values[positions]
            for values in (self.points, self.normals)
        )
        return dataclasses.replace(self, indices=indices, points=points, attributes=attributes, normals=normals)


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
        What the method does and when to use it, in a paragraph: `gppcs methods NAME` and the docstring show it.
    source : str
        The publication.
    supports : mapping of Feature to str
        What else the method can do, and what that means for it.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import gppcs
    >>> @dataclass(frozen=True)
    ... class EveryNth(gppcs.Method):
    ...     name, summary, source = "every-nth", "points at equal steps", "an example"
    ...     description = "Points at equal steps in the order of the input."
    ...     def __call__(self, task):
    ...         return gppcs.Selection(np.arange(task.n_points) * len(task.points) // task.n_points)
    >>> gppcs.simplify(np.random.default_rng(0).random((100, 3)), n_points=4, method=EveryNth()).indices
    array([ 0, 25, 50, 75])
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    description: ClassVar[str] = ""
    source: ClassVar[str]
    supports: ClassVar[Mapping[Feature, str]] = {}
    by_cells: ClassVar[bool] = False  # whether it chooses, with a spacing, from each cell of a grid for itself
    points_per_kept: ClassVar[float] = 256.0  # of more points for each kept one, tiles of a large cloud look at so many
    _bytes_per_point: ClassVar[int] = 200

    def __init_subclass__(cls) -> None:
        """Complete the docstring, unless `python -OO` has removed it."""
        super().__init_subclass__()
        if cls.__doc__:
            inherited = {field.name: field for field in dataclasses.fields(cls)}
            declared = {name: value for name, value in vars(cls).items() if isinstance(value, dataclasses.Field)}
            source = f"Source: {cls.source}." if hasattr(cls, "source") else ""
            texts = [textwrap.fill(text, WIDTH) for text in (cls.description, source) if text]
            cls.__doc__ = completed(cls.__doc__, texts, described(cls, inherited | declared))

    def __post_init__(self) -> None:
        """Check all parameters. Subclasses that check more call this first."""
        for parameter in dataclasses.fields(self):
            if getattr(self, parameter.name) is not parameter.default:
                check_parameter(self, parameter)

    @property
    def moves_points(self) -> bool:
        """Whether the kept points get new positions."""
        return False

    @property
    def halo(self) -> tuple[float, float, float]:
        """How far, in spacings along each axis, points may lie that matter for a choice with a spacing."""
        return (1.0, 1.0, 1.0)

    def number_at(self, area: float, spacing: float) -> int | None:
        """Return how many points of a surface have a spacing, if its area tells; None if the choice does."""
        return None

    @property
    def reads_attribute(self) -> str | None:
        """The attribute of the cloud whose values `Task.values` has to hold, if any."""
        return None

    @abstractmethod
    def __call__(self, task: Task) -> Selection:
        """Choose M points of a cloud."""

    def __str__(self) -> str:
        changed = [
            f"{parameter.name}={getattr(self, parameter.name)}"
            for parameter in dataclasses.fields(self)
            if getattr(self, parameter.name) != parameter.default
        ]
        return f"{self.name} ({', '.join(changed)})" if changed else self.name

    def memory(self, n: int, n_points: int) -> int:
        """Return about how many bytes a call takes to choose M of n points, beyond the points themselves."""
        return self._bytes_per_point * n


def selected(method: Method, task: Task) -> Selection:
    """Let a method choose, and check that it chose as many different points as it must, also if others wrote it."""
    import numpy as np

    selection, n = method(task), len(task.points)
    indices = np.atleast_1d(getattr(selection, "indices", ()))
    are_indices = indices.ndim == 1 and indices.dtype.kind in "iu" and bool(((indices >= 0) & (indices < n)).all())
    is_chosen = np.zeros(n, dtype=np.bool_)
    is_chosen[indices if are_indices else []] = True
    n_different = np.count_nonzero(is_chosen)
    if n_different < len(indices) or (len(indices) != task.n_points if task.spacing is None else not len(indices)):
        expected = f"{task.n_points:,}" if task.spacing is None else "1 or more"
        raise ParameterError(
            f"expected a Selection of {expected} different indices from 0 to {n - 1:,} from method {method.name!r}, "
            f"found {len(indices):,}, {n_different:,} of which are different ones; report this to its authors"
        )
    return selection


def with_scores(cloud: PointCloud, scores: Mapping[str, Floats]) -> PointCloud:
    """Return kept points with their scores, (M,), as attributes; points that the method did not choose have 0."""
    import numpy as np

    columns = {name: np.zeros(len(cloud), np.float32) for name in SCORES}
    columns |= {name: values.astype(np.float32) for name, values in scores.items()}
    return dataclasses.replace(cloud, attributes={**cloud.attributes, **columns})


def random_candidates(n: int, candidates: int | None, n_points: int, seed: int) -> Ints:
    """Choose a random subset of n points. Shapes: returns (size,)."""
    import numpy as np

    if candidates is None:
        return np.arange(n)
    return np.sort(np.random.default_rng(seed).permutation(n)[: max(candidates, n_points)])
