"""Compare the choice in tiles, for clouds larger than memory, with the choice in memory; look for seams between tiles.

The clouds fit into memory, and the tiles are small: so both choices can be made. Needs the extra `evaluate`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.spatial.transform import Rotation

import conditions
import gppcs
import report
from conditions import H_MEAN, SURFACE, Array, Condition, Reference, Scan
from gppcs.engine.stages import Stages
from gppcs.gp.tiled import ranking
from gppcs.spatial import stored
from gppcs.spatial.boxes import Boxes, Tile
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.scaling import Frame, bounds

TURNS = range(3)  # of the cloud, by which both ways are compared
NEAR = 2.0  # target spacings from a border
PLACEBOS = 40  # shifts of the borders to where none is
DETECTED = 2.8  # standard errors of a difference that a test of 5 % detects in four of five cases
SAMPLES = ("bracket", "sphere", "medallion", "fan")
APART = 120.0  # from one of them to the next; each is 100 wide at most


@dataclass(frozen=True)
class Row(Condition):
    """The sample scans of gppcs, side by side, as one scene."""

    size: int = 5_000_000

    @property
    def name(self) -> str:
        """The name in tables and on the command line."""
        return f"samples_{self.size // 1_000_000}m:{self.amount:g}"

    @property
    def files(self) -> list[Path]:
        """None: the cloud is computed."""
        return []

    @cached_property
    def cloud(self) -> gppcs.PointCloud:
        """The scene."""
        return gppcs.PointCloud.of(side_by_side(self.size, 0)[0])

    @cached_property
    def mesh(self) -> None:
        """There is none."""

    @cached_property
    def reference(self) -> None:
        """There is none for all surfaces at once: `by_scan` compares each with its own."""

    def by_scan(self, kept: Array) -> float:
        """Return H mean, where the surface of each scan is rebuilt from its own points."""
        points, normals = side_by_side(conditions.SURFACE_SAMPLE, conditions.OTHER_SEED)
        found = []
        for number in range(len(SAMPLES)):
            own, its = (
                np.round((places[:, 0] - places[:, 0].min() - APART / 2.5) / APART) == number
                for places in (points, kept)
            )
            found.append(conditions.distances_from(Reference(points[own], normals[own]), kept[its], None))
        return float(np.mean([each["hausdorff_mean"] for each in found]))


@dataclass(frozen=True)
class Case:
    """A cloud, and the candidates of a tile at most."""

    condition: Condition
    tile: int


CASES = (
    Case(Condition("dragon", "dragon", 0.06), 1 << 15),
    Case(Condition("armadillo_173k_resampled", "armadillo_50k", 0.1), 1 << 15),
    Case(Scan("lion_takanawa", None, 0.1), 1 << 15),
    Case(Scan("tum_desk", None, 0.1), 1 << 15),
    Case(Row("samples", None, 0.05), 1 << 19),
)


def side_by_side(size: int, seed: int) -> tuple[Array, Array]:
    """Return points of all sample scans, and their normals, (size, 3) each."""
    points, normals = [], []
    for number, name in enumerate(SAMPLES):
        scan = gppcs.sample(name, size // len(SAMPLES), seed=seed)
        points.append(scan.points + np.array([APART * number, 0.0, 0.0]))
        normals.append(scan.normals())
    return np.concatenate(points), np.concatenate(normals)


@dataclass(frozen=True)
class Tiled:
    """A choice in tiles: rows, all boxes, the tiles of the last stage, and the target spacing in the unit of points."""

    rows: Array
    boxes: Boxes
    tiles: Sequence[Tile]
    spacing: float


def in_tiles(points: Array, n_points: int, tile: int) -> Tiled:
    """Choose points in tiles with few candidates."""
    method, seen = gppcs.LocalGP(), []
    plain = ranking.choose_in_tiles

    def watched(field, tiles, *rest):  # type: ignore[no-untyped-def]
        seen.append((field.stage.table.boxes, tiles, field.stage.spacing))
        return plain(field, tiles, *rest)

    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(ranking, "TILE", tile),
        patch.object(stored, "BOX", tile // 16),
        patch.object(ranking, "choose_in_tiles", watched),
    ):
        chunked = ChunkedPoints(len(points), lambda: np.array_split(points, 7))
        selection = method.in_tiles(chunked, n_points, Path(folder), Stages())
    return Tiled(selection.indices, *seen[-1])


def to_border(points: Array, tiled: Tiled) -> Array:
    """Return the distance of each point, (n, 3), to the nearest border between tiles."""
    of_box = np.empty(len(tiled.boxes), dtype=np.int64)
    for number, tile in enumerate(tiled.tiles):
        of_box[tile.first : tile.last] = number
    own = of_box[tiled.boxes.box_of(points)]
    outer_low, outer_high = tiled.boxes.low[1], tiled.boxes.high[1]
    low, high = (np.array([corners[i] for corners in tiled.tiles]) for i in (2, 3))
    low, high = np.where(low > outer_low, low, -np.inf), np.where(high < outer_high, high, np.inf)
    return np.minimum(points - low[own], high[own] - points).min(axis=1)


def seams(points: Array, tiled: Tiled, others: Array) -> Iterator[tuple[float, float]]:
    """Yield, first at the borders and then at placebos, how density and spacing of two choices compare.

    Both are ratios, tiled to in memory: of the numbers of points near a border, and of their mean distances to the
    nearest other point. A placebo is a shift of all borders to where none is.
    """
    kept = [points[tiled.rows], points[others]]
    nearest = [np.sqrt(gppcs.KdTree.build(places).nearest_of(places, 2)[1][:, 1]) for places in kept]
    rng, size = np.random.default_rng(0), np.median([tile.high - tile.low for tile in tiled.tiles], axis=0)
    for shift in [np.zeros(3), *(rng.uniform(0.1, 0.9, (PLACEBOS, 3)) * size)]:
        near = [to_border(places + shift, tiled) < NEAR * tiled.spacing for places in kept]
        density = near[0].sum() / near[1].sum()
        yield density, float(nearest[0][near[0]].mean() / nearest[1][near[1]].mean())


@cache
def chosen(case: Case, turn: int) -> tuple[Array, Tiled, Array]:
    """Return the turned points at unit size, the choice in tiles, and the rows chosen in memory."""
    matrix = Rotation.random(random_state=turn).as_matrix() if turn else np.eye(3)
    points = case.condition.cloud.points @ matrix.T
    points = Frame.around(*bounds(points)).local(points)
    n_points = case.condition.n_points
    return points, in_tiles(points, n_points, case.tile), gppcs.simplify(points, n_points=n_points).indices


def judged(condition: Condition, kept: gppcs.PointCloud) -> dict[str, float]:
    """Return the figures of kept points."""
    found = conditions.figures(condition, kept)
    return found | {"hausdorff_mean": condition.by_scan(kept.points)} if isinstance(condition, Row) else found


def quality(case: Case) -> list[str]:
    """Return the row of a cloud: ratios of the figures, tiled to in memory."""
    ratios, cells = [], []
    for turn in TURNS:
        _, tiled, others = chosen(case, turn)
        assert len(np.unique(tiled.rows)) == case.condition.n_points
        made = [judged(case.condition, case.condition.cloud.take(rows)) for rows in (tiled.rows, others)]
        ratios.append([made[0][column.figure] / made[1][column.figure] for column in (H_MEAN, SURFACE)])
        print(case.condition.name, turn, len(tiled.tiles), ratios[-1], flush=True)
    for values in np.array(ratios).T:
        cells.append(f"{np.exp(np.log(values).mean()):.4f} ± {values.std(ddof=1) / np.sqrt(len(values)):.4f}")
    tiles = len(chosen(case, 0)[1].tiles)
    return [case.condition.name, f"{len(case.condition.cloud):,}", f"{case.condition.n_points:,}", str(tiles), *cells]


def borders(case: Case) -> list[str]:
    """Return the row of a cloud: what is different near the borders of tiles."""
    found = np.array([list(seams(*chosen(case, turn))) for turn in TURNS]).mean(axis=0)
    cells = []
    for real, *placebos in found.T:
        mean, error = np.mean(placebos), np.std(placebos, ddof=1)
        cells += [
            f"{100 * (real / mean - 1):+.2f} %",
            f"{(real - mean) / error:+.1f}",
            f"{100 * DETECTED * error / mean:.2f} %",
        ]
    print(case.condition.name, cells, flush=True)
    return [case.condition.name, *cells]


def main() -> None:
    """Write the table."""
    report.write_sections(
        "tiles",
        "The method gp in tiles beside gp in memory",
        [
            report.Section(
                "Quality",
                ("cloud", "points", "kept", "tiles", "H mean, tiled / in memory", "local surface, tiled / in memory"),
                [quality(case) for case in CASES],
            ),
            report.Section(
                "Within two target spacings of the borders of tiles",
                (
                    "cloud", "density", "in standard errors", "would be detected",
                    "distance to the nearest kept point", "in standard errors", "would be detected",
                ),
                [borders(case) for case in CASES],
            ),
        ],
        sorted({path for case in CASES for path in case.condition.files}),
        (
            f"Geometric means and standard errors over {len(TURNS)} turns of the cloud.",
            "Density and distance are those of the choice in tiles, divided by those in memory in the same places."
            f" They are compared with {PLACEBOS} shifts of the borders to where none is; the standard error is the "
            "standard deviation of these. A difference as large as in the columns that say what would be detected is "
            "found in four of five cases by a test at the level of 5 %.",
        ),
    )  # fmt: skip


if __name__ == "__main__":
    main()
