"""Lengths as people give them: in the unit of the coordinates, with a unit of their own, or as a share of the cloud."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from gppcs.clouds.header import Header
from gppcs.errors import InputError, ParameterError, nearest_name, number, shown

METRES = {
    "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "km": 1e3, "in": 0.0254,
    "ft": 0.3048, "us-ft": 1200 / 3937,
}  # fmt: skip
SHARE = "%"  # of the diagonal of the bounding box
_LENGTH = re.compile(r"(?P<number>[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?)\s*(?P<unit>\S*)", re.ASCII)


@dataclass(frozen=True)
class Length:
    """A length that somebody asks for.

    Attributes
    ----------
    name : str
        What it is, as messages call it: that of an argument, which is also that of an option.
    given : object
        How it was given.
    amount : float
        Above 0.
    unit : str
        One of `METRES`, or `SHARE`; empty for the unit of the coordinates.
    """

    name: str
    given: Any
    amount: float
    unit: str

    @classmethod
    def of(cls, name: str, given: Any) -> Length:
        """Return the length that a value means."""
        found = _LENGTH.fullmatch(given.strip()) if isinstance(given, str) else None
        amount = float(found["number"]) if found else number(given)
        unit = found["unit"] if found else ""
        if found and unit not in (*METRES, SHARE, ""):
            raise _error(
                name, f"to have a unit, found {shown(unit)} in {shown(given)}{nearest_name(unit, [*METRES, SHARE])}"
            )
        if math.isnan(amount):
            raise _error(name, f"to be a length, such as 0.5, 0.5mm or 0.02%, found {shown(given)}")
        if not 0.0 < amount < math.inf:
            least = "above 0, which is what all points give," if name == "tolerance" else "above 0"
            raise _error(name, f"to be {least} and finite, found {shown(given)}")
        return cls(name, given, amount, unit)

    def in_cloud(self, diagonal: float, metres: float | None) -> float:
        """Return the length in the unit of the coordinates of a cloud."""
        if self.unit == SHARE:
            return self.amount / 100.0 * diagonal
        if not self.unit:
            return self.amount
        if metres is None:
            found = (
                f"the cloud does not say in which unit its coordinates are, so it is not known how much {self.given} is"
            )
            raise InputError(
                f"{found}; give unit=, such as unit='m', or {self.name} as a number in the unit of the coordinates",
                command=f"{found}; give --unit, such as --unit m, or {option(self.name)} without a unit, in that of "
                "the coordinates",
            )
        return self.amount * METRES[self.unit] / metres


def metres_of(unit: Any, header: Header | None) -> float | None:
    """Return the unit of the coordinates of a cloud in metres."""
    if unit is None:
        return header.metres if header else None
    if not (isinstance(unit, str) and unit in METRES):
        raise ParameterError(f"expected the name of a unit of length, found {shown(unit)}{nearest_name(unit, METRES)}")
    return METRES[unit]


def name_of_unit(metres: float) -> str:
    """Return the name of a unit of length."""
    return next((name for name, each in METRES.items() if math.isclose(each, metres, rel_tol=1e-7)), f"{metres:g} m")


def option(name: str) -> str:
    """Return the option of the command that stands for an argument of the library."""
    return "--points" if name == "n_points" else f"--{name.replace('_', '-')}"


def _error(name: str, rest: str) -> ParameterError:
    return ParameterError(f"expected {name} {rest}", command=f"expected {option(name)} {rest}")
