"""The options that say how many points to keep, and the numbers that people write for them, such as 3% and 5k."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Annotated

import typer

from gppcs.amounts.accuracy import Measure
from gppcs.app import panels
from gppcs.errors import ParameterError, shown
from gppcs.methods import METHODS

Ratio = Annotated[
    str | None,
    typer.Option(
        metavar="SHARE",
        help="Share of the points to keep, above 0 and at most 1, such as 0.03 or 3%. Or give --points.",
        rich_help_panel=panels.SIZE,
    ),
]
Points = Annotated[
    str | None,
    typer.Option(
        metavar="M",
        help="Number of points to keep, such as 5000, 5,000, 5k or 1.5M. Or give --ratio.",
        rich_help_panel=panels.SIZE,
    ),
]
Tolerance = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Keep the fewest points whose local surface misses the original by at most this: 0.5 (in the unit of the "
        "coordinates), 0.5mm, or 0.02% of the diagonal. In place of --points.",
        rich_help_panel=panels.SIZE,
    ),
]
ErrorMeasure = Annotated[
    Measure | None,
    typer.Option(
        help="Which error --tolerance means: 95 % of the points are as near as that (p95), or the mean, the root mean "
        "square or the largest distance.",
        show_default="p95",
        rich_help_panel=panels.SIZE,
    ),
]
Spacing = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Keep as many points as have this spacing: 0.05, 5cm or 1%. In place of --points. "
        + " ".join(
            f"{name}: {known.supports['spacing']}" for name, known in METHODS.items() if "spacing" in known.supports
        ),
        rich_help_panel=panels.SIZE,
    ),
]
MaxGap = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Add points until no original point is farther than this from a kept one. Alone or with --points and so "
        "on.",
        rich_help_panel=panels.SIZE,
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Unit of the coordinates, such as m or mm, for lengths with a unit. By default, the coordinate system of "
        "the input tells it.",
        rich_help_panel=panels.SIZE,
    ),
]

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_MOST = 10**18  # of a number: more than any machine holds, and few enough digits to compute with
_COUNT = re.compile(
    r"(?P<whole>[+-]?(\d{1,3}(,\d{3})+|\d+(_\d+)*))?(?P<part>\.\d*)?(?P<power>[eE][+-]?\d{1,3})? ?(?P<unit>[kKmMgG]?)",
    re.ASCII,
)
_SHARE = re.compile(r"0?\.\d*|.*%", re.ASCII)  # what cannot be a number of points
_PERCENT = re.compile(r"(?P<number>[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?) ?%", re.ASCII)


def count_of(text: str, option: str = "--points") -> int:
    """Return the number of points, or of something else, that a text means."""
    found = _COUNT.fullmatch(text.strip())
    digits = found and f"{found['whole'] or ''}{found['part'] or ''}".replace(",", "").replace("_", "")
    if not found or not digits or not any(map(str.isdigit, digits)):
        hint = "; for a share of the points use --ratio" if text.strip().endswith("%") else ""
        raise ParameterError(
            f"expected {option} to be a whole number, such as 5000, 5,000, 5k or 1.5M, found {shown(text)}{hint}"
        )
    value = Fraction(digits + (found["power"] or "")) * _UNITS[found["unit"].lower()]
    if value.denominator != 1 or abs(value) > _MOST:
        raise ParameterError(f"expected {option} to be a whole number of at most 1e18, found {shown(text)}")
    return value.numerator


def is_share(text: str) -> bool:
    """Tell whether a size, which may be a number of points or a share of them, is written as a share."""
    return _SHARE.fullmatch(text.strip()) is not None


def share_of(text: str, option: str = "--ratio", hint: str = "for a number of points use --points") -> float:
    """Return the share that a text means."""
    percent = _PERCENT.fullmatch(text.strip())
    try:
        return float(Fraction(percent["number"]) / 100) if percent else float(text)
    except (ValueError, OverflowError):
        raise ParameterError(
            f"expected {option} to be a number, such as 0.03 or 3%, found {shown(text)}; {hint}"
        ) from None
