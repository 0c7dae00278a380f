"""The training set of the learned methods: 12 kinds of procedural shapes, made from a seed when they are needed.

A shape is a union of parts: lathed and extruded solids, stretched and turned, and the patches of the sample scans.
Points are random on the surface, uniform by area; those inside another part are dropped, those where two parts touch,
as the top of a leg under a seat, stay. Normals are exact. Any number of points can be drawn: training draws 2,048 of
each shape and takes 1,024 of these at once, sizes.py draws up to 100,000.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gppcs.scans.jets import Jet
from gppcs.scans.patch import Patch, flat, turned
from scans import SCANS

PER_KIND = 84  # shapes of each kind
GREY = (128, 128, 128)
AROUND = 16  # segments of a profile or an outline that is round
Array = NDArray[np.float64]
Random = np.random.Generator
Uniform = Callable[..., Any]  # draws a number between two


@dataclass(frozen=True)
class Part:
    """Patches that were stretched and turned by a matrix, (3, 3), then shifted; and where its inside is."""

    patches: tuple[Patch, ...]
    inside: Callable[[Array], NDArray[np.bool_]]
    matrix: Array
    shift: Array

    def by(self, *scale: float, at: Sequence[float] = (0, 0, 0), turn: float = 0.0, lean: float = 0.0) -> Part:
        """Return the part scaled along its axes, leant about y, turned about z, then shifted."""
        c, s, d, t = np.cos(turn), np.sin(turn), np.cos(lean), np.sin(lean)
        matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[d, 0, t], [0, 1, 0], [-t, 0, d]])
        if scale:
            matrix = matrix @ np.diag(np.broadcast_to(scale, 3))
        return replace(self, matrix=matrix @ self.matrix, shift=matrix @ self.shift + at)

    @property
    def bound(self) -> float:
        """Upper bound of the factor by which the matrix enlarges areas."""
        values = np.linalg.svd(self.matrix, compute_uv=False)
        return float(values[0] * values[1])

    def draw(self, count: int, rng: Random) -> tuple[Array, Array]:
        """Draw at most so many points, (n, 3), uniform by area, with their normals, (n, 3)."""
        weights = np.array([patch.weight for patch in self.patches])
        counts = rng.multinomial(count, weights / weights.sum())
        drawn = [patch.draw(each, rng) for patch, each in zip(self.patches, counts, strict=True)]
        points, normals = (np.concatenate([values[column] for values in drawn]) for column in (0, 1))
        normals = normals @ np.linalg.inv(self.matrix)
        lengths = np.linalg.norm(normals, axis=1)
        kept = rng.uniform(0, self.bound, len(points)) < abs(np.linalg.det(self.matrix)) * lengths
        return points[kept] @ self.matrix.T + self.shift, normals[kept] / lengths[kept, None]

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Return which points, (n, 3), are inside."""
        return self.inside((points - self.shift) @ np.linalg.inv(self.matrix).T)


