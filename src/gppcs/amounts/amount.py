"""The class `Amount`: what decides how many points are kept."""

from __future__ import annotations

from dataclasses import dataclass

from gppcs.clouds.quantities import Length, Tolerance, count_of, option, share_of
from gppcs.errors import ParameterError


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
    expected = "expected one of"
    return ParameterError(
        f"{expected} ratio, n_points, tolerance and spacing, found {' and '.join(names)}",
        command=f"{expected} --ratio, --points, --tolerance and --spacing, found {' and '.join(map(option, names))}",
    )
