"""What can go wrong, in the caller's words: every message says what was expected, what was found, what to do."""

from __future__ import annotations

import difflib
import operator
from collections.abc import Iterable
from typing import Any


class GppcsError(Exception):
    """Root of all errors that gppcs raises on purpose."""


class InputError(GppcsError, ValueError):
    """A cloud that cannot be used: wrong shape, no points, coordinates that are not finite."""


class NoSurfaceError(InputError):
    """Points from which no surface could be rebuilt, though there is nothing wrong with them as a cloud."""


class ParameterError(GppcsError, ValueError):
    """A parameter, method or name that does not exist or lies outside its range."""


class FileFormatError(GppcsError, ValueError):
    """A file whose content is not what its format promises."""


class MissingExtraError(GppcsError, ImportError):
    """A feature whose optional dependency is not installed; the message names the extra."""


class OutputError(GppcsError, OSError):
    """A file that cannot be written: it exists, its folder does not, its format does not hold the cloud."""


def whole_number(name: str, value: Any, least: int) -> int:
    """Return a value as a Python int; raise a ParameterError that names it unless it is whole and at least `least`."""
    try:
        whole = operator.index(value)
    except TypeError:
        whole = least - 1
    if whole < least:
        found = repr(value) if isinstance(value, str) else value
        raise ParameterError(f"expected {name} to be a whole number from {least} on, found {found}")
    return whole


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Return the end of an error message: the known name nearest to `name`, or all of them."""
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; expected one of {', '.join(known)}"
