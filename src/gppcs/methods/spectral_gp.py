"""The paper's Algorithm 1 as its equations say, on all points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.methods.method import Method, Selection
from gppcs.stages import Stages

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class SpectralGP(Method):
    """A Gaussian process of the surface variation, and greedy choice by uncertainty plus error.

    Parameters
    ----------
    neighbours : int
        k: about how many points a neighbourhood holds.
    eigenfunctions : int
        L: at how many terms the kernel of Eq. 6 is cut off.
    nu : float
        Smoothness of the Matérn kernel; inf for the heat kernel.
    fit_nu : bool
        Fit nu to the cloud as well, with the value given as the start.
    k_opt : int
        How many random points the hyperparameters are fitted on.
    k_init : int, optional
        The number of farthest points to start from; a third of the points asked for where not given.
    k_add : int
        Points added between two updates of the posterior. One, as in Lalchand and Faul (2018): the update is
        cheap here, and in a larger batch, points that say the same are chosen together.
    landmarks : int
        How many farthest points carry the eigenproblem of larger clouds.
    seed : int
        Of the choice of the k_opt points.
    """

    name = "gp-spectral"
    summary = "the paper's Gaussian process: a truncated Matérn kernel on the manifold, greedy choice"
    source = "Pathak, Baldwin-McDonald, Sels and Penne, GP-PCS, Algorithm 1"

    neighbours: int = 25
    eigenfunctions: int = 20
    nu: float = 2.5
    fit_nu: bool = False
    k_opt: int = 200
    k_init: int | None = None
    k_add: int = 1
    landmarks: int = 4000
    seed: int = 0

    def __post_init__(self) -> None:
        self.require(self.neighbours >= 3, "neighbours", "at least 3")
        self.require(self.eigenfunctions >= 1, "eigenfunctions", "at least 1")
        self.require(self.nu > 0, "nu", "above 0")
        self.require(not self.fit_nu or math.isfinite(self.nu), "nu", "finite where it is to be fitted")
        self.require(self.k_opt >= 1, "k_opt", "at least 1")
        self.require(self.k_init is None or self.k_init >= 1, "k_init", "at least 1")
        self.require(self.k_add >= 1, "k_add", "at least 1")
        self.require(self.landmarks >= self.eigenfunctions, "landmarks", "at least the number of eigenfunctions")
        self.require(self.seed >= 0, "seed", "at least 0")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        from gppcs import greedy, hyperparameters, matern
        from gppcs.farthest_point import farthest_points
        from gppcs.features import estimate_features
        from gppcs.kdtree import KdTree
        from gppcs.laplacian import eigenpairs

        stages = stages or Stages()
        with stages("tree"):
            tree = KdTree.build(points)
        with stages("surface variation"):
            y = estimate_features(points, self.neighbours, tree=tree).surface_variation
        with stages("eigenfunctions"):
            pairs = eigenpairs(points, self.eigenfunctions, self.landmarks, tree)
        with stages("hyperparameters"):
            mean_squares = np.einsum("nl,nl->l", pairs.eigenfunctions, pairs.eigenfunctions) / len(points)
            optimised = np.random.default_rng(self.seed).permutation(len(points))[: self.k_opt]
            theta = hyperparameters.fit(
                pairs.eigenvalues,
                pairs.eigenfunctions[optimised],
                y[optimised],
                mean_squares,
                self.nu,
                self.fit_nu,
            )
            weights = matern.spectral_weights(pairs.eigenvalues, mean_squares, theta)
            phi = matern.kernel_features(pairs.eigenfunctions, weights)
        k_init = min(self.k_init or max(1, n_points // 3), n_points)
        with stages("farthest points", k_init) as advanced:
            initial, _ = farthest_points(points, k_init, tree, advanced)
        with stages("greedy selection", n_points - k_init) as advanced:
            indices, _ = greedy.select(phi, y, theta.noise, initial, n_points, self.k_add, tree.order, advanced)
        return Selection(
            indices,
            {
                "variance": theta.variance,
                "lengthscale": theta.lengthscale,
                "nu": theta.nu,
                "noise": theta.noise,
            },
        )
