"""The method `fps-variation`: farthest points, then the points of largest surface variation."""

from dataclasses import dataclass

from gppcs.methods.method import Method, Selection, Task, random_candidates
from gppcs.methods.parameters import parameter


@dataclass(frozen=True)
class FarthestPointVariation(Method):
    """Farthest points, then the points of largest surface variation."""

    name = "fps-variation"
    summary = "farthest points, then the points of largest surface variation"
    description = (
        "Chooses `k_init` points by farthest point sampling, and then the points of largest surface variation among "
        "the rest. `gp-pcs-released` is another name: with random candidates, it gives what the authors of GP-PCS "
        "published."
    )
    source = "reproduces the paper's ablation table and published clouds; see benchmarks/paper"

    k_init: int | None = parameter(
        None, "Number of farthest points; by default, a third of the points asked for.", minimum=1
    )
    neighbours: int = parameter(25, "About how many points a neighbourhood holds.", minimum=3)
    candidates: int | None = parameter(
        None,
        "Choose among this many random points, as the paper does on large clouds; by default, among all. The surface "
        "variation is always measured in the whole cloud.",
        minimum=1,
    )
    seed: int = parameter(0, "Seed of the random candidates.", minimum=0)

    def __call__(self, task: Task) -> Selection:
        import numpy as np

        from gppcs.spatial.farthest_points import farthest_points
        from gppcs.surface.surface_variation import estimate_features

        points, n_points, timer = task.points, task.n_points, task.timer
        with timer("surface variation"):
            variation = estimate_features(points, self.neighbours).surface_variation
        subset = random_candidates(len(points), self.candidates, n_points, self.seed)
        points, variation = points[subset], variation[subset]
        k_init = min(self.k_init or max(1, n_points // 3), n_points)
        with timer("farthest points", k_init) as on_progress:
            initial, _ = farthest_points(points, k_init, on_progress=on_progress)
        variation[initial] = -np.inf
        indices = np.concatenate([initial, np.argsort(-variation, kind="stable")[: n_points - k_init]])
        return Selection(subset[indices])
