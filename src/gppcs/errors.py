"""The errors that gppcs raises; each message says what was expected, what was found and what to do."""

from __future__ import annotations

import difflib
import operator
from collections.abc import Iterable
from typing import Any


class GppcsError(Exception):
    """Base class of all errors that gppcs raises on purpose.

    Examples
    --------
    >>> import gppcs
    >>> try:
    ...     gppcs.simplify([[0, 0, 0]], ratio=2)
    ... except gppcs.GppcsError as error:
    ...     print(error)
    expected a ratio above 0 and at most 1, found 2
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
    """No surface can be rebuilt from the points, although they are a valid cloud.

    Examples
    --------
    >>> import gppcs
    >>> issubclass(gppcs.NoSurfaceError, gppcs.InputError)
    True
    """


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
    """The format of a file is unknown, or its content does not follow the format.

    Examples
    --------
    >>> import tempfile
    >>> import gppcs
    >>> with tempfile.NamedTemporaryFile(suffix=".doc") as file:
    ...     gppcs.read(file.name)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    gppcs.errors.FileFormatError: ...: expected one of the formats .ply ..., found '.doc'
    """


class MissingExtraError(GppcsError, ImportError):
    """An optional dependency is not installed; the message names the extra to install.

    Examples
    --------
    >>> import gppcs
    >>> issubclass(gppcs.MissingExtraError, ImportError)
    True
    """


class OutputError(GppcsError, OSError):
    """A file cannot be written: it exists already, its folder is missing, or its format cannot hold the cloud.

    Examples
    --------
    >>> import gppcs
    >>> gppcs.write("no such folder/cloud.ply", [[0, 0, 0]])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    gppcs.errors.OutputError: no such folder/cloud.ply: expected a folder ..., found none; make it or choose another
    """


def whole_number(name: str, value: Any, least: int) -> int:
    """Check that a value is a whole number of at least a given size.

    Parameters
    ----------
    name : str
        What the value is, for the error message.
    value : object
        The value to check; integers of NumPy count as whole numbers, floats do not.
    least : int
        The smallest value allowed.

    Returns
    -------
    int
        The value as a Python int.

    Raises
    ------
    ParameterError
        If the value is not a whole number or is below `least`.
    """
    try:
        whole = operator.index(value)
    except TypeError:
        whole = least - 1
    if whole < least:
        found = repr(value) if isinstance(value, str) else value
        raise ParameterError(f"expected {name} to be a whole number from {least} on, found {found}")
    return whole


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name.

    Parameters
    ----------
    name : str
        The unknown name.
    known : iterable of str
        The names that exist.

    Returns
    -------
    str
        "; did you mean ...?" with the most similar known name, or a list of all known names if none is similar.
    """
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; expected one of {', '.join(known)}"