def in_polygon(x: Array, y: Array, corners: Array) -> NDArray[np.bool_]:
    """Return which points, (n,) x and y, lie in a polygon with corners, (k, 2), by crossings of a ray."""
    inside = np.zeros(len(x), dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 != y1:
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return inside


def lathe(*profile: tuple[float, float]) -> Part:
    """Return the solid of revolution about z of a profile of (radius, z), from its top down the outside."""
    corners = np.array(profile, dtype=float)
    ends = zip(profile, (*profile[1:], profile[0]), strict=True)
    patches = tuple(turned(2, (0, 0), a, b, GREY) for a, b in ends if a != b and a[0] + b[0] > 0)
    return Part(patches, lambda p: in_polygon(np.hypot(p[:, 0], p[:, 1]), p[:, 2], corners), np.eye(3), np.zeros(3))


def ball() -> Part:
    """Return a sphere of radius 1 about the origin."""
    angles = np.linspace(0, np.pi, AROUND + 1)
    return lathe((0, 1), *((float(np.sin(t)), float(np.cos(t))) for t in angles[1:-1]), (0, -1))


def ring(radius: float, thickness: float) -> Part:
    """Return a torus about z."""
    angles = -np.arange(AROUND) / AROUND * 2 * np.pi
    return lathe(*((float(radius + thickness * np.cos(t)), float(thickness * np.sin(t))) for t in angles))


def rod(radius: float, length: float, end: float = 1.0) -> Part:
    """Return a cylinder or cone from the origin up; `end` is the radius at its top as a share."""
    return lathe((0, length), (radius * end, length), (radius, 0), (0, 0))


def prism(corners: Sequence[tuple[float, float]], height: float) -> Part:
    """Return an extruded polygon, whose corners go round counterclockwise, from z = 0 to its height."""
    outline = np.array(corners, dtype=float)
    (low_x, low_y), (high_x, high_y) = outline.min(axis=0), outline.max(axis=0)
    caps = [
        flat(2, z, (low_x, high_x), (low_y, high_y), side, GREY, lambda x, y: in_polygon(x, y, outline))
        for z, side in ((0.0, -1), (height, 1))
    ]
    walls = [_wall(start, end, height) for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True)]

    def inside(points: Array) -> NDArray[np.bool_]:
        between = (points[:, 2] > 0) & (points[:, 2] < height)
        return between & in_polygon(points[:, 0], points[:, 1], outline)

    return Part((*caps, *walls), inside, np.eye(3), np.zeros(3))


