"""Continuous inducing points: the vertices of a surface go where, together, they explain all observations best.

Denoising estimates each point alone, so it rounds edges and lowers bumps. Here each observed point observes the
triangle nearest to it, and all steps of the vertices have one posterior (research/local-field.md).
"""

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg

from gppcs.engine.arrays import Floats
from gppcs.engine.blas import one_blas_thread
from gppcs.engine.kernels import kernel
from gppcs.engine.threads import on_ranges
from gppcs.spatial.spacing import surface_area
from gppcs.spatial.triangles import area_vector, dot, minus, row, unit
from gppcs.surface.local_surface import LocalSurface
from gppcs.surface.noise import MEDIAN


class Design(NamedTuple):
    """The n heights of observed points above their triangles as a linear function of steps of M vertices (Eq. (14))."""

    weights: csr_array  # (n, M), of the corners in the foot of each point
    normals: NDArray[np.float32]  # (n, 3), of the triangles; 0 for observations that do not count

    def times(self, steps: Floats) -> Floats:
        """Return by how much steps, (3 M,), raise each triangle below its point, (n,)."""
        return np.einsum("ij,ij->i", self.normals, self.weights @ steps.reshape(-1, 3))

    def transposed(self, heights: Floats) -> Floats:
        """Return the sums of heights, (n,), that each step takes part in, (3 M,)."""
        return (self.weights.T @ (self.normals * heights[:, np.newaxis])).ravel()


def inducing_points(kept: Floats, observed: Floats, denoised: Floats) -> tuple[Floats, bool]:
    """Return the kept points, (M, 3), after one step, by observed points, (n, 3), and where they are denoised.

    Returns also whether the solver converged.
    """
    if (noise := noise_between(observed, denoised)) == 0.0:
        return kept, True
    surface = LocalSurface.from_points(kept)
    feet = surface.find(denoised)
    in_tree_order = np.ascontiguousarray(surface.tree.points.T)
    spacing = np.sqrt(surface_area(surface.tree) / len(kept))
    moved = kept.copy()
    steps, converged = joint_steps(in_tree_order, feet.corners, feet.weights, observed, noise, spacing)
    moved[surface.tree.order] += steps
    return moved, converged


def noise_between(observed: Floats, denoised: Floats) -> float:
    """Return the noise that takes observed points from where they are denoised, (n, 3) both; 0 if there are none."""
    return float(np.median(np.linalg.norm(observed - denoised, axis=1))) / MEDIAN if len(observed) else 0.0


def joint_steps(
    vertices: Floats, corners: NDArray[np.integer], weights: Floats, observed: Floats, noise: float, spacing: float
) -> tuple[Floats, bool]:
    """Return the posterior mean of the steps of vertices, (M, 3), by observed points, (n, 3), and the noise (Eq. (15)).

    Each point observes the triangle nearest to where it is denoised. Shapes: corners (n, 3), and the weights of the
    second and the third in the foot of that (n, 2). Returns also whether the solver converged.
    """
    still = np.zeros_like(vertices)
    normals, heights = np.empty((len(observed), 3), dtype=np.float32), np.empty(len(observed))
    on_ranges(_observe, len(observed), vertices, corners, observed, normals, heights)
    counted = normals.any(axis=1)  # where corners coincide, there is no triangle
    if not counted.any():
        return still, True
    sigma = np.median(np.abs(heights[counted])) / MEDIAN
    counted &= np.abs(heights) <= 3.0 * sigma  # the others are outliers
    normals[~counted] = 0.0
    weights = np.column_stack([1.0 - weights.sum(axis=1), weights])
    begins = np.arange(0, corners.size + 1, 3)
    shape = len(observed), len(vertices)
    design = Design(csr_array((weights.ravel(), corners.ravel(), begins), shape=shape), normals)
    right_side = design.transposed(heights)
    # What all heights have in common is an error of the projections, and no evidence of steps that differ.
    different = design.transposed(np.where(counted, heights - heights[counted].mean(), 0.0))
    # Whatever the observations make likely, steps are no longer than this along each axis.
    prior = min(_likely(design, different, sigma), 0.18 * spacing, 0.3 * noise)
    return _posterior_mean(design, right_side, (max(sigma, noise) / prior) ** 2) if prior > 0.0 else (still, True)


@one_blas_thread()
def _likely(design: Design, right_side: Floats, sigma: float) -> float:
    """Return the standard deviation of the steps, by moments of the transposed heights (Eq. (16))."""
    by_noise = sigma**2 * (design.weights.power(2).sum(axis=1) * (design.normals**2).sum(axis=1)).sum()
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(right_side))
    trace = (design.transposed(design.times(signs)) ** 2).sum()
    return float(np.sqrt(max(right_side @ right_side - by_noise, 0.0) / trace)) if trace > 0.0 else 0.0


@one_blas_thread()
def _posterior_mean(design: Design, right_side: Floats, precision: float) -> tuple[Floats, bool]:
    """Return the steps, (M, 3), by the transposed heights and the prior's precision in that of an observation."""
    size = len(right_side)
    equations = LinearOperator(
        (size, size), lambda steps: design.transposed(design.times(steps)) + precision * steps, dtype=np.float64
    )
    steps, code = cg(equations, right_side, rtol=1e-4)
    if code:
        warnings.warn("the equations of inducing points were not solved to the end: points may lie off", stacklevel=2)
    return steps.reshape(-1, 3), code == 0


@kernel
def _observe(begin, end, vertices, corners, observed, normals, heights):
    """Fill the normals of the triangles, (n, 3), and the heights of observed points, (n, 3), above them, (n,)."""
    for i in range(begin, end):
        a, b, c = row(vertices, corners[i, 0]), row(vertices, corners[i, 1]), row(vertices, corners[i, 2])
        normal = unit(area_vector(a, b, c))
        heights[i] = dot(normal, minus(row(observed, i), a))
        for axis in range(3):
            normals[i, axis] = normal[axis]
