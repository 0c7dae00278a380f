"""What a simplification method is: a frozen dataclass of its parameters that can be called on points."""

from __future__ import annotations

import dataclasses
import inspect
import numbers
import re
import typing
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

from gppcs.engine.stages import Stages
from gppcs.errors import ParameterError, nearest_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


_OTHER = object()  # what is no value of a parameter


@dataclass(frozen=True)
class Selection:
    """The points a method chose.

    Attributes
    ----------
    indices : (M,) array, int64
        Unique, in the order chosen.
    diagnostics : mapping of name to float
        What the method found out on the way, such as fitted hyperparameters.
    points : (M, 3) array, float64, optional
        Where the method moved the points to; where not given, they stay in their places.
    attributes : mapping of name to (M,) array
        What the method found out about each of them.
    """

    indices: NDArray[np.int64]
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    points: NDArray[np.float64] | None = None
    attributes: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a method.

    Attributes
    ----------
    kind : str
        What it may be.
    default : int, float, bool, str or None
    meaning : str
        What it does.
    """

    kind: str
    default: Any
    meaning: str


@dataclass(frozen=True)
class Method(ABC):
    """A way to choose points; the fields of the subclass are its parameters.

    Heavy imports belong into `__call__`, so that listing the methods costs nothing.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    source: ClassVar[str]
    attributes: ClassVar[tuple[str, ...]] = ()  # of a Selection

    @abstractmethod
    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose `n_points` of `points`, (N, 3), which are finite and without repeats, with n_points below N."""

    def __post_init__(self) -> None:
        """Make sure that each parameter has its type; subclasses that check ranges call this first.

        Raises
        ------
        ParameterError
            If one has not.
        """
        types = typing.get_type_hints(type(self))
        for parameter in dataclasses.fields(self):
            alternatives = typing.get_args(types[parameter.name]) or (types[parameter.name],)
            value = _as_one_of(alternatives, getattr(self, parameter.name))
            self.require(value is not _OTHER, parameter.name, " or ".join(map(_written, alternatives)))
            object.__setattr__(self, parameter.name, value)  # numbers of NumPy become Python's

    @property
    def label(self) -> str:
        """The name and, in brackets, the parameters that are not at their defaults."""
        changed = [
            f"{parameter.name}={getattr(self, parameter.name)}"
            for parameter in dataclasses.fields(self)
            if getattr(self, parameter.name) != parameter.default
        ]
        return f"{self.name} ({', '.join(changed)})" if changed else self.name

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the parameters by name, with what the docstring of the class says of each."""
        _, _, section = (inspect.getdoc(cls) or "").partition("\nParameters\n----------\n")
        said = {name: (kind, text) for name, kind, text in re.findall(r"^(\w+) : (.+)((?:\n    .+)+)", section, re.M)}
        return {
            field.name: Parameter(said[field.name][0], field.default, " ".join(said[field.name][1].split()))
            for field in dataclasses.fields(cls)
        }

    def replaced(self, settings: Mapping[str, Any]) -> Self:
        """Return a copy with other values for the named parameters.

        Text is read as the parameter's type, with "none" for None.

        Raises
        ------
        ParameterError
            If there is no such parameter, or its value is not one.
        """
        types = typing.get_type_hints(type(self))
        known = [parameter.name for parameter in dataclasses.fields(self)]
        for key in settings:
            if key not in known:
                raise ParameterError(
                    f"method {self.name!r} has no parameter {key!r}"
                    + (nearest_name(key, known) if known else "; it has none at all")
                )
        values = {key: _read(value, types[key]) for key, value in settings.items()}
        return dataclasses.replace(self, **values)

    def require(self, condition: bool, parameter: str, expected: str) -> None:
        """Raise a ParameterError that names the parameter, unless the condition holds."""
        if not condition:
            raise ParameterError(
                f"method {self.name!r}: expected {parameter} to be {expected}, found {getattr(self, parameter)!r}"
            )


def random_candidates(n: int, candidates: int | None, n_points: int, seed: int) -> NDArray[np.int64]:
    """Return the ascending indices of so many random points of n, at least `n_points` and at most n; None means all."""
    import numpy as np

    if candidates is None:
        return np.arange(n)
    return np.sort(np.random.default_rng(seed).permutation(n)[: max(candidates, n_points)])


def largest(values: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the indices of the `count` largest values, largest first; ties go to the smallest index."""
    import numpy as np

    if count == 0:
        return np.empty(0, dtype=np.int64)
    least = np.partition(values, len(values) - count)[len(values) - count]
    candidates = np.flatnonzero(values >= least)
    return candidates[np.argsort(-values[candidates], kind="stable")[:count]]


def _as_one_of(alternatives: tuple[Any, ...], value: Any) -> Any:
    """Return a value as one of some types and literal texts, or `_OTHER` where it is none of them."""
    if isinstance(value, str | bool | None):
        return value if value in alternatives or type(value) in alternatives else _OTHER
    families: tuple[tuple[Any, type], ...] = ((int, numbers.Integral), (float, numbers.Real))
    for kind, family in families:
        if kind in alternatives and isinstance(value, family):
            return kind(value)
    return _OTHER


def _written(alternative: Any) -> str:
    """Return a type or a literal text as people write it."""
    if isinstance(alternative, str):
        return repr(alternative)
    return "none" if alternative is type(None) else alternative.__name__


def _read(value: Any, expected: Any) -> Any:
    """Read text as one of the types of an annotation; leave it as it is where it is none of them."""
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