def _wall(start: Array, end: Array, height: float) -> Patch:
    (x, y), (dx, dy) = start, end - start

    def surface(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        return u * float(dx) + float(x), u * float(dy) + float(y), v

    return Patch(surface, (0, 1), (0, height), float(np.hypot(dx, dy)), GREY)


def box(x: float, y: float, z: float) -> Part:
    """Return a box that stands on the middle of its bottom."""
    return prism([(-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2)], z)


def _nowhere(points: Array) -> NDArray[np.bool_]:
    return np.zeros(len(points), dtype=bool)


def scanned(name: str) -> Part:
    """Return a sample scan, about of size 1."""
    return Part(SCANS[name].patches, _nowhere, np.eye(3) / 100, np.zeros(3))


def hills(rng: Random, height: float, waves: int) -> Part:
    """Return a relief over a square of side 2: a sum of waves."""
    steps = rng.uniform(-7, 7, (waves, 2))
    phases, heights = rng.uniform(0, 7, waves), height * rng.uniform(0.3, 1, waves)

    def surface(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        z = u * 0.0
        for (along, across), phase, size in zip(steps, phases, heights, strict=True):
            z = z + (u * float(along) + v * float(across) + float(phase)).sin() * float(size)
        return u, v, z

    steepest = float((np.linalg.norm(steps, axis=1) * heights).sum())
    patch = Patch(surface, (-1, 1), (-1, 1), float(np.hypot(1, steepest)), GREY)
    return Part((patch,), _nowhere, np.eye(3), np.zeros(3))


def _clamps(u: Uniform, rng: Random) -> list[Part]:
    w, d, h, t = u(0.8, 1.6), u(0.5, 1), u(0.4, 1), u(0.06, 0.16)
    ribs = [box(t, d / 2, h / 2).by(at=(x, 0, t)) for x in np.linspace(-w / 3, w / 3, rng.integers(0, 4))]
    bosses = [rod(u(0.06, 0.12), u(0.1, 0.3)).by(at=(x, -d / 3, t)) for x in (-w / 3, w / 3)]
    return [box(w, d, t), box(w, t, h).by(at=(0, d / 2 - t / 2, 0)), *ribs, *bosses]


def _shafts(u: Uniform, rng: Random) -> list[Part]:
    levels = -np.cumsum(u(0.2, 0.6, rng.integers(4, 8)))
    steps = [(r, z) for r, i in zip(u(0.08, 0.4, len(levels) - 1), range(9), strict=False) for z in levels[i : i + 2]]
    return [lathe((0, levels[0]), *steps, (0, levels[-1]))]


def _gears(u: Uniform, rng: Random) -> list[Part]:
    teeth, depth = int(rng.integers(8, 25)), u(0.75, 0.92)
    angles = np.arange(4 * teeth) / (4 * teeth) * 2 * np.pi
    radii = np.tile([1, 1, depth, depth], teeth)
    outline = [(float(r * np.cos(a)), float(r * np.sin(a))) for r, a in zip(radii, angles, strict=True)]
    return [prism(outline, u(0.1, 0.4)), rod(u(0.15, 0.4), u(0.4, 0.9)), rod(0.1, 1.2).by(at=(0, 0, -0.2))]


def _glasses(u: Uniform, rng: Random) -> list[Part]:
    foot, stem, rise, bowl, mouth, wall = u(0.25, 0.45), u(0.02, 0.05), u(0.3, 0.8), u(0.3, 0.5), u(0.25, 0.6), 0.015
    top, low = rise + u(0.4, 0.9), rise + u(0.1, 0.3)
    inner = [(0, rise + wall), (bowl - wall, low), (mouth - wall, top)]
    return [lathe(*inner, (mouth, top), (bowl, low), (stem, rise), (stem, 0.05), (foot, 0.02), (foot, 0), (0, 0))]


def _chairs(u: Uniform, rng: Random) -> list[Part]:
    w, d, h, t, back = u(0.5, 0.8), u(0.5, 0.8), u(0.4, 0.8), u(0.04, 0.1), u(0.4, 1)
    legs = [box(t, t, h).by(at=(x * (w - t) / 2, y * (d - t) / 2, 0)) for x in (-1, 1) for y in (-1, 1)]
    posts = [box(t, t, back).by(at=(x * (w - t) / 2, (d - t) / 2, h)) for x in (-1, 1)]
    boards = [box(w, t * 0.6, back * 0.15).by(at=(0, (d - t) / 2, h + back * k)) for k in rng.uniform(0.2, 0.85, 3)]
    return [*legs, *posts, *boards, box(w, d, t).by(at=(0, 0, h))]


def _tables(u: Uniform, rng: Random) -> list[Part]:
    w, d, h, t = u(0.8, 1.6), u(0.5, 1), u(0.4, 0.9), u(0.03, 0.1)
    if rng.integers(2):
        return [rod(w / 2, t).by(at=(0, 0, h)), rod(u(0.04, 0.1), h), rod(w / 3, t)]
    legs = [rod(u(0.03, 0.06), h, 1.3).by(at=(x * w * 0.45, y * d * 0.42, 0)) for x in (-1, 1) for y in (-1, 1)]
    return [box(w, d, t).by(at=(0, 0, h)), *legs]


def _toilets(u: Uniform, rng: Random) -> list[Part]:
    r, h, w = u(0.3, 0.4), u(0.4, 0.55), 0.05
    bowl = lathe((0, h * 0.5), (r - w, h), (r, h), (r * 0.95, h * 0.7), (r * u(0.4, 0.6), 0), (0, 0))
    tank = box(u(0.5, 0.8), u(0.2, 0.3), u(0.4, 0.7)).by(at=(0, r * 1.3 + 0.1, h * 0.8))
    return [bowl.by(1, 1.3, 1), ring(r - w / 2, w * 0.6).by(1, 1.3, 0.5, at=(0, 0, h + 0.01)), tank]


def _aircraft(u: Uniform, rng: Random) -> list[Part]:
    long, r, span, chord, back = u(0.8, 1.2), u(0.08, 0.14), u(0.6, 1.2), u(0.2, 0.4), u(-0.1, 0.5)
    wing = prism([(-chord / 2, 0), (chord / 2, 0), (back + chord / 4, span), (back - chord / 8, span)], 0.025)
    fin = prism([(0, 0), (0.25, 0), (0.3, 0.3), (0.15, 0.3)], 0.02)
    tails = [fin.by(1, y, 1, at=(long * 0.7, 0, 0.02)) for y in (-1, 1)]
    upright = Part(fin.patches, fin.inside, np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]]), np.zeros(3))
    engines = [ball().by(0.16, 0.05, 0.05, at=(0, y * span * 0.4, -0.06)) for y in (-1, 1)]
    wings = [wing.by(1, y, 1, at=(-0.1, 0, 0)) for y in (-1, 1)]
    return [ball().by(long, r, r), *wings, *tails, upright.by(at=(long * 0.7, 0, r * 0.4)), *engines]


