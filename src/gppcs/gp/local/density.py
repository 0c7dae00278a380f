"""The desired spacing at each place: small where the surface is rough.

The rows "density off" and "segregation off" of the ablation (benchmarks/results/gp_ablation.md) show
what the parts are worth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Flat places count as this rough, so that they are not left bare. Without it, H max is 6 % larger; 0.03 is as good and
# 0.1 is 1 % worse in H mean (research/experiments.md, "floor of the roughness").
LEAST_ROUGHNESS = 0.05
EDGE_ROUGHNESS = 0.29  # Roughness on a right-angled edge: 0.292 at any radius (research/experiments.md).
ROUNDNESS_POWER = 4.0  # Of 1 - S^2 for a segregation S. The larger, the less flat faces with edges count as round.
# Near a jump of the weights, and where normals turn much from one point to the next, the choice follows the desired
# spacings less than it should. With this power of the weights, densities have the wanted ratio (docs/ask.md).
WEIGHT_POWER = 1.15
FINEST = 8.0  # Times the usual number of candidates at most, where large weights want many points in few places.
ROUNDING = 1e-12  # Surface variation, or its standard deviation, below this is only rounding.


def density_of(roughness: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Return the wanted density of points, up to a factor, given the roughness of n places, (n,).

    It is a power of the roughness, as a piecewise linear surface of given size has the least mean error if its density
    goes as the square root of the curvature.
    """
    return np.maximum(roughness, LEAST_ROUGHNESS) ** power


def weighted(spacings: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return spacings of n places with their density multiplied by weights, (n,); the mean of the density is 1."""
    density = weights**WEIGHT_POWER * spacings**-2.0
    return np.sqrt(np.mean(density) / density)


def refinement(weights: NDArray[np.float64]) -> float:
    """Return how many times as many candidates are needed as without weights, (N,)."""
    return min(float(weights.max() / weights.mean()), FINEST)


def roundness_of(roughness: NDArray[np.float64]) -> float:
    """Return from 1 for a cloud whose places are alike to 0 for flat faces and edges only, given roughness, (n,).

    It depends on the variance of the roughness, divided by the largest variance that values from 0 to `EDGE_ROUGHNESS`
    with the same mean can have: the intensity of segregation of a mixture (Danckwerts 1952). That is 1 for flat faces
    and right-angled edges only, and 0 if all places are alike.
    """
    clipped = np.minimum(roughness, EDGE_ROUGHNESS)
    mean = float(np.mean(clipped))
    most = mean * (EDGE_ROUGHNESS - mean)
    segregation = float(np.var(clipped)) / most if most > ROUNDING else 0.0
    return (1.0 - min(segregation, 1.0) ** 2) ** ROUNDNESS_POWER
