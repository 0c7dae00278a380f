"""The class `Amount`: what decides how many points are kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gppcs.amounts.accuracy import MEASURES, Measure
from gppcs.clouds.lengths import Length, option
from gppcs.errors import ParameterError, one_of, share, whole_number


@dataclass(frozen=True)
class Amount:
    """What decides how many points are kept. One of the first four is given, or `max_gap`, or both.

    Attributes
    ----------
    ratio : float or None
        M / N.
    n_points : int or None
        M.
    tolerance : Length or None
        The largest error.
    spacing : Length or None
    max_gap : Length or None
        The largest distance from an original point to a kept one.
    measure : str
        Which error is meant.
    """

    ratio: float | None
    n_points: int | None
    tolerance: Length | None = None
    spacing: Length | None = None
    max_gap: Length | None = None
    measure: Measure = "p95"

    @classmethod
    def of(
        cls,
        ratio: float | None,
        n_points: int | None,
        tolerance: float | str | None = None,
        spacing: float | str | None = None,
        max_gap: float | str | None = None,
        measure: str | None = None,
    ) -> Amount:
        """Check the arguments of `gppcs.simplify` with these names."""
        given = {"ratio": ratio, "n_points": n_points, "tolerance": tolerance, "spacing": spacing}
        names = [name for name, value in given.items() if value is not None]
        if len(names) > 1 or not (names or max_gap is not None):
            raise _not_one(names)
        if measure is not None and tolerance is None:
            expected = "a tolerance together with"
            raise ParameterError(f"expected {expected} measure", command=f"expected {expected} --measure")
        part = None if ratio is None else share(ratio)
        if n_points is not None:
            n_points = whole_number("the number of points", n_points, 1)
        lengths = {"tolerance": tolerance, "spacing": spacing, "max_gap": max_gap}
        known: dict[str, Any] = {
            name: None if value is None else Length.of(name, value) for name, value in lengths.items()
        }
        chosen: Any = one_of("measure", "p95" if measure is None else measure, MEASURES)
        return cls(part, n_points, **known, measure=chosen)

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
    expected = "expected one of"
    return ParameterError(
        f"{expected} ratio, n_points, tolerance and spacing, found {' and '.join(names)}",
        command=f"{expected} --ratio, --points, --tolerance and --spacing, found {' and '.join(map(option, names))}",
    )
