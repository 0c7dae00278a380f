"""The paper's equations with dense matrices, as plain as they can be written: oracles for small clouds."""

import numpy as np

from gppcs.gp.local.kernel import LocalField


def posterior(phi, y, noise, active):
    """Mean and variance everywhere, given the active points (Eqs. 3 and 4)."""
    kernel = phi @ phi.T
    across = kernel[:, active]
    inverse = np.linalg.inv(kernel[np.ix_(active, active)] + noise * np.eye(len(active)))
    mean = across @ inverse @ y[active]
    variance = np.diag(kernel) - np.einsum("ia,ab,ib->i", across, inverse, across)
    return mean, variance


def log_marginal_likelihood(phi, y, noise):
    """Eq. 5."""
    covariance = phi @ phi.T + noise * np.eye(len(y))
    _, log_determinant = np.linalg.slogdet(covariance)
    return -0.5 * (y @ np.linalg.solve(covariance, y) + log_determinant + len(y) * np.log(2 * np.pi))


def greedy(phi, y, noise, initial, n_points, k_add):
    """Algorithm 1."""
    active = list(initial)
    while len(active) < n_points:
        mean, variance = posterior(phi, y, noise, active)
        score = np.sqrt(np.maximum(variance, 0)) + np.abs(mean - y)
        score[active] = -np.inf
        active += np.argsort(-score, kind="stable")[: min(k_add, n_points - len(active))].tolist()
    return np.array(active)


def local_field(rng, positions, spread, normal_weight):
    """A field of random values and details at (3, n) positions; spacings differ by up to exp(2 spread)."""
    n = positions.shape[1]
    normals = rng.standard_normal((3, n))
    normals /= np.linalg.norm(normals, axis=0)
    spacings = np.exp(rng.uniform(-spread, spread, n))
    y, noise, detail = rng.standard_normal(n), rng.random(n), 0.3 * rng.standard_normal((2, n))
    return LocalField(positions, normals, spacings, y, noise, detail, 1.5, normal_weight)


def local_squared_distances(field):
    """Of all pairs: positions by the mean of the squared spacings, normals as projections, and details."""
    gaps = ((field.positions[:, :, None] - field.positions[:, None, :]) ** 2).sum(axis=0)
    projections = np.einsum("an,bn->nab", field.normals, field.normals).reshape(len(field.y), 9)
    across = ((projections[:, None] - projections) ** 2).sum(axis=2) / 2
    squares, apart = field.spacings**2, ((field.detail[:, :, None] - field.detail[:, None, :]) ** 2).sum(axis=0)
    return gaps / ((squares[:, None] + squares) / 2) + field.normal_weight**2 * across + apart


def local_kernel(field):
    """Matérn 5/2 of that distance, with the factor of Paciorek and Schervish for spacings that differ."""
    spacings = field.spacings
    even = 2 * np.outer(spacings, spacings) / (spacings[:, None] ** 2 + spacings**2)
    a = np.sqrt(5 * local_squared_distances(field)) / field.lengthscale
    return even**1.5 * (1 + a + a**2 / 3) * np.exp(-a)


def local_posterior(kernel, field, i, given):
    """Mean and variance at a point, given a few (Eqs. 3 and 4)."""
    across = kernel[i, given]
    weights = np.linalg.solve(kernel[np.ix_(given, given)] + np.diag(field.noise[given]), across)
    return weights @ field.y[given], max(1 - weights @ across, 0.0)


def local_scores(kernel, field, nearest, error_weight):
    """Score and standard deviation of each point, given those nearest it."""
    mean, variance = np.array([local_posterior(kernel, field, i, given) for i, given in enumerate(nearest)]).T
    gain = variance / (variance + field.noise)
    return np.sqrt(gain * variance) + error_weight * gain * np.abs(mean - field.y), np.sqrt(variance)


def distances_to_triangles(points, triangles):
    """The distance of each of (P, 3) points to the nearest of (F, 3, 3) triangles: to its inside or to a side."""
    least = np.full(len(points), np.inf)
    for a, b, c in triangles:
        for begin, end in ((a, b), (b, c), (c, a)):
            along = end - begin
            share = np.clip((points - begin) @ along / max(along @ along, 1e-300), 0, 1)
            least = np.minimum(least, np.linalg.norm(points - begin - share[:, None] * along, axis=1))
        normal = np.cross(b - a, c - a)
        if (area := np.linalg.norm(normal)) > 1e-12:
            left = [np.cross(end - begin, points - begin) @ normal for begin, end in ((a, b), (b, c), (c, a))]
            inside = (np.array(left) >= 0).all(axis=0)
            least[inside] = np.minimum(least[inside], np.abs((points[inside] - a) @ normal) / area)
    return least
