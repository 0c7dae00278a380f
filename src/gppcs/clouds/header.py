"""The class `Header`: what a file says of a whole cloud."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

from gppcs.engine.equality import ComparedByValue


class Header(ComparedByValue):
    """What a file says of a whole cloud, besides its points: comments, a coordinate system, the scale of integers.

    Each format that has such things derives a class, reads an object of it, and writes it again.
    """

    @property
    def crs(self) -> str | None:
        """The coordinate reference system, by its name or code; None if it is not known."""
        return None

    @property
    def metres(self) -> float | None:
        """The unit of the coordinates in metres, if the coordinate system tells it; None if it is not known."""
        return None

    @property
    def conventions(self) -> Mapping[str, str]:
        """How the values of attributes are to be read, in words. Clouds that differ in it cannot be one cloud."""
        return {}

    @abstractmethod
    def contents(self) -> list[str]:
        """Return in words what other formats leave out of the header; empty if nothing is lost without it."""
