"""The paper's Algorithm 1 as its equations say, on all points."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, random_candidates

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.gp.spectral.kernel import Hyperparameters
    from gppcs.spatial.kdtree import KdTree

UPDATES = 200  # of the posterior in a run, unless k_add says otherwise


@dataclass(frozen=True)
class SpectralGP(Method):
    """A Gaussian process of the surface variation, and greedy choice by uncertainty plus error.

    Its diagnostics are the fitted hyperparameters, and "explained": the share of the variance of the surface
    variation over the candidates that the posterior mean given the chosen points explains (R squared; below zero
    where it is worse than a constant, as it can be when the chosen points are far from typical).

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
    iterations : int
        Of the optimiser, at most, from each start of the fit; it seldom takes more than 30.
    k_init : int, optional
        The number of farthest points to start from; a third of the points asked for where not given.
    k_add : int, optional
        Points added between two updates of the posterior; where not given, as many as make 200 updates. That
        bounds the time whatever the cloud, and chooses nearly the points that one at a time does.
    landmarks : int
        How many farthest points carry the eigenproblem of larger clouds.
    candidates : int, optional
        Choose among so many random points, as the paper's experiments do; among all where not given. Surface
        variation and field are those of the whole cloud either way.
    seed : int
        Of the choice of the k_opt points and of the candidates.
    """

    name = "gp-spectral"
    summary = "the paper's Gaussian process: a truncated Matérn kernel on the manifold, greedy choice"
    source = "Pathak, Baldwin-McDonald, Sels and Penne, GP-PCS, Algorithm 1"

    neighbours: int = 25
    eigenfunctions: int = 20
    nu: float = 2.5
    fit_nu: bool = False
    k_opt: int = 200
    iterations: int = 200
    k_init: int | None = None
    k_add: int | None = None
    landmarks: int = 4000
    candidates: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require(self.neighbours >= 3, "neighbours", "at least 3")
        self.require(self.eigenfunctions >= 1, "eigenfunctions", "at least 1")
        self.require(self.nu > 0, "nu", "above 0")
        self.require(not self.fit_nu or math.isfinite(self.nu), "nu", "finite where it is to be fitted")
        self.require(self.k_opt >= 1, "k_opt", "at least 1")
        self.require(self.iterations >= 1, "iterations", "at least 1")
        self.require(self.k_init is None or self.k_init >= 1, "k_init", "at least 1")
        self.require(self.k_add is None or self.k_add >= 1, "k_add", "at least 1")
        self.require(self.landmarks >= self.eigenfunctions, "landmarks", "at least the number of eigenfunctions")
        self.require(self.candidates is None or self.candidates >= 1, "candidates", "at least 1")
        self.require(self.seed >= 0, "seed", "at least 0")

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points; see `Method`."""
        import numpy as np

        from gppcs.gp.spectral import greedy
        from gppcs.gp.spectral.posterior import Posterior
        from gppcs.spatial.farthest_points import farthest_points
        from gppcs.spatial.kdtree import KdTree

        stages = stages or Stages()
        with stages("tree"):
            tree = KdTree.build(points)
        phi, y, theta = self._fitted_field(points, tree, stages)
        subset = random_candidates(len(points), self.candidates, n_points, self.seed)
        if len(subset) < len(points):
            points, phi, y, tree = points[subset], phi[subset], y[subset], KdTree.build(points[subset])
        k_init = min(self.k_init or max(1, n_points // 3), n_points)
        with stages("farthest points", k_init) as advanced:
            initial, _ = farthest_points(points, k_init, tree, advanced)
        with stages("greedy selection", n_points - k_init) as advanced:
            k_add = self.k_add or max(1, -(-(n_points - k_init) // UPDATES))
            indices, _ = greedy.select(phi, y, theta.noise, initial, n_points, k_add, tree.order, advanced)
        with stages("explained share"):
            mean, _ = Posterior.given(phi[indices], y[indices], theta.noise).predict(phi)
            explained = 1 - float(np.mean((mean - y) ** 2) / (np.var(y) or 1.0))
        return Selection(subset[indices], {**asdict(theta), "explained": explained})

    def _fitted_field(
        self, points: NDArray[np.float64], tree: KdTree, stages: Stages
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], Hyperparameters]:
        """Return the kernel's features, the surface variation, and the hyperparameters that fit them together."""
        import numpy as np

        from gppcs.gp.spectral import hyperparameters, kernel
        from gppcs.gp.spectral.laplacian import eigenpairs
        from gppcs.surface.surface_variation import estimate_features

        with stages("surface variation"):
            y = estimate_features(points, self.neighbours, tree=tree).surface_variation
        with stages("eigenfunctions"):
            pairs = eigenpairs(points, self.eigenfunctions, self.landmarks, tree)
        values, functions = pairs.eigenvalues, pairs.eigenfunctions
        with stages("hyperparameters"):
            mean_squares = np.einsum("nl,nl->l", functions, functions) / len(points)
            some = np.random.default_rng(self.seed).permutation(len(points))[: self.k_opt]
            theta = hyperparameters.fit(
                values, functions[some], y[some], mean_squares, self.nu, self.fit_nu, self.iterations
            )
            phi = kernel.kernel_features(functions, kernel.spectral_weights(values, mean_squares, theta))
        return phi, y, theta
