"""What people write for an amount: 5k points, 3% of them, a length such as 0.5mm, or an error such as 2mm:p95."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from gppcs.clouds.header import Header
from gppcs.errors import InputError, ParameterError, nearest_name, number, shown, whole_number

Measure: TypeAlias = Literal["mean", "rms", "p95", "max"]
MEASURES: tuple[Measure, ...] = get_args(Measure)

METRES = {
    "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "km": 1e3, "in": 0.0254,
    "ft": 0.3048, "us-ft": 1200 / 3937,
}  # fmt: skip
SHARE = "%"  # of the diagonal of the bounding box
_LENGTH = re.compile(r"(?P<number>[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?)\s*(?P<unit>\S*)", re.ASCII)

SHORTEST, LONGEST = 1e-100, 1e100  # Lengths in sizes of the cloud: squares of others would vanish or overflow.
_THOUSANDS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_MOST = 10**18  # of a number: more than any machine holds, and few enough digits to compute with
_COUNT = re.compile(
    r"(?P<whole>[+-]?(\d{1,3}(,\d{3})+|\d+(_\d+)*))?(?P<part>\.\d*)?(?P<power>[eE][+-]?\d{1,3})? ?(?P<unit>[kKmMgG]?)",
    re.ASCII,
)
_DOTTED = re.compile(r"(?P<whole>\+?[1-9]\d{0,2})(?P<parts>(\.\d{3})+)", re.ASCII)
_PERCENT = re.compile(r"(?P<number>[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?) ?%", re.ASCII)
_LABELS = {"n_points": "the number of points", "n_faces": "the number of triangles"}


def count_of(name: str, given: Any, least: int = 1) -> int:
    """Return the whole number that the value of an argument means: an int, or a text such as 5000, 5,000 or 1.5M."""
    return whole_number(_LABELS.get(name, name), _digits(name, given) if isinstance(given, str) else given, least)


def share_of(name: str, given: Any) -> float:
    """Return the share, above 0 and at most 1, that the value of an argument means: 0.03 or a text such as 3%."""
    value = _percentage(name, given) if isinstance(given, str) else given
    found = number(value)
    if 0 < found <= 1:
        return found
    if isinstance(given, str) and given.strip().endswith("%"):
        raise ParameterError(f"expected a ratio above 0 and at most 100%, found {shown(given)}")
    percentage = f"; for {found:g} percent, write {found / 100:g}" if 2 <= found <= 100 else ""
    raise ParameterError(f"expected a ratio above 0 and at most 1, found {shown(value)}{percentage}")


def size_of(name: str, given: Any) -> float | int:
    """Return the share of the points (a float below 1) or their number (an int) that one value means."""
    value = given
    if isinstance(given, str):
        try:
            plain = float(given)
        except ValueError:
            plain = math.nan
        is_share = given.strip().endswith("%") or 0 < plain < 1
        value = _percentage(name, given) if is_share else _digits(name, given)
    return number(value) if 0 < number(value) < 1 else whole_number(_LABELS.get(name, name), value, 1)


def _digits(name: str, text: str) -> int:
    if dotted := _DOTTED.fullmatch(text.strip()):  # in many languages, a point parts thousands
        or_less = f" or {dotted['whole']}" if dotted["parts"] == ".000" else ""
        without = text.strip().replace(".", "")
        raise ParameterError(
            f"expected {name} to be a whole number without points, found {shown(text)}; write {without}{or_less}"
        )
    found = _COUNT.fullmatch(text.strip())
    digits = found and f"{found['whole'] or ''}{found['part'] or ''}".replace(",", "").replace("_", "")
    if not found or not digits or not any(map(str.isdigit, digits)):
        hint = "; a share of the points is the ratio" if text.strip().endswith("%") and name == "n_points" else ""
        raise ParameterError(
            f"expected {name} to be a whole number, such as 5000, 5,000, 5k or 1.5M, found {shown(text)}{hint}"
        )
    value = Fraction(digits + (found["power"] or "")) * _THOUSANDS[found["unit"].lower()]
    if value.denominator != 1 or abs(value) > _MOST:
        raise ParameterError(f"expected {name} to be a whole number of at most 1e18, found {shown(text)}")
    return value.numerator


def _percentage(name: str, text: str) -> float:
    percent = _PERCENT.fullmatch(text.strip())
    try:
        return float(Fraction(percent["number"]) / 100) if percent else float(text)
    except (ValueError, OverflowError):
        raise ParameterError(f"expected {name} to be a share, such as 0.03 or 3%, found {shown(text)}") from None


def bytes_of(memory: int | str) -> int:
    """Return a number of bytes that is written with a unit, such as 4GB or 512 MiB."""
    text = str(memory) if isinstance(memory, int | str) and not isinstance(memory, bool) else ""
    match = re.fullmatch(r"\s*(\d+|\d*\.\d+)\s*([kmgt]?)(i?)b?\s*", text, re.IGNORECASE | re.ASCII)
    if match and (match[2] or not match[3]):
        exponent = "kmgt".find(match[2].lower()) + 1 if match[2] else 0
        exact = Decimal(match[1]) * (1024 if match[3] else 1000) ** exponent  # floats could overflow
        if round(exact) > 0 and (match[2] or exact == round(exact)):
            return round(exact)
    raise ParameterError(f"expected an amount of memory such as 4GB or 512MB, found {shown(memory)}")


@dataclass(frozen=True)
class Length:
    """A length that somebody asks for."""

    name: str  # What it is, as messages call it: that of an argument, which is also that of an option
    given: Any  # How it was given
    amount: float  # Above 0
    unit: str  # One of `METRES`, or `SHARE`; empty for the unit of the coordinates

    @classmethod
    def of(cls, name: str, given: Any) -> Length:
        """Return the length that a value means: a number, or a text such as "0.5mm", "5 cm" or "0.02%"."""
        if isinstance(given, str) and "," in given:
            raise ParameterError(
                f"expected {name} to be a length without commas, such as 0.5mm or 1500mm, found {shown(given)}"
            )
        found = _LENGTH.fullmatch(given.strip()) if isinstance(given, str) else None
        amount = float(found["number"]) if found else number(given)
        unit = found["unit"] if found else ""
        if found and unit not in (*METRES, SHARE, ""):
            raise ParameterError(
                f"expected {name} to have a unit, found {shown(unit)} in {shown(given)}"
                f"{nearest_name(unit, [*METRES, SHARE])}"
            )
        if math.isnan(amount):
            raise ParameterError(f"expected {name} to be a length, such as 0.5, 0.5mm or 0.02%, found {shown(given)}")
        if not 0.0 < amount < math.inf:
            all_points = "; to keep every point, give a ratio of 1" if name == "tolerance" and amount == 0.0 else ""
            raise ParameterError(f"expected {name} to be a length above 0, found {shown(given)}{all_points}")
        return cls(name, given, amount, unit)

    def in_cloud(self, diagonal: float, metres: float | None) -> float:
        """Return the length in the unit of a cloud, given the diagonal of its box, and that unit in metres if known."""
        if self.unit == SHARE:
            return self.amount / 100.0 * diagonal
        if not self.unit:
            return self.amount
        if metres is None:
            raise InputError(
                f"the cloud does not say in which unit its coordinates are, so it is not known how much {self.given} "
                f"is; give unit, such as 'm', or {self.name} without a unit, in that of the coordinates"
            )
        return self.amount * METRES[self.unit] / metres


@dataclass(frozen=True)
class Tolerance:
    """An error that somebody allows; `measure` is None for the largest distance, outliers aside."""

    length: Length
    measure: Measure | None

    @classmethod
    def of(cls, given: Any) -> Tolerance:
        """Return the error that a value means: a length, or a text with a length and a measure such as "2mm:p95"."""
        if not (isinstance(given, str) and ":" in given):
            return cls(Length.of("tolerance", given), None)
        length, _, word = given.rpartition(":")
        measure = next((each for each in MEASURES if each == word.strip()), None)
        if measure is None:
            known = " or ".join(f":{each}" for each in MEASURES)
            raise ParameterError(f"expected tolerance to end in {known}, found {shown(given)}")
        return cls(Length.of("tolerance", length), measure)


@dataclass(frozen=True)
class Amount:
    """What decides how many points are kept: one of the first four, or `max_gap`, or both."""

    ratio: float | None
    n_points: int | None
    tolerance: Tolerance | None = None
    spacing: Length | None = None
    max_gap: Length | None = None

    @classmethod
    def of(
        cls,
        ratio: float | str | None,
        n_points: int | str | None,
        tolerance: float | str | None = None,
        spacing: float | str | None = None,
        max_gap: float | str | None = None,
    ) -> Amount:
        """Check the arguments of `gppcs.simplify` with these names."""
        given = {"ratio": ratio, "n_points": n_points, "tolerance": tolerance, "spacing": spacing}
        lacking = (ratio is None) + (n_points is None) + (tolerance is None) + (spacing is None)
        if lacking < 3 or (lacking == 4 and max_gap is None):
            raise _not_one([name for name, value in given.items() if value is not None])
        return cls(
            None if ratio is None else share_of("ratio", ratio),
            None if n_points is None else count_of("n_points", n_points),
            None if tolerance is None else Tolerance.of(tolerance),
            None if spacing is None else Length.of("spacing", spacing),
            None if max_gap is None else Length.of("max_gap", max_gap),
        )

    @property
    def lengths(self) -> tuple[Length | None, ...]:
        """What is given as lengths."""
        return (self.tolerance.length if self.tolerance else None, self.spacing, self.max_gap)

    def known_count(self, n: int) -> int | None:
        """Return M if the number N of points already tells it."""
        if self.ratio is not None:
            return max(1, round(self.ratio * n))
        return None if self.n_points is None else min(self.n_points, n)


def _not_one(names: list[str]) -> ParameterError:
    """Return the error for none or several of the arguments of which one is expected."""
    if set(names) <= {"ratio", "n_points"}:
        found = "both" if names else "neither"
        more = "" if names else "; or give a tolerance, a spacing or a largest gap"
        return ParameterError(f"expected either a ratio or a number of points, found {found}{more}")
    return ParameterError(f"expected one of ratio, n_points, tolerance and spacing, found {' and '.join(names)}")


class Scale(NamedTuple):
    """How lengths that somebody asks for become lengths in the coordinates of a method."""

    diagonal: float  # Of the bounding box, in the coordinates of the method
    metres: float | None  # The unit of the cloud in metres, if it is known
    exponent: int  # The unit of the method's coordinates is two to this power, in the unit of the cloud

    def inside(self, length: Length) -> float:
        """Return a length in the coordinates of the method."""
        with np.errstate(over="ignore", under="ignore"):
            scaled = float(np.ldexp(length.in_cloud(self.outside(self.diagonal), self.metres), -self.exponent))
        return min(max(scaled, SHORTEST), LONGEST)

    def outside(self, length: float) -> float:
        """Return a length in the unit of the cloud, given in that of the method."""
        with np.errstate(over="ignore", under="ignore"):
            return float(np.ldexp(length, self.exponent))


def metres_of(unit: Any, header: Header | None) -> float | None:
    """Return the unit of the coordinates in metres: the named one, or that of the header; None if neither tells."""
    if unit is None:
        return header.metres if header else None
    if not (isinstance(unit, str) and unit in METRES):
        raise ParameterError(f"expected the name of a unit of length, found {shown(unit)}{nearest_name(unit, METRES)}")
    return METRES[unit]


def name_of_unit(metres: float) -> str:
    """Return the name of a unit of length, such as "ft", or its length in metres, such as "0.9144 m"."""
    return next((name for name, each in METRES.items() if math.isclose(each, metres, rel_tol=1e-7)), f"{metres:g} m")


def unit_of(header: Header | None, unit: str | None = None) -> str | None:
    """Return the name of the unit of the coordinates: the one that is given, or that of the header, if it tells it."""
    return unit or (name_of_unit(header.metres) if header and header.metres else None)
