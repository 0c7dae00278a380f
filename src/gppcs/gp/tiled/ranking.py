"""The choice in stages on a cloud on disk: what `gppcs.gp.local.ranking` does in memory."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.gp.local.candidates import FIRST_STAGE
from gppcs.gp.local.ranking import Criterion, Ranking
from gppcs.gp.tiled.candidates import Search, Stage, coarser_stage, finest_stage
from gppcs.gp.tiled.choice import choose_in_tiles
from gppcs.gp.tiled.field import tiled_field
from gppcs.gp.tiled.survey import TiledSurvey, rough_area, survey_tiles
from gppcs.spatial.boxes import Each
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.stored import store
from gppcs.surface.noise import Noise

TILE = 1 << 19  # Points or candidates of a tile at most. With fewer, halos cost more than the tiles themselves.


class TiledRanking(NamedTuple):
    """What `rank_in_tiles` returns.

    Attributes
    ----------
    ranking : Ranking
        Rows in the cloud. Fewer than M if there are fewer different places.
    noise : Noise
    """

    ranking: Ranking
    noise: Noise


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
        An empty folder, or that of an interrupted call, from which this one goes on. It takes about 32 bytes for each
        point and 2.5 kB for each point to keep.
    stages : Stages
        Times "sample", "boxes", "survey", "candidates", "features" and "greedy selection".
    each : callable
        Applies a function to all tiles, like `map`.

    Returns
    -------
    TiledRanking
    """
    journal = Journal(folder)
    stored, sample = store(points, folder, stages)

    def surveyed() -> TiledSurvey:
        tiles = stored.boxes.tiles(stored.counts, TILE)
        with stages("survey", len(points)) as advanced:
            return survey_tiles(stored, tiles, n_points, rough_area(sample, density), each, advanced)

    def finest() -> Stage:
        with stages("candidates", len(points)) as advanced:
            return finest_stage(stored, survey, n_points, Search(folder, density, survey.noise, each, advanced, TILE))

    def coarser() -> Stage:
        with stages("candidates"):
            search = Search(folder, density, survey.noise, each, lambda steps: None, TILE)
            return coarser_stage(found[-1], search)

    survey = journal.once("survey", surveyed)
    found = [journal.once("finest candidates", finest)]
    stored.remove()
    while found[-1].target > FIRST_STAGE:
        found.append(journal.once(f"candidates below {found[-1].target}", coarser))
    ranking = _ranked(found[::-1], survey.noise, criterion, stages, each, journal)
    return TiledRanking(ranking, survey.noise)


def _ranked(
    found: list[Stage], noise: Noise, criterion: Criterion, stages: Stages, each: Each, journal: Journal
) -> Ranking:
    """Choose stage by stage, from coarse to fine."""
    ranking, last_score = Ranking(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0)), 1.0

    def chosen() -> tuple[Ranking, float]:
        """Return the ranking with what the stage adds; its rows are those of the next stage, or of the cloud."""
        tiles = stage.table.boxes.tiles(stage.table.counts, TILE)
        wanted = min(stage.target, len(stage.table)) - len(ranking.indices)
        with stages("features", 2 * len(stage.table)) as advanced:
            field = tiled_field(stage, tiles, noise, criterion, each, advanced)
        with stages("greedy selection", wanted) as advanced:
            added = choose_in_tiles(field, tiles, ranking.indices, last_score, each, advanced)
        rows = np.concatenate([ranking.indices, added.rows])
        if finer is None or finer.table is not stage.table:
            rows = stage.table.take("row" if finer is None else "parent", rows)
        extended = Ranking(
            rows,
            np.concatenate([ranking.scores, added.scores]),
            np.concatenate([ranking.deviations, added.deviations]),
        )
        return extended, float(added.scores.min()) if len(added.scores) else last_score

    for stage, finer in zip(found, [*found[1:], None], strict=True):
        ranking, last_score = journal.once(f"choice of {stage.target}", chosen)
        if finer is not None and finer.table is not stage.table:
            stage.table.remove()
    return ranking
