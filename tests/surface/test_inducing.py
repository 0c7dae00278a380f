"""Continuous inducing points: the step of the kept points is the mean of the posterior, and their surface is nearer."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import gppcs
from gppcs.surface import inducing
from gppcs.surface.local_surface import LocalSurface
from shapes import noisy, on_sphere, square


def test_the_step_is_the_mean_of_the_posterior():
    places = on_sphere(3000)
    observed, kept = noisy(places, 0.02), noisy(places[:80], 0.01)
    moved, converged = inducing.inducing_points(kept, observed, places)
    steps = moved - kept

    surface = LocalSurface.from_points(kept)
    _, corners, weights, *_ = surface.find(places)
    corners, shares = surface.tree.order[corners], np.column_stack([1 - weights.sum(axis=1), weights])
    a, b, c = (kept[corner] for corner in corners.T)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)[:, None]
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)  # 0 at the kept points
    heights = ((observed - np.einsum("ij,ijk->ik", shares, kept[corners])) * normals).sum(axis=1)
    noise = np.median(np.linalg.norm(observed - places, axis=1)) / inducing.MEDIAN
    level = np.median(np.abs(heights[lengths[:, 0] > 0.0])) / inducing.MEDIAN
    design = np.zeros((len(observed), len(kept), 3))
    for corner in range(3):
        design[np.arange(len(observed)), corners[:, corner]] += shares[:, corner, None] * normals
    design[np.abs(heights) > 3.0 * level] = 0.0
    design = design.reshape(len(observed), -1)
    spacing = np.sqrt(inducing.surface_area(surface.tree) / len(kept))
    normal, asked = design.T @ design, design.T @ heights
    different = design.T @ (heights - heights[design.any(axis=1)].mean())
    likely = np.sqrt((different @ different - level**2 * np.trace(normal)) / (normal**2).sum())
    prior = min(likely, 0.18 * spacing, 0.3 * noise)
    assert prior < likely / 1.5  # so that the trace, which random signs tell, decides nothing here
    precision = (max(level, noise) / prior) ** 2
    expected = np.linalg.solve(normal + precision * np.eye(kept.size), asked)
    assert np.abs(steps.ravel() - expected).max() < 1e-3 * np.abs(expected).max()
    assert np.abs(expected).max() > 1e-3
    assert converged


def test_equations_that_are_not_solved_to_the_end_are_noted(monkeypatch):
    solve = inducing.cg
    monkeypatch.setattr(inducing, "cg", lambda *arguments, **options: solve(*arguments, **options, maxiter=1))
    cloud, denoise = gppcs.sample("bracket", n_points=20_000, noise=0.005), gppcs.LocalGP(denoise=True)
    with pytest.warns(UserWarning, match="not solved to the end"):
        assert gppcs.simplify(cloud, n_points=300, method=denoise).diagnostics["unconverged"] == 1.0
    with pytest.warns(UserWarning, match="not solved to the end"):
        assert gppcs.mesh(cloud, n_points=300, moved=True).diagnostics.unconverged
    monkeypatch.undo()
    assert "unconverged" not in gppcs.simplify(cloud, n_points=300, method=denoise).diagnostics
    assert not gppcs.mesh(cloud, n_points=300, moved=True).diagnostics.unconverged


@pytest.mark.parametrize("share", [0.4, 0.6])
def test_many_kept_points_hardly_move_where_noise_alone_explains_the_observations(share):
    places = square(5000)
    smoothed = noisy(places, 0.01) * [1.0, 1.0, 0.0]
    kept = smoothed[: round(share * 5000)]
    assert np.abs(inducing.inducing_points(kept, noisy(places, 0.01), smoothed)[0] - kept).mean() < 0.0005


def test_observations_without_noise_leave_the_kept_points_where_they_are():
    points = on_sphere(2000)
    assert np.array_equal(inducing.inducing_points(points[:100], points, points)[0], points[:100])


def test_the_prior_of_the_steps_follows_from_the_observations():
    rng, places = np.random.default_rng(2), on_sphere(8000)
    kept = places[:400]
    surface = LocalSurface.from_points(kept)
    _, corners, weights, *_ = surface.find(places)
    a, b, c = (surface.tree.points.T[corner] for corner in corners.T)
    normals = np.cross(b - a, c - a)
    normals[400:] /= np.linalg.norm(normals[400:], axis=1)[:, None]
    weights = np.column_stack([1 - weights.sum(axis=1), weights])
    rows = np.arange(0, corners.size + 1, 3)
    design = inducing.Design(csr_array((weights.ravel(), corners.ravel(), rows), shape=(8000, 400)), normals)
    for true in (0.01, 0.02):
        heights = design.times(true * rng.standard_normal(1200)) + 0.02 * rng.standard_normal(8000)
        assert inducing._likely(design, design.transposed(heights), 0.02) == pytest.approx(true, rel=0.3)
