"""The method `gp-spectral`: the paper's Algorithm 1, exact on all points."""

import math
from dataclasses import asdict, dataclass

from gppcs.methods.method import Method, Selection, Task, random_candidates
from gppcs.methods.parameters import parameter, require


@dataclass(frozen=True)
class SpectralGP(Method):
    """The paper's Gaussian process of the surface variation on the manifold (Algorithm 1).

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=1000)
    >>> result = gppcs.simplify(cloud, n_points=90, method=gppcs.SpectralGP(eigenfunctions=10))
    >>> list(result.diagnostics)
    ['variance', 'lengthscale', 'nu', 'noise', 'explained']
    """

    name = "gp-spectral"
    summary = "the paper's Gaussian process: a truncated Matérn kernel on the manifold, greedy choice"
    description = (
        "Models the surface variation as a Gaussian process on the manifold. Starts with farthest points, and then "
        "chooses points greedily by the process's standard deviation plus its absolute error. On real scans random "
        "points often rebuild the surface better: twenty smooth functions cannot follow curvature, so the error "
        "decides, and the points crowd where surface variation is largest. The diagnostics are the fitted "
        'hyperparameters and "explained", the fraction of the variance of the surface variation over the candidates '
        "that the posterior mean given the chosen points explains (R squared). It is below zero if the mean predicts "
        "worse than a constant, which can happen if the chosen points are not typical. The diagnostic "
        '"unconverged" is there if the fit of the hyperparameters stopped before it converged.'
    )
    source = "Pathak, Baldwin-McDonald, Sels and Penne, GP-PCS, Algorithm 1"
    _bytes_per_point = 300

    neighbours: int = parameter(25, "k: about how many points a neighbourhood holds.", minimum=3)
    eigenfunctions: int = parameter(
        20, "L: the number of eigenfunctions to which the kernel of Eq. 6 is truncated.", minimum=1
    )
    nu: float = parameter(
        2.5, "Smoothness of the Matérn kernel; inf means the heat kernel.", minimum=0.001, maximum=math.inf
    )
    fit_nu: bool = parameter(False, "Fit nu as well; the fit starts from the given nu.")
    k_opt: int = parameter(200, "Number of random points to which the hyperparameters are fitted.", minimum=1)
    iterations: int = parameter(
        200, "Most iterations of the optimiser from each of its starts; it rarely needs more than 30.", minimum=1
    )
    k_init: int | None = parameter(
        None, "Number of farthest points to start from; by default, a third of the points asked for.", minimum=1
    )
    k_add: int | None = parameter(
        None,
        "Points added between two updates of the posterior. By default, as many as lead to 200 updates. This bounds "
        "the time for any cloud, and chooses nearly the same points as one at a time.",
        minimum=1,
    )
    landmarks: int = parameter(
        4000, "Number of farthest points on which the eigenproblem is solved; all points in clouds that have no more."
    )
    candidates: int | None = parameter(
        None,
        "Choose among this many random points, as the paper's experiments do; by default, among all. Surface variation "
        "and process are always those of the whole cloud.",
        minimum=1,
    )
    seed: int = parameter(0, "Seed of the random k_opt points and candidates.", minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, not self.fit_nu or math.isfinite(self.nu), "nu", "finite where it is to be fitted")
        require(self, self.landmarks >= self.eigenfunctions, "landmarks", "at least the number of eigenfunctions")

    def __call__(self, task: Task) -> Selection:
        """Choose the points in the order of the paper's Algorithm 1."""
        import numpy as np

        from gppcs.engine.blas import one_blas_thread
        from gppcs.gp.spectral import greedy, hyperparameters, kernel
        from gppcs.gp.spectral.laplacian import eigenpairs
        from gppcs.gp.spectral.posterior import posterior
        from gppcs.spatial.farthest_points import farthest_points
        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.spacing import neighbourhood_radius
        from gppcs.surface.surface_variation import features_in_radius

        points, n_points, timer = task.points, task.n_points, task.timer
        k_init = min(self.k_init or max(1, n_points // 3), n_points)
        with timer("tree"):
            tree = KdTree.build(points)
        with timer("surface variation"):  # y, Eqs. 1 and 2
            y = features_in_radius(tree, neighbourhood_radius(tree, self.neighbours)).surface_variation
        landmarks = self.landmarks if self.landmarks < len(points) else 0
        with timer("farthest points", max(k_init, landmarks)) as on_progress:  # P_simp <- FPS(P, k_init)
            initial, _ = farthest_points(points, max(k_init, landmarks), tree, on_progress)
        with timer("eigenfunctions"):  # lambda_n and f_n of Eq. 6
            eigenvalues, functions = eigenpairs(points, self.eigenfunctions, initial[:landmarks] if landmarks else None)
        with timer("hyperparameters"):
            # P_opt <- random subset of P
            opt = np.random.default_rng(self.seed).permutation(len(points))[: self.k_opt].copy()
            theta, converged = hyperparameters.fit(  # optimise theta using Eq. 5
                eigenvalues, functions.at(points[opt]), y[opt], self.nu, self.fit_nu, self.iterations
            )
        subset = random_candidates(len(points), self.candidates, n_points, self.seed)
        if len(subset) < len(points):
            points, y = points[subset], y[subset]
            tree = KdTree.build(points)
            with timer("farthest points", k_init) as on_progress:
                initial, _ = farthest_points(points, k_init, tree, on_progress)
        with timer("features"):  # at the points in tree order
            weights = kernel.spectral_weights(eigenvalues, theta)
            features = functions._replace(values=kernel.kernel_features(functions.values, weights))  # Eq. 6
            phi, order, initial = features.at(tree.points.T), tree.order, tree.positions()[initial[:k_init]]
            y = y[order]
            del tree  # large
        with timer("greedy selection", n_points - k_init) as on_progress:  # while |P_simp| < M: add MAX(s, R, k_add)
            k_add = self.k_add or max(1, -(-(n_points - k_init) // 200))  # about 200 updates
            chosen = greedy.select(phi, y, theta.noise, initial, n_points, k_add, order, on_progress)
        with timer("explained variance"), one_blas_thread():
            mean, _ = posterior(phi[chosen], y[chosen], theta.noise)
            explained = 1 - float(np.mean((phi @ mean - y) ** 2) / (np.var(y) or 1.0))
        diagnostics = {**asdict(theta), "explained": explained}
        if not converged:
            diagnostics["unconverged"] = 1.0
        return Selection(subset[order[chosen]], diagnostics)
