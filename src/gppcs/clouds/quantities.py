"""What people write for an amount: 5k points, 3% of them, a length such as 0.5mm, or an error such as 2mm:p95."""

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal, NamedTuple, Self, TypeAlias, get_args

import numpy as np

from gppcs.clouds.header import Header
from gppcs.errors import InputError, ParameterError, nearest_name, number, shown, whole_number
from gppcs.spatial.units import Units

Measure: TypeAlias = Literal["mean", "rms", "p95", "max"]
MEASURES: tuple[Measure, ...] = get_args(Measure)

METRES = {
    "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "km": 1e3, "in": 0.0254,
    "ft": 0.3048, "us-ft": 1200 / 3937,
}  # fmt: skip
PERCENT = "%"  # of the points, or of the diagonal of the bounding box
_NUMBER = r"(?P<number>[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?)"  # few digits of the exponent, to compute exactly


def count_of(name: str, value: Any, minimum: int = 1) -> int:
    """Return the whole number that the value of an argument means: an int, or a text such as 5000, 5,000 or 1.5M."""
    label = {"n_points": "the number of points", "n_faces": "the number of triangles"}.get(name, f"`{name}`")
    return whole_number(label, _count(name, value) if isinstance(value, str) else value, minimum)


def ratio_of(name: str, value: Any) -> float:
    """Return the ratio, above 0 and at most 1, that the value of an argument means: 0.03 or a text such as 3%."""
    ratio = number(_fraction(name, value) if isinstance(value, str) else value)
    if 0 < ratio <= 1:
        return ratio
    if isinstance(value, str) and value.strip().endswith(PERCENT):
        raise ParameterError(f"expected a ratio above 0 and at most 100%, found {shown(value)}")
    percent = f"; for {ratio:g} percent, write {ratio / 100:g}" if 2 <= ratio <= 100 else ""
    raise ParameterError(f"expected a ratio above 0 and at most 1, found {shown(value)}{percent}")


def size_of(name: str, value: Any) -> float | int:
    """Return the ratio of the points (a float below 1) or their number (an int) that one value means."""
    if isinstance(value, str):
        is_plain = re.fullmatch(_NUMBER, value.strip(), re.ASCII)
        is_ratio = value.strip().endswith(PERCENT) or (is_plain and 0 < float(value) < 1)
        value = _fraction(name, value) if is_ratio else _count(name, value)
    return number(value) if 0 < number(value) < 1 else count_of(name, value)


def _count(name: str, text: str) -> int:
    """Return the whole number that a text means, with commas between thousands and one of the units k, M and G."""
    plain = re.sub(r"(?<=\d)_(?=\d)", "", text.strip())
    if re.match(r"[+-]?\d{1,3}(,\d{3})+(?![\d,])", plain):
        plain = plain.replace(",", "")
    match = re.fullmatch(_NUMBER + " ?(?P<unit>[kKmMgG]?)", plain, re.ASCII)
    if not match or re.fullmatch(r"\+?[1-9]\d{0,2}(\.\d{3})+", plain):  # in many languages, a point parts thousands
        raise ParameterError(
            f"expected `{name}` to be a whole number, such as 5000, 5,000, 5k or 1.5M, found {shown(text)}"
        )
    exact = Fraction(match["number"]) * {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}[match["unit"].lower()]
    if exact.denominator != 1 or abs(exact) > 10**18:
        raise ParameterError(f"expected `{name}` to be a whole number of at most 1e18, found {shown(text)}")
    return exact.numerator


def _fraction(name: str, text: str) -> float:
    """Return the fraction that a text means, such as 0.03 or 3%."""
    percent = re.fullmatch(f"{_NUMBER} ?{PERCENT}", text.strip(), re.ASCII)
    try:
        return float(Fraction(percent["number"]) / 100) if percent else float(text)
    except (ValueError, OverflowError):
        raise ParameterError(f"expected `{name}` to be a fraction, such as 0.03 or 3%, found {shown(text)}") from None


def bytes_of(memory: int | str) -> int:
    """Return a number of bytes that is written with a unit, such as 4GB or 512 MiB."""
    text = str(memory) if isinstance(memory, int | str) and not isinstance(memory, bool) else ""
    match = re.fullmatch(r"\s*(\d+|\d*\.\d+)\s*([kmgt]?)(i?)b?\s*", text, re.IGNORECASE | re.ASCII)
    if match and (match[2] or not match[3]):
        exponent = "kmgt".find(match[2].lower()) + 1 if match[2] else 0
        exact = Fraction(match[1]) * (1024 if match[3] else 1000) ** exponent  # floats could overflow
        if round(exact) > 0 and (match[2] or exact == round(exact)):
            return round(exact)
    raise ParameterError(f"expected an amount of memory such as 4GB or 512MB, found {shown(memory)}")


