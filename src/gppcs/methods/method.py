"""What a simplification method is: a frozen dataclass of its parameters that can be called on points."""

from __future__ import annotations

import dataclasses
import typing
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

from gppcs.errors import ParameterError
from gppcs.names import nearest_name
from gppcs.stages import Stages

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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
    """

    indices: NDArray[np.int64]
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    points: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Method(ABC):
    """A way to choose points; the fields of the subclass are its parameters.

    Heavy imports belong into `__call__`, so that listing the methods costs nothing.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    source: ClassVar[str]

    @abstractmethod
    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose `n_points` of `points`, (N, 3), which are finite and without repeats, with n_points below N."""

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
        values = {key: _read(key, value, types[key]) for key, value in settings.items()}
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


def _read(key: str, value: Any, expected: Any) -> Any:
    """Read the text of a value as one of the types of an annotation."""
    if not isinstance(value, str):
        return value
    alternatives = typing.get_args(expected) or (expected,)
    if all(isinstance(choice, str) for choice in alternatives):
        if value in alternatives:
            return value
        raise ParameterError(f"expected {key} to be one of {', '.join(alternatives)}, found {value!r}")
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
    names = " or ".join("none" if choice is type(None) else choice.__name__ for choice in alternatives)
    raise ParameterError(f"expected {key} to be {names}, found {value!r}")
