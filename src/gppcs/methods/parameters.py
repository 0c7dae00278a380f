"""Parameters of methods: how they are declared, checked, read from text and described."""

from __future__ import annotations

import dataclasses
import inspect
import math
import numbers
import textwrap
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from gppcs.errors import ParameterError, nearest_name, shown

if TYPE_CHECKING:
    from gppcs.methods.method import Method

Value = TypeVar("Value")

WIDTH = 100  # characters per line of the docstrings that are completed here
_MEANING = "meaning"  # the key of a field's metadata that holds the help of the parameter
_RANGE = "range"  # the key that holds its minimum and its maximum
_INVALID = object()  # stands for a value that a parameter cannot have


@dataclass(frozen=True)
class Parameter:
    """A parameter of a method: its type or the values that it may have, its default, and what it does."""

    kind: str
    default: Any
    meaning: str


def parameter(default: Value, meaning: str, minimum: float | None = None, maximum: float | None = None) -> Value:
    """Declare a parameter of a method, as a field of its dataclass.

    Parameters
    ----------
    default : int, float, bool, str or None
    meaning : str
        What the parameter does, in one or more sentences. The help of the command and the docstring show it.
    minimum, maximum : float, optional
        The range of a number; both ends belong to it. A float must also be finite, unless `maximum` is infinite.

    Returns
    -------
    dataclasses.Field
        Typed as `default`, as type checkers expect of the default of a field.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import gppcs
    >>> from gppcs.methods.parameters import parameters_of
    >>> @dataclass(frozen=True)
    ... class FirstRows(gppcs.Method):
    ...     name, summary, source = "first-rows", "the first rows", "an example"
    ...     step: int = gppcs.parameter(1, "Distance between the rows that are taken.")
    ...     def __call__(self, task):
    ...         return gppcs.Selection(np.arange(task.n_points) * self.step)
    >>> parameters_of(FirstRows)["step"].meaning
    'Distance between the rows that are taken.'
    """
    declared: Any = field(default=default, metadata={_MEANING: meaning, _RANGE: (minimum, maximum)})
    return declared


def check_parameter(method: Method, declared: dataclasses.Field[Any]) -> None:
    """Check the type and the range of a parameter; a number of NumPy becomes Python's."""
    kind = _types(type(method))[declared.name]
    alternatives = typing.get_args(kind) or (kind,)
    value = _as_one_of(alternatives, getattr(method, declared.name))
    require(method, value is not _INVALID, declared.name, " or ".join(map(_written, alternatives)))
    object.__setattr__(method, declared.name, value)
    if isinstance(value, int | float):
        minimum, maximum = declared.metadata.get(_RANGE, (None, None))
        is_finite = abs(value) < math.inf or value == maximum
        is_within = (minimum is None or value >= minimum) and (maximum is None or value <= maximum)
        require(method, is_finite and is_within, declared.name, _range(value, minimum, maximum))


def require(method: Method, condition: bool, parameter: str, expected: str) -> None:
    """Raise an error unless a condition on a parameter holds; `expected` says what it should be."""
    if not condition:
        value = shown(getattr(method, parameter))
        raise ParameterError(f"method {method.name!r}: expected {parameter} to be {expected}, found {value}")


def with_settings(method: Method, settings: Mapping[str, Any]) -> Method:
    """Return a method with other values of some parameters; texts are converted, and "none" means None."""
    types = _types(type(method))
    names = [declared.name for declared in dataclasses.fields(method)]
    for key in settings:
        if key not in names:
            near = nearest_name(key, names) if names else "; it has none at all"
            raise ParameterError(f"method {method.name!r} has no parameter {key!r}{near}")
    return dataclasses.replace(method, **{key: _read(value, types[key]) for key, value in settings.items()})


def _as_one_of(alternatives: tuple[Any, ...], value: Any) -> Any:
    """Return a value as one of the types or literal texts, or `_INVALID` if it is none of them."""
    if isinstance(value, str | bool | None):
        return value if value in alternatives or type(value) in alternatives else _INVALID
    if int in alternatives and isinstance(value, numbers.Integral):
        return int(value)
    try:
        return float(value) if float in alternatives and isinstance(value, numbers.Real) else _INVALID
    except OverflowError:  # a whole number too large for a float
        return _INVALID


def _range(value: float, minimum: float | None, maximum: float | None) -> str:
    """Return the range outside of which a number lies, as messages show it."""
    if minimum is not None and maximum is not None:
        return f"from {minimum:g} to {maximum:g}"
    ends = [f"at {side} {end:g}" for side, end in (("least", minimum), ("most", maximum)) if end is not None]
    return " and ".join(["finite", *ends] if isinstance(value, float) else ends)


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


def parameters_of(method: Method | type[Method]) -> dict[str, Parameter]:
    """Return the descriptions of all parameters of a method, by name."""
    cls = method if isinstance(method, type) else type(method)
    return described(cls, {declared.name: declared for declared in dataclasses.fields(cls)})


def described(cls: type[Method], fields: Mapping[str, dataclasses.Field[Any]]) -> dict[str, Parameter]:
    """Return the descriptions of the parameters that some fields of a method declare, by name."""
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
    kinds = [f'"{kind}"' if isinstance(kind, str) else kind.__name__ for kind in alternatives if kind is not type(None)]
    return " or ".join(kinds) + (", optional" if type(None) in alternatives else "")


def completed(docstring: str, texts: list[str], parameters: Mapping[str, Parameter]) -> str:
    """Return a docstring with texts and a section of parameters inserted after its first paragraph."""
    first, _, rest = inspect.cleandoc(docstring).partition("\n\n")
    section = ["Parameters", "----------"] if parameters else []
    for name, parameter in parameters.items():
        section.append(
            f"{name} : {parameter.kind}" + ("" if parameter.default is None else f", default {parameter.default!r}")
        )
        section.append(textwrap.fill(parameter.meaning, WIDTH, initial_indent="    ", subsequent_indent="    "))
    return "\n\n".join(filter(None, [first, *texts, "\n".join(section), rest]))
