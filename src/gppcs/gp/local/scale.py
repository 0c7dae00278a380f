"""What a choice in a part of a cloud needs to know of the whole, so that parts fit together at their borders."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gppcs.surface.noise import Noise


class FieldScale(NamedTuple):
    """What the field at a candidate depends on that is measured of all candidates of a stage."""

    spacing: float  # Target spacing of the stage
    mean: float  # Of the surface variation
    deviation: float  # Of the surface variation
    roundness: float  # From 1 for a cloud that is equally rough everywhere to 0 for flat faces and edges only
    density: float  # Mean of the desired density
    factor: float  # What makes the mean of 1 / spacing^2 equal to 1
    normal_factor: float  # Of the weight of the normals, Eq. (3c): below 1 in a cloud with thin parts


class Scale(NamedTuple):
    """What is measured of a whole cloud, in a sample or in blocks of it."""

    noise: Noise  # Without a tree
    candidate_density: float  # Cells of the candidates' grid for each point to keep
    largest_gap: float  # Distance from all others, in target spacings, beyond which a candidate is an outlier
    stages: tuple[FieldScale, ...]  # From the finest to the coarsest

    def refined(self, finer: Scale) -> Scale:
        """Return the scale of a choice of more points, and for stages that are too coarse for it this one."""
        coarser = tuple(stage for stage in self.stages if stage.spacing > 1.2 * finer.stages[-1].spacing)
        return finer._replace(stages=finer.stages + coarser)

    def at(self, spacing: float) -> FieldScale:
        """Return what holds at a target spacing, between those that are measured."""
        spacings = np.log([stage.spacing for stage in self.stages])
        columns = np.array(self.stages).T
        return FieldScale(*(float(np.interp(np.log(spacing), spacings, column)) for column in columns))
