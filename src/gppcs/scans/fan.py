"""The ducted fan: a closed solid of thin swept blades between a hub and a thin ring.

A blade is a sheet like a helicoid, z = camber(φ) ± half its thickness. Here φ is the angle around the axis minus the
sweep, which grows with the radius. Lengths are in millimetres.
"""

import numpy as np

from gppcs.engine.arrays import Flags, Floats
from gppcs.scans.jets import Jet
from gppcs.scans.patch import Patch, Scan, turned, zone

BLADES = 7
BLADE_STEP = 2.0 * np.pi / BLADES  # radians from one blade to the next
HUB, HUB_HALF, BORE, BORE_TOP = 14.0, 10.0, 5.0, 4.0  # radius and half height of the hub, radius and top of its bore
DUCT_INNER, DUCT_OUTER, DUCT_HALF = 47.5, 50.0, 9.0  # radii and half height of the ring
HALF_CHORD = 0.33  # half the angle that a blade covers, in radians
HALF_THICKNESS = 1.0  # half the thickness of a blade
PITCH, CAMBER = 18.0, 10.0  # mm per radian, mm per radian²
SWEEP = 0.45  # angle in radians by which the tip of a blade lags behind its root

BRASS, GRAPHITE, TEAL = (205, 165, 85), (88, 96, 108), (70, 146, 150)


def _sweep(r: Jet) -> Jet:
    return ((r - HUB) * (1.0 / (DUCT_INNER - HUB))).squared() * SWEEP


def _blade(number: int) -> list[Patch]:
    turn = number * BLADE_STEP

    def sheet(offset: float, side: int) -> Patch:
        def surface(r: Jet, phi: Jet) -> tuple[Jet, Jet, Jet]:
            angle = _sweep(r) + phi + turn
            return r * angle.cos(), r * angle.sin(), phi * PITCH + phi.squared() * CAMBER + offset

        return Patch(surface, (HUB, DUCT_INNER), (-HALF_CHORD, HALF_CHORD), sheet_stretch, TEAL, side)

    def edge(at: float, side: int) -> Patch:
        bottom = PITCH * at + CAMBER * at**2 - HALF_THICKNESS

        def surface(r: Jet, up: Jet) -> tuple[Jet, Jet, Jet]:
            angle = _sweep(r) + (at + turn)
            return r * angle.cos(), r * angle.sin(), up + bottom

        return Patch(surface, (HUB, DUCT_INNER), (0.0, 2.0 * HALF_THICKNESS), edge_stretch, TEAL, side)

    # These slopes grow with the radius, so the area elements are largest at the tip of the blade.
    steepest_sweep = 2.0 * SWEEP / (DUCT_INNER - HUB)
    steepest_camber = PITCH + 2.0 * CAMBER * HALF_CHORD
    skew = 1.0 + (DUCT_INNER * steepest_sweep) ** 2
    sheet_stretch = float(np.sqrt(DUCT_INNER**2 + steepest_camber**2 * skew))
    edge_stretch = float(np.sqrt(skew))
    return [sheet(HALF_THICKNESS, 1), sheet(-HALF_THICKNESS, -1), edge(-HALF_CHORD, 1), edge(HALF_CHORD, -1)]


def _between_blades(z: Floats, swept_back: Floats) -> Flags:
    phi = swept_back - np.round(swept_back / BLADE_STEP) * BLADE_STEP  # from the middle of the nearest blade
    return (np.abs(phi) > HALF_CHORD) | (np.abs(z - PITCH * phi - CAMBER * phi**2) > HALF_THICKNESS)


def _hub_and_duct() -> list[Patch]:
    axis = (0.0, 0.0)

    def hub_free(fraction: Floats, angle: Floats) -> Flags:
        return _between_blades(HUB_HALF - 2.0 * HUB_HALF * fraction, angle)

    def duct_free(fraction: Floats, angle: Floats) -> Flags:
        return _between_blades(2.0 * DUCT_HALF * fraction - DUCT_HALF, angle - SWEEP)

    return [
        zone(HUB, HUB_HALF, (0.0, 1.0), (0.0, 2.0 * np.pi), BRASS),
        turned(2, axis, (HUB, HUB_HALF), (HUB, -HUB_HALF), GRAPHITE, trim=hub_free),
        turned(2, axis, (HUB, -HUB_HALF), (BORE, -HUB_HALF), GRAPHITE),
        turned(2, axis, (BORE, -HUB_HALF), (BORE, BORE_TOP), BRASS),
        turned(2, axis, (BORE, BORE_TOP), (0.0, BORE_TOP), BRASS),
        turned(2, axis, (DUCT_INNER, -DUCT_HALF), (DUCT_INNER, DUCT_HALF), GRAPHITE, trim=duct_free),
        turned(2, axis, (DUCT_INNER, DUCT_HALF), (DUCT_OUTER, DUCT_HALF), GRAPHITE),
        turned(2, axis, (DUCT_OUTER, DUCT_HALF), (DUCT_OUTER, -DUCT_HALF), GRAPHITE),
        turned(2, axis, (DUCT_OUTER, -DUCT_HALF), (DUCT_INNER, -DUCT_HALF), GRAPHITE),
    ]


FAN = Scan(
    (*_hub_and_duct(), *(patch for number in range(BLADES) for patch in _blade(number))),
    ((-DUCT_OUTER, -DUCT_OUTER, -HUB_HALF), (DUCT_OUTER, DUCT_OUTER, HUB_HALF + HUB)),
)