@dataclass(frozen=True)
class Length:
    """A length that somebody asks for."""

    name: str  # What it is, as messages call it: that of an argument, which is also that of an option
    text: str  # As it was given
    amount: float  # Above 0
    unit: str  # One of `METRES`, or `PERCENT`; empty for the unit of the coordinates

    @classmethod
    def from_value(cls, name: str, value: Any) -> Self:
        """Return the length that a value means: a number, or a text such as "0.5mm", "5 cm" or "0.02%"."""
        match = re.fullmatch(rf"{_NUMBER}\s*(?P<unit>\S*)", value.strip(), re.ASCII) if isinstance(value, str) else None
        amount, unit = (float(match["number"]), match["unit"]) if match else (number(value), "")
        if unit not in (*METRES, PERCENT, ""):
            near = nearest_name(unit, [*METRES, PERCENT])
            raise ParameterError(f"expected `{name}` to have a unit, found {shown(unit)} in {shown(value)}{near}")
        if math.isnan(amount):
            raise ParameterError(f"expected `{name}` to be a length, such as 0.5, 0.5mm or 0.02%, found {shown(value)}")
        if not 0.0 < amount < math.inf:
            raise ParameterError(f"expected `{name}` to be a length above 0, found {shown(value)}")
        return cls(name, str(value), amount, unit)

    def in_cloud(self, diagonal: float, units: Units | None) -> float:
        """Return the length in the unit of lengths of a cloud, given the diagonal of its box in it, and its units."""
        if self.unit == PERCENT:
            return self.amount / 100.0 * diagonal
        if not self.unit:
            return self.amount
        if units is None:
            raise InputError(
                f"the cloud does not say in which unit its coordinates are, so it is not known how much {self.text} "
                f"is; give `unit`, such as 'm', or `{self.name}` without a unit, in that of the coordinates"
            )
        return self.amount * METRES[self.unit] / units.length


@dataclass(frozen=True)
class Tolerance:
    """An error that somebody allows; `measure` is None for the largest distance, without outliers."""

    length: Length
    measure: Measure | None

    @classmethod
    def from_value(cls, value: Any) -> Self:
        """Return the error that a value means: a length, or a text with a length and a measure such as "2mm:p95"."""
        if not (isinstance(value, str) and ":" in value):
            return cls(Length.from_value("tolerance", value), None)
        length, _, name = value.rpartition(":")
        measure = next((measure for measure in MEASURES if measure == name.strip()), None)
        if measure is None:
            names = " or ".join(f":{measure}" for measure in MEASURES)
            raise ParameterError(f"expected `tolerance` to end in {names}, found {shown(value)}")
        return cls(Length.from_value("tolerance", length), measure)


class Scale(NamedTuple):
    """How lengths that somebody asks for become lengths in the coordinates of a method."""

    diagonal: float  # Of the bounding box, in the coordinates of the method
    units: Units | None  # of the cloud, if they are known
    exponent: int  # The unit of the method's coordinates is two to this power, in the unit of the cloud

    def inside(self, length: Length) -> float:
        """Return a length in the coordinates of the method, between bounds whose squares are floats."""
        with np.errstate(over="ignore", under="ignore"):
            scaled = float(np.ldexp(length.in_cloud(self.outside(self.diagonal), self.units), -self.exponent))
        return min(max(scaled, 1e-100), 1e100)

    def outside(self, length: float) -> float:
        """Return a length in the unit of the cloud, given in that of the method."""
        with np.errstate(over="ignore", under="ignore"):
            return float(np.ldexp(length, self.exponent))


def units_of(unit: Any, header: Header | None) -> Units | None:
    """Return the units of the axes: the named one for all of them, or those of the header; None if both lack them."""
    if unit is None:
        return header.units if header else None
    if not (isinstance(unit, str) and unit in METRES):
        raise ParameterError(f"expected the name of a unit of length, found {shown(unit)}{nearest_name(unit, METRES)}")
    return Units(METRES[unit], METRES[unit])


def name_of_unit(metres: float) -> str:
    """Return the name of a unit of length, such as "ft", or its length in metres, such as "0.9144 m"."""
    return next((name for name, value in METRES.items() if math.isclose(value, metres, rel_tol=1e-7)), f"{metres:g} m")


def unit_of(header: Header | None, unit: str | None = None) -> str | None:
    """Return the name of the unit of lengths: the one that is given, or that of the header, if it has one."""
    units = units_of(unit, header)
    return name_of_unit(units.length) if units else None


def names_of_units(units: Units) -> tuple[str, str]:
    """Return the names of the units of x and y, and of z."""
    degrees = math.degrees(units.horizontal)
    angle = "degrees" if math.isclose(degrees, 1.0, rel_tol=1e-7) else f"{degrees:g} degrees"
    return angle if units.is_geographic else name_of_unit(units.horizontal), name_of_unit(units.vertical)
