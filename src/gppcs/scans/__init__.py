"""Synthetic sample scans whose surfaces and normals are known exactly: objects, and scenes that a sensor measures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.columns import COLOUR
from gppcs.errors import ParameterError, nearest_name, number, shown, whole_number
from gppcs.scans.bracket import BRACKET
from gppcs.scans.case import CASE
from gppcs.scans.fan import FAN
from gppcs.scans.gears import GEARS
from gppcs.scans.horse import HORSE
from gppcs.scans.medallion import MEDALLION
from gppcs.scans.moth import MOTH
from gppcs.scans.painted import FRESCO, PAINTED, ROAD
from gppcs.scans.patch import Patch, Scan, SurfacePoints
from gppcs.scans.plant import PLANT
from gppcs.scans.plate import PLATE
from gppcs.scans.scenes.room import ROOM
from gppcs.scans.scenes.scene import Scene
from gppcs.scans.scenes.street import STREET
from gppcs.scans.scenes.terrain import TERRAIN
from gppcs.scans.scenes.wood import FOREST, PLOT
from gppcs.scans.sphere import SPHERE
from gppcs.scans.statue import STATUE

__all__ = ["SCANS", "SCENES", "Patch", "Scan", "Scene", "SurfacePoints", "sample"]

SCANS: dict[str, Scan] = {
    "medallion": MEDALLION, "bracket": BRACKET, "fan": FAN, "statue": STATUE, "sphere": SPHERE, "painted": PAINTED,
    "fresco": FRESCO, "road": ROAD, "horse": HORSE, "moth": MOTH, "case": CASE, "plate": PLATE, "gears": GEARS,
    "plant": PLANT,
}  # fmt: skip
SCENES: dict[str, Scene] = {
    "room": ROOM, "street": STREET, "terrain": TERRAIN, "forest": FOREST, "plot": PLOT,
}  # fmt: skip


def sample(
    name: str,
    n_points: int = 200_000,
    noise: float = 0.0,
    outliers: float = 0.0,
    uneven: float = 0.0,
    seed: int = 0,
) -> PointCloud:
    """Return a synthetic scan, whose surface is known exactly.

    The objects are about 100 mm long: a medallion, a bracket, a fan, a statue, a sphere, a horse, a moth with thin
    wings, a case with ribs and holes, a bent plate, gears and a plant in a pot. The detail of three others is no shape:
    "painted" is the statue with colours, "fresco" a wall of 4 m with a picture, "road" 20 m of a road with markings.
    Points of objects are random on the surface, in random order. The scenes are what a sensor sees from its place, with
    its noise and with shadows, in the order of its measurements: a room (4 m, by a depth camera), a street (60 m, by a
    LiDAR on a car), a terrain (120 m, from the air), and a wooded slope (50 m), as a "forest" from a drone and as a
    "plot" from two tripods on the ground.

    Parameters
    ----------
    name : str
        "medallion", "bracket", "fan", "statue", "sphere", "horse", "moth", "case", "plate", "gears", "plant",
        "painted", "fresco", "road", "room", "street", "terrain", "forest" or "plot".
    n_points : int
        Number of points, outliers included; at least 1.
    noise : float
        Standard deviation of the Gaussian noise on each coordinate, as a fraction of the bounding box's diagonal. It is
        added to the noise of a scene's sensor.
    outliers : float
        Fraction of the points that are outliers, from 0 to below 1. Outliers are uniform in the bounding box, enlarged
        1.5 times about its centre. Their number is rounded.
    uneven : float
        Loss of density along x, from 0 to 0.999, of an object: at the highest x, the density is 1 - `uneven` times that
        at the lowest x. It falls as 1 / distance², as if from a scanner in front of the low end. With 0, points are
        uniform by area. The density of a scene is that of its sensor.
    seed : int
        The same arguments and seed give the same cloud. At least 0.

    Returns
    -------
    PointCloud
        Points in millimetres, of scenes in metres, exact in float32, with these attributes: `nx`, `ny`, `nz`, the unit
        normal (float32), which points outward or to the sensor; `red`, `green`, `blue` (uint8); and, if there are
        outliers, `outlier` (uint8, 0 or 1). Objects have `curvature`, the mean curvature in 1/mm (float32), positive
        where the surface bulges outward: 1/r on a sphere of radius r. The road has noisy `intensity` (uint16), and
        `marking` (uint8, 0 or 1). Scenes have `classification`, the code of the LAS
        specification (uint8): 2 ground, 5 high vegetation, 6 building, 7 outlier, 11 road, 14 wire, 15 pole or pylon,
        and 64 for everything else. A noisy point keeps the normal and the curvature of its place on the surface. Both
        are zero for outliers. Leaves have no surface: their normal is zero.

    Raises
    ------
    ParameterError
        If the name is unknown, a number is outside its range, or `uneven` is given for a scene.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000, noise=0.001, seed=3)
    >>> cloud.points.shape
    (1000, 3)
    """
    scan = _checked(name, n_points, noise, outliers, uneven, seed)
    rng = np.random.default_rng(seed)
    attributes: dict[str, NDArray[Any]]
    if isinstance(scan, Scene):
        points, normals, colours, classification = scan.scan(n_points, rng)
        attributes = {"classification": classification}
        lower, upper = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    else:
        points, normals, curvature, colours = _on_surface(scan, n_points, uneven, rng)
        attributes = {"curvature": curvature}
        lower, upper = np.array(scan.box)
    attributes = {
        **dict(zip(NORMALS, normals.T, strict=True)),
        **attributes,
        **dict(zip(COLOUR, colours.T, strict=True)),
    }
    if isinstance(scan, Scan) and scan.paint:
        attributes |= scan.paint(points.astype(np.float64), rng)
    if noise > 0.0:
        sigma = noise * float(np.linalg.norm(upper - lower))
        points += (sigma * rng.standard_normal(points.shape)).astype(np.float32)
    if outliers > 0.0:
        stray = rng.permutation(n_points)[: round(outliers * n_points)]
        half = 1.5 * (upper - lower) / 2.0
        points[stray] = (lower + upper) / 2.0 + rng.uniform(-half, half, (len(stray), 3))
        attributes["outlier"] = np.zeros(n_points, np.uint8)
        for attribute, values in attributes.items():
            # Without a surface, grey, and of the class of noise in the LAS specification.
            values[stray] = {**dict.fromkeys(COLOUR, 128), "classification": 7, "outlier": 1}.get(attribute, 0)
    return PointCloud(points.astype(np.float64), attributes, np.dtype(np.float32))


def _checked(name: str, n_points: int, noise: float, outliers: float, uneven: float, seed: int) -> Scan | Scene:
    """Return the scan of that name, or raise a ParameterError that names the wrong argument."""
    samples: dict[str, Scan | Scene] = {**SCANS, **SCENES}
    if not isinstance(name, str) or name not in samples:
        raise ParameterError(f"expected the name of a sample scan, found {shown(name)}{nearest_name(name, samples)}")
    count = whole_number("the number of points", n_points, 1)
    whole_number("the seed", seed, 0)
    # An array of more points is beyond the range of its size. About the root of 1 - uneven of the drawn points is kept.
    max_points, max_uneven = 10**17, 0.999 if name in SCANS else 0.0
    for value, is_valid, expected in (
        (n_points, count <= max_points, f"at most {max_points:,} points"),
        (noise, 0.0 <= number(noise) < np.inf, "noise as a fraction of the diagonal, 0 or more"),
        (outliers, 0.0 <= number(outliers) < 1.0, "outliers from 0 to below 1"),
        (uneven, 0.0 <= number(uneven) <= max_uneven, f"uneven from 0 to {max_uneven:g} for {name}"),
    ):
        if not is_valid:
            raise ParameterError(f"expected {expected}, found {shown(value)}")
    return samples[name]


def _on_surface(
    scan: Scan, n_points: int, uneven: float, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Draw points by rejection sampling: points (N, 3), normals (N, 3), curvature (N,), colours (N, 3)."""
    points, normals = np.empty((n_points, 3), np.float32), np.empty((n_points, 3), np.float32)
    curvature, colours = np.empty(n_points, np.float32), np.empty((n_points, 3), np.uint8)
    # Proposals in proportion to the upper bounds of the areas make the accepted points uniform over all patches.
    weights = np.array([patch.weight for patch in scan.patches])
    # A scanner at such a distance from the low end of x makes the density at the far end 1 - uneven of the highest.
    growth, start, end = 1.0 / np.sqrt(1.0 - uneven) - 1.0, scan.box[0][0], scan.box[1][0]
    filled = 0
    while filled < n_points:
        # At most so many at once that their derivatives stay in the CPU cache.
        proposed = rng.multinomial(min(32_768, 64 + 4 * (n_points - filled)), weights / weights.sum())
        by_patch = [patch.draw(count, rng) for patch, count in zip(scan.patches, proposed, strict=True)]
        drawn = SurfacePoints(*map(np.concatenate, zip(*by_patch, strict=True)))
        order = rng.permutation(len(drawn.points))
        density = (1.0 + growth * (drawn.points[order, 0] - start) / (end - start)) ** -2.0
        order = order[rng.uniform(0.0, 1.0, len(order)) < density]
        order = order[: n_points - filled]
        new = slice(filled, filled + len(order))
        points[new], normals[new], curvature[new] = (values[order] for values in drawn[:3])
        base = np.repeat([patch.colour for patch in scan.patches], [len(part.points) for part in by_patch], axis=0)
        # Hollows are darker and ridges brighter, like the patina of a used object.
        lightness = 1.0 + 0.3 * np.tanh(2.0 * curvature[new])
        colours[new] = np.clip(base[order] * lightness[:, None], 0.0, 255.0)
        filled += len(order)
    return points, normals, curvature, colours
