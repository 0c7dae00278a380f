"""The errors that gppcs raises; each message says what was expected, what was found and what to do."""

import difflib
import math
import numbers
import operator
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

MOST_SHOWN = 80  # characters of a wrong value that a message shows
ADDRESS = re.compile(r"(?i)\b(?!file:)([a-z][\w+.-]+):/+(?=[^/])")  # how the address of a server's file begins


class GppcsError(Exception):
    """Base class of all errors that gppcs raises on purpose.

    Arguments of the library that the user is to set stand between backticks; the command prints its options in their
    place.

    Examples
    --------
    >>> import gppcs
    >>> try:
    ...     gppcs.simplify([[0, 0, 0]], ratio=2)
    ... except gppcs.GppcsError as error:
    ...     print(error)
    expected a ratio above 0 and at most 1, found 2; for 2 percent, write 0.02
    """


class InputError(GppcsError, ValueError):
    """A cloud cannot be used: it has a wrong shape, no points, or coordinates that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import gppcs
    >>> gppcs.simplify(np.empty((0, 3)), n_points=1)
    Traceback (most recent call last):
    gppcs.errors.InputError: the cloud is empty: expected at least one point
    """


class NoSurfaceError(InputError):
    """No surface can be rebuilt from the points, although they are a valid cloud."""


class ParameterError(GppcsError, ValueError):
    """A method, parameter or name does not exist, or a value is outside its range.

    Examples
    --------
    >>> import gppcs
    >>> gppcs.sample("braket")
    Traceback (most recent call last):
    gppcs.errors.ParameterError: expected the name of a sample scan, found 'braket'; did you mean 'bracket'?
    """


class FileFormatError(GppcsError, ValueError):
    """The format of a file is unknown, or its content does not follow the format."""


class MissingExtraError(GppcsError, ImportError):
    """An optional dependency is not installed; the message names the extra or the package to install."""


class OutputError(GppcsError, OSError):
    """A file cannot be written: it exists already, its folder is missing, or its format cannot hold the cloud."""


def shown(value: Any) -> str:
    """Return a value as messages show it: in one line, and not too long."""
    line = str(value) if isinstance(value, numbers.Number) else " ".join(repr(value).split())
    return line if len(line) <= MOST_SHOWN else f"{line[:MOST_SHOWN]}..."


def number(value: Any) -> float:
    """Return a value as a float, or NaN, which lies in no range, if it is no real number."""
    if isinstance(value, str | bytes | bytearray | bool | complex) or getattr(value, "ndim", None):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def file_path(path: Any) -> Path:
    """Return the path of a file, or raise an error if it is none."""
    try:
        source = Path(path)
    except TypeError as error:
        raise ParameterError(f"expected the name of a file or a path, found {shown(path)}") from error
    if "\0" in str(source) or path == "":
        raise ParameterError(f"expected the name of a file, without zero characters, found {str(path)!r}")
    return source.absolute() if str(source) == "-" and isinstance(path, str) and path != "-" else source


def with_addresses(text: str) -> str:
    """Return a text with both slashes of each address, of which a path has lost one."""
    return ADDRESS.sub(lambda match: f"{match[1].lower()}://", text)


def flag(name: str, value: Any) -> bool:
    """Check that a value is True or False."""
    if not (isinstance(value, bool) or (getattr(value, "shape", None) == () and value.dtype == bool)):
        raise ParameterError(f"expected `{name}` to be True or False, found {shown(value)}")
    return bool(value)


def one_of(name: str, value: Any, choices: tuple[str, ...]) -> str:
    """Check that a value is one of several words."""
    if not (isinstance(value, str) and value in choices):
        raise ParameterError(f"expected `{name}` to be {' or '.join(map(repr, choices))}, found {shown(value)}")
    return value


def whole_number(name: str, value: Any, minimum: int) -> int:
    """Check that a value is a whole number of at least a given size."""
    try:
        integer = minimum - 1 if isinstance(value, bool) else operator.index(value)
    except TypeError:
        integer = minimum - 1
    if integer < minimum:
        raise ParameterError(f"expected {name} to be a whole number from {minimum} on, found {shown(value)}")
    return integer


def nearest_name(name: Any, names: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name."""
    choices = list(names)
    lowered = {choice.lower(): choice for choice in choices}
    near = difflib.get_close_matches(name.lower(), lowered, n=1) if isinstance(name, str) else []
    return f"; did you mean {lowered[near[0]]!r}?" if near else f"; expected one of {', '.join(choices)}"
