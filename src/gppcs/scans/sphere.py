"""The sphere: smooth everywhere, with the same curvature everywhere; in millimetres."""

import numpy as np

from gppcs.scans.jets import Jet
from gppcs.scans.patch import Patch, Scan

RADIUS = 50.0


def _surface(t: Jet, angle: Jet) -> tuple[Jet, Jet, Jet]:
    # The area is uniform in height and angle (Archimedes).
    ring = (1.0 - t.squared()).sqrt() * RADIUS
    return ring * angle.cos(), ring * angle.sin(), t * RADIUS


SPHERE = Scan(
    # The area element is R²; rounding can lift it slightly above.
    (Patch(_surface, (-1.0, 1.0), (-np.pi, np.pi), RADIUS**2 * (1.0 + 1e-9), (120, 160, 190), -1),),
    ((-RADIUS, -RADIUS, -RADIUS), (RADIUS, RADIUS, RADIUS)),
)
