"""The class `Header`: what a file says of a whole cloud."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence

from gppcs.engine.equality import ComparedByValue
from gppcs.spatial.units import Units


class Header(ComparedByValue):
    """What a file says of a whole cloud, besides its points: comments, a coordinate system, the scale of integers.

    Each format that has such things derives a class, reads an object of it, and writes it again.
    """

    @property
    def crs(self) -> str | None:
        """The coordinate reference system, by its name or code; None if it is not known."""
        return None

    @property
    def units(self) -> Units | None:
        """The units of the axes, if the coordinate system tells them; None if they are not known."""
        return None

    @property
    def decimals(self) -> Sequence[int] | None:
        """The digits after the point that x, y and z have in the file, if it says so."""
        return None

    @property
    def conventions(self) -> Mapping[str, str]:
        """How the values of attributes are to be read, in words. Clouds that differ in it cannot be one cloud."""
        return {}

    @abstractmethod
    def contents(self) -> list[str]:
        """Return in words what other formats leave out of the header; empty if nothing is lost without it."""
