"""The greedy choice of a stage, tile by tile, without seams.

All tiles choose down to one score, the *level*. A tile chooses with its halo, as if nothing lay beyond, and keeps what
it chose in itself: what lies beyond the halo is too far away to matter. Tiles that are farther apart than a halo choose
without knowing of each other; these are a class. The classes follow one another in a fixed order. A tile takes what
tiles of earlier classes chose in its halo as given, and chooses nothing more there. At the end, the points with the
largest scores of all stay, exactly as many as wanted. So the number of points in a tile follows the density that the
field asks for, and no tile has a share of its own that could differ from its neighbour's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.greedy import FALL, SPARE, STEP, extend, extend_down_to
from gppcs.gp.tiled.field import TiledField
from gppcs.spatial.boxes import Each, Tile, classes

HALO = 6.0  # In target spacings. 3 give the same points as 24, but for one in a hundred (docs/experiments.md).
LOWER = 0.98  # The level, in units of the last score of the stage before. Fields of all stages are much alike.
LOWEST = 1e-6  # Below this level, all candidates are chosen.


class Chosen(NamedTuple):
    """Chosen candidates, in the order of choice; (n,) each.

    Attributes
    ----------
    rows : array, int64
        Rows in the table of the stage.
    scores, deviations : arrays
        Of each when it was chosen.
    """

    rows: NDArray[np.int64]
    scores: NDArray[np.float64]
    deviations: NDArray[np.float64]


def choose_in_tiles(
    field: TiledField,
    tiles: Sequence[Tile],
    before: NDArray[np.int64],
    last_score: float,
    each: Each,
    advanced: Callable[[int], None],
) -> Chosen:
    """Choose points until as many are chosen as the stage wants.

    Parameters
    ----------
    field : TiledField
    tiles : sequence of Tile
    before : (m,) array, int64
        Candidates that are chosen already, in the order of choice.
    last_score : float
        The smallest score of the stage before.
    each : callable
        Applies a function to tiles.
    advanced : callable
        Called with the number of points chosen since the last call.

    Returns
    -------
    Chosen
        Only the new ones.
    """
    table = field.stage.table
    target = min(field.stage.target, len(table))
    wanted = target - len(before)
    if len(tiles) == 1:
        tree, local = field.at(np.arange(len(table)))
        positions = tree.positions()[before]
        of_field = field.criterion.neighbours, field.criterion.error_weight
        chosen, scores, deviations = extend(local, tree, positions, target, *of_field)
        advanced(wanted)
        return Chosen(tree.order[chosen[len(before) :]], scores, deviations)
    table.create("chosen", np.empty(0, dtype=np.bool_))
    table.put("chosen", before, True)
    found, count, level = [], 0, LOWER * last_score
    while count < wanted:
        for some in _rounds(field, tiles, level, each):
            table.put("chosen", some.rows, True)
            found.append(some)
            advanced(min(len(some.rows), max(0, wanted - count)))
            count += len(some.rows)
        fall = ((len(before) + count) / (len(before) + SPARE * wanted)) ** FALL
        level = level * max(STEP, fall) if level > LOWEST else 0.0
    every = Chosen._make(map(np.concatenate, zip(*found, strict=True)))
    best = np.lexsort([every.rows, -every.scores])[:wanted]
    return Chosen._make(values[best] for values in every)


def _rounds(field: TiledField, tiles: Sequence[Tile], level: float, each: Each) -> Iterator[Chosen]:
    """Yield what each tile chooses down to a level."""
    halo, settled = HALO * field.stage.spacing, np.zeros(len(field.stage.table.boxes), dtype=np.bool_)
    for some in classes(tiles, halo):
        yield from each(partial(_choose, field, level, halo, settled), some)
        settled = settled.copy()
        for tile in some:
            settled[tile.first : tile.last] = True


def _choose(field: TiledField, level: float, halo: float, settled: NDArray[np.bool_], tile: Tile) -> Chosen:
    """Choose the candidates of a tile with a score of at least `level`; nothing in boxes that are `settled`."""
    table, own = field.stage.table, field.stage.table.rows_of(tile)
    rows = table.rows_near(tile, halo)
    chosen = table.take("chosen", rows)
    open_ = ~settled[np.searchsorted(table.starts, rows, side="right") - 1]
    rows, chosen = rows[open_ | chosen], chosen[open_ | chosen]
    tree, local = field.at(rows)
    before = np.flatnonzero(chosen[tree.order])
    of_field = field.criterion.neighbours, field.criterion.error_weight
    added, scores, deviations = extend_down_to(level, local, tree, before, *of_field)
    found = rows[tree.order[added]]
    inside = (found >= own.start) & (found < own.stop)
    return Chosen(found[inside], scores[inside], deviations[inside])
