"""The units of the axes of a cloud, and the factors that bring all axes to one unit."""

import math
from typing import NamedTuple

import numpy as np

from gppcs.engine.arrays import Floats

EQUATOR, SQUARED_ECCENTRICITY = 6378137.0, 0.00669437999014  # of the ellipsoid WGS 84: the radius in metres, and e^2


class Units(NamedTuple):
    """The units of the axes of a cloud. Distances are measured in `length`."""

    horizontal: float  # of x and y: in metres, or in radians if they are longitude and latitude
    vertical: float  # of z, in metres
    is_geographic: bool = False

    @property
    def length(self) -> float:
        """The unit of distances in metres: that of x and y, or the metre if these are angles."""
        return 1.0 if self.is_geographic else self.horizontal

    @property
    def is_mixed(self) -> bool:
        """Whether the axes have different units."""
        return self.is_geographic or not math.isclose(self.horizontal, self.vertical, rel_tol=1e-7)

    def are_angles(self, lower: Floats, upper: Floats) -> bool:
        """Return whether x and y of a bounding box, whose corners are (3,), can be longitude and latitude."""
        angles = self.horizontal * np.maximum(np.abs(lower), np.abs(upper))
        return bool(angles[0] <= 2.001 * math.pi and angles[1] <= 0.501 * math.pi)

    def factors(self, lower: Floats, upper: Floats) -> Floats:
        """Return the factors, (3,), that bring coordinates in a bounding box, whose corners are (3,), to `length`.

        Those of angles are the lengths of a radian at the middle latitude of the box: a local tangent plane. Numbers
        that cannot be angles are taken as lengths.
        """
        if not self.is_mixed or (self.is_geographic and not self.are_angles(lower, upper)):
            return np.ones(3)
        if not self.is_geographic:
            return np.array([1.0, 1.0, self.vertical / self.horizontal])
        latitude = self.horizontal * (lower[1] + upper[1]) / 2.0
        flattening = 1.0 - SQUARED_ECCENTRICITY * math.sin(latitude) ** 2
        across = EQUATOR / math.sqrt(flattening)  # radius of curvature in the prime vertical
        along = across * (1.0 - SQUARED_ECCENTRICITY) / flattening  # in the meridian
        return np.array([self.horizontal * across * math.cos(latitude), self.horizontal * along, self.vertical])
