"""The base class of all simplification methods: a frozen dataclass of parameters that can be called on points."""

from __future__ import annotations

import dataclasses
import inspect
import math
import numbers
import sys
import textwrap
import typing
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

from gppcs.engine.equality import ComparedByValue
from gppcs.engine.stages import Stages
from gppcs.errors import ParameterError, nearest_name, number, shown

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gppcs.spatial.boxes import Each
    from gppcs.spatial.chunks import ChunkedPoints, ChunkedValues, Places


Value = TypeVar("Value")

WIDTH = 100  # characters per line of the docstrings that are completed here
_MEANING = "meaning"  # the key of a field's metadata that holds the help of the parameter
_RANGE = "range"  # the key that holds its least and its greatest value
_INVALID = object()  # stands for a value that a parameter cannot have


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

    Examples
    --------
    >>> import gppcs
    >>> points = gppcs.sample("sphere", n_points=1000).points
    >>> selection = gppcs.FarthestPoint()(points, 10)
    >>> isinstance(selection, gppcs.Selection), len(selection.indices)
    (True, 10)
    """

    indices: NDArray[np.int64]
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    points: NDArray[np.float64] | None = None
    attributes: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    ranked: bool = True


@dataclass(frozen=True)
class Parameter:
    """The description of a method's parameter.

    Attributes
    ----------
    kind : str
        Its type, or the values that it may have.
    default : int, float, bool, str or None
    meaning : str
        What it does, in one or more sentences.

    Examples
    --------
    >>> import gppcs
    >>> gppcs.Random.parameters() == {"seed": gppcs.Parameter("int", 0, "Seed of the permutation.")}
    True
    """

    kind: str
    default: Any
    meaning: str


def parameter(default: Value, meaning: str, least: float | None = None, most: float | None = None) -> Value:
    """Declare a parameter of a method, as a field of its dataclass.

    Parameters
    ----------
    default : int, float, bool, str or None
    meaning : str
        What the parameter does, in one or more sentences. The help of the command and the docstring show it.
    least, most : float, optional
        The range of a number; both ends belong to it. A float must also be finite, unless `most` is infinite.

    Returns
    -------
    dataclasses.Field
        Typed as `default`, as type checkers expect of the default of a field.

    Raises
    ------
    ParameterError
        If an argument has a wrong type.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import gppcs
    >>> @dataclass(frozen=True)
    ... class FirstRows(gppcs.Method):
    ...     name, summary, source = "first-rows", "the first rows", "an example"
    ...     step: int = gppcs.parameter(1, "Distance between the rows that are taken.")
    ...     def __call__(self, points, n_points, stages=None):
    ...         return gppcs.Selection(np.arange(n_points) * self.step)
    >>> FirstRows.parameters()["step"].meaning
    'Distance between the rows that are taken.'
    """
    if not isinstance(default, numbers.Real | str | None):
        raise ParameterError(f"expected a number, a text, a truth value or None as default, found {shown(default)}")
    if not isinstance(meaning, str):
        raise ParameterError(f"expected the meaning of the parameter as text, found {shown(meaning)}")
    for end in (least, most):
        if end is not None and math.isnan(number(end)):
            raise ParameterError(f"expected a number as end of the range of the parameter, found {shown(end)}")
    declared: Any = field(default=default, metadata={_MEANING: meaning, _RANGE: (least, most)})
    return declared


@dataclass(frozen=True)
class Method(ABC):
    """Base class of all methods. A subclass is a frozen dataclass whose fields are its parameters.

    Import heavy packages and kernels inside `__call__`, so that listing the methods stays fast. The docstring of a
    subclass is completed with its description and its parameters.

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
    ranks : bool
        Whether the first k of the chosen points are a simplification to k points, for any k.
    spacing : str
        What `at_spacing` means by a spacing, in a sentence; empty if the method has no `at_spacing`.
    bytes_per_point : int
        About how much memory the method takes for each point, beyond the points themselves.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import gppcs
    >>> @dataclass(frozen=True)
    ... class EveryNth(gppcs.Method):
    ...     name, summary, source = "every-nth", "points at equal steps", "an example"
    ...     description = "Points at equal steps in the order of the input."
    ...     def __call__(self, points, n_points, stages=None):
    ...         return gppcs.Selection(np.arange(n_points) * len(points) // n_points)
    >>> gppcs.simplify(np.random.default_rng(0).random((100, 3)), n_points=4, method=EveryNth()).indices
    array([ 0, 25, 50, 75])
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    description: ClassVar[str] = ""
    source: ClassVar[str]
    attributes: ClassVar[tuple[str, ...]] = ()
    ranks: ClassVar[bool] = False
    spacing: ClassVar[str] = ""
    bytes_per_point: ClassVar[int] = 200

    def __init_subclass__(cls) -> None:
        """Complete the docstring, unless `python -OO` has removed it."""
        super().__init_subclass__()
        if cls.__doc__:
            inherited = {each.name: each for each in dataclasses.fields(cls)}
            own = {name: value for name, value in vars(cls).items() if isinstance(value, dataclasses.Field)}
            source = f"Source: {cls.source}." if hasattr(cls, "source") else ""
            texts = [textwrap.fill(text, WIDTH) for text in (cls.description, source) if text]
            cls.__doc__ = _completed(cls.__doc__, texts, _described(cls, inherited | own))

    @abstractmethod
    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose points of a cloud.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        n_points : int
            M, from 1 to N - 1.
        stages : Stages, optional
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        Selection
            M points.
        """

    def guided(
        self,
        points: NDArray[np.float64],
        n_points: int,
        fixed: int,
        weights: NDArray[np.float64] | None,
        stages: Stages,
    ) -> Selection:
        """Choose points of a cloud of which users know more than their places.

        A method that can do so overrides this.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        n_points : int
            M, from 1 to N - 1.
        fixed : int
            The first so many points, at most M, are chosen first, in their order.
        weights : (N,) array, float64, optional
            Multiplies the density of the chosen points. Above 0, but for points that are chosen anyway.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        Selection
            M points.
        """
        raise NotImplementedError

    def require_guided(self) -> None:
        """Check that the method can keep given points and weigh points.

        Raises
        ------
        ParameterError
            If it does not override `guided`.
        """
        if type(self).guided is Method.guided:
            raise ParameterError(f"method {self.name!r} can neither keep given points nor weigh them; use 'gp'")

    def at_spacing(self, points: NDArray[np.float64], spacing: float, stages: Stages) -> Selection:
        """Choose as many points as have a spacing. What that means, each method says in its attribute `spacing`.

        A method that can do so overrides this.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        spacing : float
            In the unit of the points.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        Selection
            At least one point.
        """
        raise NotImplementedError

    def require_spacing(self) -> None:
        """Check that a spacing can be asked for.

        Raises
        ------
        ParameterError
            If the method does not override `at_spacing`.
        """
        if type(self).at_spacing is Method.at_spacing:
            raise ParameterError(
                f"method {self.name!r} has no spacing to ask for; use 'gp', 'fps', 'sample-elimination' or 'voxel'"
            )

    def count_at_spacing(self, points: ChunkedPoints, spacing: float, stages: Stages) -> int | None:
        """Return how many points have a spacing, if passes over the points tell it.

        A method that can do so overrides this. It then chooses so many points in place of a call of `at_spacing`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        spacing : float
            In the unit of the points.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        int or None
            From 1 to N. None if only `at_spacing` tells.
        """
        return None

    def surface_area(self, points: ChunkedPoints, stages: Stages) -> float | None:
        """Return the area of the surface, if passes over the points tell it.

        A method that can do so overrides this.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        float or None
            In squared units of the points.
        """
        return None

    @property
    def measures_area(self) -> bool:
        """Whether the method overrides `surface_area`."""
        return type(self).surface_area is not Method.surface_area

    @property
    def counts_at_spacing(self) -> bool:
        """Whether the method overrides `count_at_spacing`."""
        return type(self).count_at_spacing is not Method.count_at_spacing

    def guided_in_passes(
        self, points: ChunkedPoints, n_points: int, fixed: Places, weights: ChunkedValues | None, stages: Stages
    ) -> Selection | None:
        """Choose as `guided` some points of a cloud that need not fit into memory.

        A method that can do so overrides this. It then chooses the same points, whatever the chunks.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        fixed : Places
            At most M of the points, without repeats, which are chosen first, in their order.
        weights : ChunkedValues, optional
            One for each point, as shares of the largest one. Above 0, but for points that are chosen anyway.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        Selection or None
            M points, no two at the same place; None if `guided` must be called on all points that are no repeats.
        """
        return None

    @property
    def guides_in_passes(self) -> bool:
        """Whether the method overrides `guided_in_passes`."""
        return type(self).guided_in_passes is not Method.guided_in_passes

    def in_passes(self, points: ChunkedPoints, n_points: int, stages: Stages) -> Selection | None:
        """Choose points of a cloud that need not fit into memory.

        A method that can do so overrides this. It then chooses the same points, whatever the chunks.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.

        Returns
        -------
        Selection or None
            M points, no two at the same place; None if the method must be called on all points that are no repeats.
        """
        return None

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
        return self.bytes_per_point * n

    def memory_of_weights(self, n: int, n_points: int) -> int:
        """Return about how much more memory than without weights `guided` and `guided_in_passes` take at most.

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
        return 0

    def seconds(self, n: int, n_points: int) -> float | None:
        """Return about how long a call takes on two cores.

        Parameters
        ----------
        n : int
            N, the number of points, counted once for each pass over them.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        float or None
            None if it is not known.
        """
        return None

    def memory_in_passes(self, n: int, n_points: int) -> int | None:
        """Return about how much memory `in_passes` takes, beyond one chunk of points.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int or None
            Bytes; None if the method must be called on all points.
        """
        return None

    def in_tiles(
        self, points: ChunkedPoints, n_points: int, folder: Path, stages: Stages, each: Each = map
    ) -> Selection:
        """Choose points of a cloud for which `in_passes` takes too much memory.

        A method whose `memory_in_tiles` is not None overrides this. The chosen points may be others than in memory,
        but they do not depend on the chunks.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        folder : path
            An empty folder for temporary files.
        stages : Stages
            Measures the time of each stage, and reports progress to its listener.
        each : callable, optional
            Applies a function to each tile of the cloud, like `map`.

        Returns
        -------
        Selection
            M points. Repeats are among them only if there are fewer different places.
        """
        raise NotImplementedError

    def memory_in_tiles(self, n: int, n_points: int) -> int | None:
        """Return about how much memory `in_tiles` takes, beyond one chunk of points.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int or None
            Bytes; None if the method has no `in_tiles`.
        """
        return None

    def disk_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much disk space `in_tiles` takes.

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
        return 0

    def __post_init__(self) -> None:
        """Check the types and the ranges of all parameters. Subclasses that check more call this first.

        Raises
        ------
        ParameterError
            If a parameter has a wrong type or is outside its range.
        """
        types = _types(type(self))
        for each in dataclasses.fields(self):
            alternatives = typing.get_args(types[each.name]) or (types[each.name],)
            value = _as_one_of(alternatives, getattr(self, each.name))
            self.require(value is not _INVALID, each.name, " or ".join(map(_written, alternatives)))
            object.__setattr__(self, each.name, value)  # numbers of NumPy become Python's
            if isinstance(value, int | float):
                least, most = each.metadata.get(_RANGE, (None, None))
                self.require(_lies_within(value, least, most), each.name, _range(value, least, most))

    @property
    def label(self) -> str:
        """The name and, in brackets, all parameters that differ from their defaults."""
        changed = [
            f"{each.name}={getattr(self, each.name)}"
            for each in dataclasses.fields(self)
            if getattr(self, each.name) != each.default
        ]
        return f"{self.name} ({', '.join(changed)})" if changed else self.name

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the descriptions of all parameters.

        Returns
        -------
        dict of str to Parameter
            By name, in the order of the fields. The texts are those given to `parameter`.
        """
        return _described(cls, {each.name: each for each in dataclasses.fields(cls)})

    def replaced(self, settings: Mapping[str, Any]) -> Self:
        """Return a copy with other values of some parameters.

        Parameters
        ----------
        settings : mapping of str to value
            The new values by name. A text is converted to the type of the parameter; "none" means None.

        Returns
        -------
        Method
            Of the same class.

        Raises
        ------
        ParameterError
            If a parameter does not exist, or a value has a wrong type or is outside its range.
        """
        types = _types(type(self))
        known = [each.name for each in dataclasses.fields(self)]
        for key in settings:
            if key not in known:
                raise ParameterError(
                    f"method {self.name!r} has no parameter {key!r}"
                    + (nearest_name(key, known) if known else "; it has none at all")
                )
        values = {key: _read(value, types[key]) for key, value in settings.items()}
        return dataclasses.replace(self, **values)

    def require(self, condition: bool, parameter: str, expected: str) -> None:
        """Check a condition on a parameter.

        Parameters
        ----------
        condition : bool
        parameter : str
            Name of the parameter, for the error message.
        expected : str
            What the parameter should be, for the error message, such as "at least 1".

        Raises
        ------
        ParameterError
            If the condition is false.
        """
        if not condition:
            raise ParameterError(
                f"method {self.name!r}: expected {parameter} to be {expected}, found {shown(getattr(self, parameter))}"
            )


def random_candidates(n: int, candidates: int | None, n_points: int, seed: int) -> NDArray[np.int64]:
    """Choose a random subset of n points.

    Parameters
    ----------
    n : int
    candidates : int or None
        Size of the subset; None means all n points.
    n_points : int
        Least size of the subset.
    seed : int

    Returns
    -------
    (size,) array, int64
        Indices, ascending.
    """
    import numpy as np

    if candidates is None:
        return np.arange(n)
    return np.sort(np.random.default_rng(seed).permutation(n)[: max(candidates, n_points)])


def largest(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the indices of the largest values.

    Parameters
    ----------
    values : (N,) array, float64
    count : int
        From 0 to N.

    Returns
    -------
    (count,) array, int64
        Largest value first; ties go to the smallest index.
    """
    import numpy as np

    if count == 0:
        return np.empty(0, dtype=np.int64)
    least = np.partition(values, len(values) - count)[len(values) - count]
    candidates = np.flatnonzero(values >= least)
    return candidates[np.argsort(-values[candidates], kind="stable")[:count]]


def _as_one_of(alternatives: tuple[Any, ...], value: Any) -> Any:
    """Return a value as one of the types or literal texts, or `_INVALID` if it is none of them."""
    if isinstance(value, str | bool | None):
        return value if value in alternatives or type(value) in alternatives else _INVALID
    families: tuple[tuple[Any, type], ...] = ((int, numbers.Integral), (float, numbers.Real))
    for kind, family in families:
        if kind in alternatives and isinstance(value, family):
            try:
                return kind(value)
            except OverflowError:  # a whole number too large for a float
                return _INVALID
    return _INVALID


def _lies_within(value: float, least: float | None, most: float | None) -> bool:
    """Return whether a number is in a range, whose ends may be open; a float must be finite and not denormal."""
    if value != value or _is_denormal(value) or (abs(value) == math.inf and value != most):
        return False
    return (least is None or value >= least) and (most is None or value <= most)


def _range(value: float, least: float | None, most: float | None) -> str:
    """Return the range outside of which a number lies, as messages show it."""
    if least is not None and most is not None:
        words = f"from {least:g} to {most:g}"
    else:
        ends = [f"at {side} {end:g}" for side, end in (("least", least), ("most", most)) if end is not None]
        words = " and ".join(["finite", *ends] if isinstance(value, float) else ends)
    return f"{words}, and not denormal" if _is_denormal(value) else words


def _is_denormal(value: float) -> bool:
    return 0 < abs(value) < sys.float_info.min


def _written(alternative: Any) -> str:
    """Return a type or a literal text as messages show it."""
    if isinstance(alternative, str):
        return repr(alternative)
    return "none" if alternative is type(None) else alternative.__name__


def _read(value: Any, expected: Any) -> Any:
    """Convert a text to one of the types of an annotation; return it unchanged if that fails."""
    if not isinstance(value, str):
        return value
    alternatives = typing.get_args(expected) or (expected,)
    if type(None) in alternatives and value.lower() == "none":
        return None
    if bool in alternatives and value.lower() in ("true", "false"):
        return value.lower() == "true"
    for kind in (int, float):
        if kind in alternatives:
            try:
                return kind(value)
            except ValueError:
                continue
    return value


def _described(cls: type[Method], fields: Mapping[str, dataclasses.Field[Any]]) -> dict[str, Parameter]:
    """Return the descriptions of the parameters that some fields of a method declare."""
    types = _types(cls)
    return {
        name: Parameter(_kind(types[name]), declared.default, declared.metadata.get(_MEANING, ""))
        for name, declared in fields.items()
    }


@cache
def _types(cls: type) -> Mapping[str, Any]:
    """Return the types of the fields of a class."""
    return typing.get_type_hints(cls)


def _kind(annotation: Any) -> str:
    """Return a type annotation as docstrings write it: "int", "int, optional", '"mean" or "median"'."""
    alternatives = typing.get_args(annotation) or (annotation,)
    kinds = [f'"{each}"' if isinstance(each, str) else each.__name__ for each in alternatives if each is not type(None)]
    return " or ".join(kinds) + (", optional" if type(None) in alternatives else "")


def _completed(docstring: str, texts: list[str], parameters: Mapping[str, Parameter]) -> str:
    """Return a docstring with texts and a section of parameters inserted after its first paragraph."""
    first, _, rest = inspect.cleandoc(docstring).partition("\n\n")
    section = ["Parameters", "----------"] if parameters else []
    for name, each in parameters.items():
        section.append(f"{name} : {each.kind}" + ("" if each.default is None else f", default {each.default!r}"))
        section.append(textwrap.fill(each.meaning, WIDTH, initial_indent="    ", subsequent_indent="    "))
    return "\n\n".join(filter(None, [first, *texts, "\n".join(section), rest]))
