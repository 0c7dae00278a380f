"""The field of a stage, tile by tile: what `gppcs.gp.local.ranking.local_field` computes in memory.

Each tile measures its own candidates, with a halo as wide as the measurement reaches. The results are stored, so all
tiles see the same field. What the field needs of all candidates, such as means, is summed up over the stored values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.density import EDGE_ROUGHNESS, GRADATION, LEAST_ROUGHNESS, ROUNDING, graded, segregation_of
from gppcs.gp.local.kernel import LocalField
from gppcs.gp.local.ranking import NEAREST, NUGGET, Criterion
from gppcs.gp.tiled.candidates import ROWS, Stage
from gppcs.spatial.boxes import Each, Tile
from gppcs.spatial.kdtree import KdTree
from gppcs.surface.noise import Noise
from gppcs.surface.surface_variation import features_in_radius, features_of_nearest

GREATEST_ROUGHNESS = math.sqrt(1.0 / 3.0)
THIN_HALO, THICK_HALO = 1.0, 3.0  # In target spacings. Thick noise moves candidates before they are measured.
NEAREST_HALO = 6.0  # Candidates that are all points lie nearer than the target spacing, where a cloud is not sparse.


@dataclass(frozen=True)
class TiledField:
    """The field of a stage.

    Attributes
    ----------
    stage : Stage
        Its table has the columns "variation" and "normal" of each candidate, and "spacing", the desired one.
    noise : Noise
    criterion : Criterion
    roundness : float
        How much the density and the normals count: 1, or less for a cloud of flat faces and edges.
    mean, spread : float
        Of the surface variation, by which it is standardised.
    scale : float
        By which the stored spacings are multiplied.
    """

    stage: Stage
    noise: Noise
    criterion: Criterion
    roundness: float
    mean: float
    spread: float
    scale: float

    def at(self, rows: NDArray[np.int64]) -> tuple[KdTree, LocalField]:
        """Return the field at some candidates.

        Parameters
        ----------
        rows : (n,) array, int64

        Returns
        -------
        tree : KdTree
            Over them, in units of the target spacing.
        field : LocalField
            In tree order.
        """
        table, h = self.stage.table, self.stage.spacing
        tree = KdTree.build(table.take("place", rows)).scaled(1.0 / h)
        rows = rows[tree.order]
        variation = table.take("variation", rows)
        noise = np.zeros(len(rows)) if self.noise.quiet else table.take("variance", rows) / h**2
        return tree, LocalField(
            positions=tree.points,
            normals=np.ascontiguousarray(table.take("normal", rows).T),
            spacings=self.scale * table.take("spacing", rows),
            y=(variation - self.mean) / self.spread if self.spread > ROUNDING else np.zeros(len(rows)),
            noise=NUGGET + noise,
            lengthscale=self.criterion.lengthscale,
            normal_weight=self.criterion.normal_weight * self.roundness,
        )


def tiled_field(
    stage: Stage,
    tiles: Sequence[Tile],
    noise: Noise,
    criterion: Criterion,
    each: Each,
    advanced: Callable[[int], None],
) -> TiledField:
    """Measure the candidates of a stage.

    Parameters
    ----------
    stage : Stage
    tiles : sequence of Tile
    noise : Noise
    criterion : Criterion
    each : callable
        Applies a function to all tiles.
    advanced : callable
        Called with the number of candidates measured since the last call; each is measured twice.

    Returns
    -------
    TiledField
    """
    table = stage.table

    def measured(measure: Callable[[Tile], None]) -> None:
        for tile, _ in zip(tiles, each(measure, tiles), strict=True):
            own = table.rows_of(tile)
            advanced(own.stop - own.start)

    table.create("variation", np.empty(0))
    table.create("normal", np.empty((0, 3)))
    measured(partial(_measure_features, stage, noise))
    mean = _mean(table.chunks_of("variation", ROWS), lambda values: values)
    spread = math.sqrt(_mean(table.chunks_of("variation", ROWS), lambda values: (values - mean) ** 2))
    clipped = _mean(_roughness(stage), lambda values: np.minimum(values, EDGE_ROUGHNESS))
    variance = _mean(_roughness(stage), lambda values: (np.minimum(values, EDGE_ROUGHNESS) - clipped) ** 2)
    roundness = (1.0 - segregation_of(clipped, variance) ** 2) ** 4
    power = criterion.density_power * roundness
    density = _mean(_roughness(stage), lambda values: np.maximum(values, LEAST_ROUGHNESS) ** power)
    table.create("spacing", np.empty(0))
    measured(partial(_measure_spacings, stage, power, density))
    scale = math.sqrt(_mean(table.chunks_of("spacing", ROWS), lambda values: values**-2.0))
    return TiledField(stage, noise, criterion, roundness, mean, spread, scale)


def _roughness(stage: Stage) -> Iterator[NDArray[np.float64]]:
    return map(np.sqrt, stage.table.chunks_of("variation", ROWS))


def _mean(
    chunks: Iterator[NDArray[np.float64]], function: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> float:
    sums = [(len(chunk), float(np.sum(function(chunk)))) for chunk in chunks]
    return math.fsum(total for _, total in sums) / sum(count for count, _ in sums)


def _measure_features(stage: Stage, noise: Noise, tile: Tile) -> None:
    """Store surface variation and normals of the candidates of a tile."""
    table, h = stage.table, stage.spacing
    halo = (THICK_HALO if noise.thick else THIN_HALO) if stage.thinned else NEAREST_HALO
    rows = table.rows_near(tile, halo * h * (1.0 + 1e-9))
    tree = KdTree.build(table.take("place", rows))
    if noise.thick and not noise.quiet:
        tree = KdTree.over(np.ascontiguousarray(table.take("foot", rows[tree.order]).T), tree.order)
    tree = tree.scaled(1.0 / h)
    features = features_in_radius(tree, 1.0) if stage.thinned else features_of_nearest(tree, NEAREST)
    own = table.rows_of(tile)
    inside = slice(*np.searchsorted(rows, [own.start, own.stop]))
    table.put("variation", own, features.surface_variation[inside])
    table.put("normal", own, features.normals[inside])


def _measure_spacings(stage: Stage, power: float, mean: float, tile: Tile) -> None:
    """Store the desired spacings of the candidates of a tile, given the mean of all densities."""
    table, h = stage.table, stage.spacing
    widest, narrowest = math.sqrt(mean / LEAST_ROUGHNESS**power), math.sqrt(mean / GREATEST_ROUGHNESS**power)
    rows = table.rows_near(tile, (widest - narrowest) / GRADATION * h)
    tree = KdTree.build(table.take("place", rows)).scaled(1.0 / h)
    roughness = np.sqrt(table.take("variation", rows[tree.order]))
    spacings = np.empty(len(rows))
    spacings[tree.order] = graded(tree, np.sqrt(mean / np.maximum(roughness, LEAST_ROUGHNESS) ** power), GRADATION)
    own = table.rows_of(tile)
    table.put("spacing", own, spacings[slice(*np.searchsorted(rows, [own.start, own.stop]))])
