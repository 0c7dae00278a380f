"""Points that are kept whatever happens, and weights of the density: what users know that the cloud does not tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gppcs.gp.local.candidates import Candidates, Finest
from gppcs.spatial.chunks import Places

FINEST = 8.0  # Times the usual number of candidates at most, where large weights want many points in few places.


def weighted(spacings: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return desired spacings of which the density is multiplied by weights.

    The weights come after the gradation, so that the density jumps where they do.

    Parameters
    ----------
    spacings : (n,) array
        In units of the target spacing.
    weights : (n,) array
        Above 0.

    Returns
    -------
    (n,) array
        The mean of 1 / spacing^2 is 1.
    """
    density = weights * spacings**-2.0
    return np.sqrt(np.mean(density) / density)


def refinement(weights: NDArray[np.float64] | None) -> float:
    """Return how many times as many candidates are needed as without weights.

    Parameters
    ----------
    weights : (N,) array or None

    Returns
    -------
    float
        At least 1: the largest weight in units of their mean.
    """
    return 1.0 if weights is None else min(float(weights.max() / weights.mean()), FINEST)


def with_fixed(finest: Finest, fixed: int, points: NDArray[np.float64], sharpness: NDArray[np.float32]) -> Finest:
    """Return the candidates of the last stage with the first points of the cloud among them.

    Parameters
    ----------
    finest : Finest
    fixed : int
        How many first points.
    points : (N, 3) array
        All points.
    sharpness : (N,) array
        Of all points.

    Returns
    -------
    Finest
    """
    rows = np.union1d(finest.places.rows, np.arange(fixed))
    return finest._replace(places=Places(rows, points[rows], sharpness[rows]))


def after_fixed(candidates: Sequence[Candidates], fixed: int) -> list[Candidates]:
    """Return the stages that want more than the first points, with these among their candidates.

    Parameters
    ----------
    candidates : sequence of Candidates
        Of all stages.
    fixed : int
        How many first points.

    Returns
    -------
    list of Candidates
    """
    return [
        stage._replace(indices=np.union1d(stage.indices, np.arange(fixed)))
        for stage in candidates
        if stage.target > fixed
    ]
