"""The choice in stages on a cloud on disk: what `gppcs.gp.local.ranking` does in memory."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import FIRST_STAGE
from gppcs.gp.local.ranking import Criterion, Ranking
from gppcs.gp.tiled.candidates import Search, Stage, coarser_stage, finest_stage
from gppcs.gp.tiled.choice import choose_in_tiles
from gppcs.gp.tiled.field import tiled_field
from gppcs.gp.tiled.survey import TiledNoise, rough_area, survey_tiles
from gppcs.spatial.boxes import Each
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.stored import store

TILE = 1 << 19  # Points or candidates of a tile at most. With fewer, halos cost more than the tiles themselves.


class TiledRanking(NamedTuple):
    """What `rank_in_tiles` returns.

    Attributes
    ----------
    ranking : Ranking
        Rows in the cloud. Fewer than M if there are fewer different places.
    noise : TiledNoise
    """

    ranking: Ranking
    noise: TiledNoise


def rank_in_tiles(
    points: ChunkedPoints,
    n_points: int,
    criterion: Criterion,
    density: float,
    folder: Path,
    stages: Stages,
    each: Each = map,
) -> TiledRanking:
    """Choose points, the most important first, and hold no more than one tile of them in memory.

    Parameters
    ----------
    points : ChunkedPoints
        N points, which may repeat each other. They are read twice.
    n_points : int
        M, from 1 to N.
    criterion : Criterion
    density : float
        Number of candidate cells in a square whose side is the target spacing.
    folder : path
        An empty folder. It takes about 32 bytes for each point and 2.5 kB for each point to keep.
    stages : Stages
        Times "sample", "tiles", "survey", "candidates", "features" and "greedy selection".
    each : callable
        Applies a function to all tiles, like `map`.

    Returns
    -------
    TiledRanking
    """
    stored, sample = store(points, folder, stages)
    area = rough_area(sample, density)
    tiles = stored.boxes.tiles(stored.counts, TILE)
    with stages("survey", len(points)) as advanced:
        survey = survey_tiles(stored, tiles, n_points, area, each, advanced)
    del sample
    with stages("candidates", len(points)) as advanced:
        search = Search(folder, density, survey.noise, each, advanced, TILE)
        found = [finest_stage(stored, survey, n_points, search)]
    stored.remove()
    with stages("candidates"):
        search = Search(folder, density, survey.noise, each, lambda steps: None, TILE)
        while found[-1].target > FIRST_STAGE:
            found.append(coarser_stage(found[-1], search))
    return TiledRanking(_ranked(found[::-1], survey.noise, criterion, stages, each), survey.noise)


def _ranked(found: list[Stage], noise: TiledNoise, criterion: Criterion, stages: Stages, each: Each) -> Ranking:
    """Choose stage by stage, from coarse to fine."""
    chosen, scores, deviations = np.empty(0, dtype=np.int64), np.empty(0), np.empty(0)
    last_score = 1.0
    for stage, finer in zip(found, [*found[1:], None], strict=True):
        tiles = stage.table.boxes.tiles(stage.table.counts, TILE)
        wanted = min(stage.target, len(stage.table)) - len(chosen)
        with stages("features", 2 * len(stage.table)) as advanced:
            field = tiled_field(stage, tiles, noise, criterion, each, advanced)
        with stages("greedy selection", wanted) as advanced:
            added = choose_in_tiles(field, tiles, chosen, last_score, each, advanced)
        if len(added.scores):
            last_score = float(added.scores.min())
        chosen = np.concatenate([chosen, added.rows])
        scores, deviations = np.concatenate([scores, added.scores]), np.concatenate([deviations, added.deviations])
        if finer is None:
            return Ranking(stage.table.take("row", chosen), scores, deviations)
        if finer.table is not stage.table:
            chosen = stage.table.take("parent", chosen)
            stage.table.remove()
    raise AssertionError("expected at least one stage")
