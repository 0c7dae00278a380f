"""The option `--levels`: simplifications to several sizes at once, of which each is the start of the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gppcs.clouds.quantities import size_of
from gppcs.errors import ParameterError, shown

NAME = "level"  # of the attribute, and of the field in the names of files
MOST = 256  # levels that the attribute can tell apart


@dataclass(frozen=True)
class Levels:
    """The sizes, from coarse to fine; either shares or numbers of points."""

    sizes: tuple[float, ...]
    are_shares: bool

    @classmethod
    def of(cls, text: str) -> Levels:
        """Read the value of `--levels`."""
        words = [word.strip() for word in text.split(",")]
        if len(words) > MOST:
            raise ParameterError(f"expected --levels with at most {MOST} sizes, found {len(words)}")
        sizes = {size_of("levels", word) for word in words}
        are_shares = [size < 1 for size in sizes]
        if any(are_shares) != all(are_shares):
            raise ParameterError(f"expected --levels with shares or with numbers, found both in {shown(text)}")
        if len(sizes) < len(words):
            raise ParameterError(
                f"expected --levels with different sizes below all points, such as 10%,3%,1%, found {shown(text)}"
            )
        return cls(tuple(sorted(sizes)), all(are_shares))

    @property
    def finest(self) -> dict[str, Any]:
        """The arguments of `gppcs.simplify` for the finest level."""
        return {"ratio": self.sizes[-1]} if self.are_shares else {"n_points": round(self.sizes[-1])}

    def counts(self, kept: int) -> list[int]:
        """Return the number of points of each level."""
        scale = kept / self.sizes[-1] if self.are_shares else 1.0
        return [min(max(1, round(size * scale)), kept) for size in self.sizes]