def _animals(u: Uniform, rng: Random) -> list[Part]:
    long, r, leg = u(0.5, 0.8), u(0.18, 0.3), u(0.4, 0.8)
    neck, rise = u(0.2, 0.5), u(0.2, 0.9)
    head = (long + neck * np.sin(rise), 0, neck * np.cos(rise))
    legs = [rod(u(0.05, 0.09), leg, 1.4).by(at=(x * long * 0.6, y * r * 0.6, -leg)) for x in (-1, 1) for y in (-1, 1)]
    ears = [rod(0.05, 0.2, 0.1).by(at=(head[0], y * 0.08, head[2] + 0.08)) for y in (-1, 1)]
    tail = rod(0.04, u(0.2, 0.5), 0.3).by(lean=-2.0, at=(-long * 0.9, 0, 0))
    throat = rod(0.1, neck).by(lean=rise, at=(long * 0.9, 0, 0))
    return [ball().by(long, r, r), ball().by(u(0.16, 0.25), 0.12, 0.13, at=head), throat, *legs, *ears, tail]


def _reliefs(u: Uniform, rng: Random) -> list[Part]:
    bosses = [ball().by(u(0.1, 0.4), at=(u(-0.7, 0.7), u(-0.7, 0.7), 0)) for _ in range(rng.integers(0, 5))]
    return [hills(rng, u(0.02, 0.12), int(rng.integers(2, 6))), *bosses]


def _streets(u: Uniform, rng: Random) -> list[Part]:
    parts = [box(3, 3, 0.02)]
    for x, y in [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]:
        at = (x + u(-0.1, 0.1), y + u(-0.1, 0.1), 0.01)
        if rng.integers(3):
            w, h, roof, turn = u(0.4, 0.7), u(0.2, 0.7), u(0.1, 0.3), u(0, 3)
            gable = prism([(0, -w / 2), (roof, 0), (0, w / 2)], w).by(lean=-np.pi / 2, at=(w / 2, 0, h))
            parts += [part.by(turn=turn, at=at) for part in (box(w, w, h), gable)]
        else:
            parts += [rod(0.03, 0.4).by(at=at), ball().by(0.2, 0.2, u(0.2, 0.4), at=(at[0], at[1], 0.55))]
    return parts


def _casts(u: Uniform, rng: Random) -> list[Part]:
    return [scanned(str(rng.choice(["bracket", "fan", "medallion", "statue"]))).by(u(0.6, 1), u(0.6, 1), u(0.6, 1.6))]


KINDS = {
    "clamps": _clamps, "shafts": _shafts, "gears": _gears, "glasses": _glasses, "chairs": _chairs, "tables": _tables,
    "toilets": _toilets, "aircraft": _aircraft, "animals": _animals, "reliefs": _reliefs, "streets": _streets,
    "casts": _casts,
}  # fmt: skip


def draw(kind: int, number: int, n_points: int, *, upright: bool = False) -> tuple[Array, Array]:
    """Draw so many points of a shape, turned at random or as it stands: points and unit normals, (n, 3) each."""
    rng = np.random.default_rng((kind, number))
    parts = list(KINDS.values())[kind](rng.uniform, rng)
    rng = np.random.default_rng((kind, number, n_points))  # so that the numbers above decide the shape alone
    weights = np.array([part.bound * sum(patch.weight for patch in part.patches) for part in parts])
    points, normals = np.empty((0, 3)), np.empty((0, 3))
    while len(points) < n_points:
        counts = rng.multinomial(2 * n_points, weights / weights.sum())
        for part, count in zip(parts, counts, strict=True):
            new, theirs = part.draw(count, rng)
            free = ~np.any([other.holds(new) for other in parts if other is not part] or [_nowhere(new)], axis=0)
            points, normals = np.concatenate([points, new[free]]), np.concatenate([normals, theirs[free]])
    rows = rng.permutation(len(points))[:n_points]
    turn = np.eye(3) if upright else np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return points[rows] @ turn.T, normals[rows] @ turn.T
