import numpy as np
import pytest

from gppcs.errors import ParameterError
from gppcs.scans import SCANS, sample

EVERY = pytest.mark.parametrize("name", SCANS)


@EVERY
def test_normals_curvatures_and_areas_are_those_of_the_surface_by_finite_differences(name):
    step, rng = 1e-6, np.random.default_rng(0)
    for patch in SCANS[name].patches:
        (u0, u1), (v0, v1) = patch.u, patch.v
        du, dv = step * (u1 - u0), step * (v1 - v0)
        u, v = rng.uniform(u0 + 5 * du, u1 - 5 * du, 400), rng.uniform(v0 + 5 * dv, v1 - 5 * dv, 400)

        def slopes(part, u=u, v=v, patch=patch, du=du, dv=dv):
            east, west, north, south = (
                getattr(patch.at(*place), part) for place in ((u + du, v), (u - du, v), (u, v + dv), (u, v - dv))
            )
            return (east - west) / (2 * du), (north - south) / (2 * dv)

        at, (xu, xv), (nu, nv) = patch.at(u, v), slopes("points"), slopes("normals")
        across = np.cross(xu, xv)
        area = np.linalg.norm(across, axis=1)
        agrees = np.isclose(area, at.area_element, rtol=1e-4)
        agrees &= np.abs((across / area[:, None] * at.normals).sum(axis=1)) > 1 - 1e-6
        # The divergence of the normals is the trace of the shape operator.
        first = np.stack([np.stack([(a * b).sum(axis=1) for b in (xu, xv)]) for a in (xu, xv)]).transpose(2, 0, 1)
        second = np.stack([np.stack([(a * b).sum(axis=1) for b in (xu, xv)]) for a in (nu, nv)]).transpose(2, 0, 1)
        mean = np.trace(np.linalg.solve(first, second), axis1=1, axis2=2) / 2
        agrees &= np.isclose(at.curvature, mean, rtol=1e-2, atol=2e-3)
        assert agrees.mean() > 0.97  # a step may cross an edge of the relief
        assert at.area_element.max() <= patch.stretch * (1 + 1e-12)


@EVERY
def test_a_scan_has_its_attributes_and_its_box(name):
    count = 20_000 if name == "village" else 5000  # whose pylons are thin
    cloud = sample(name, count)
    assert len(cloud) == count
    assert {key: values.dtype.name for key, values in cloud.attributes.items()} == {
        **dict.fromkeys(("nx", "ny", "nz", "curvature"), "float32"),
        **dict.fromkeys(("red", "green", "blue"), "uint8"),
        **({"intensity": "uint16", "marking": "uint8"} if name == "street" else {}),
        **({"classification": "uint8"} if name == "village" else {}),
    }
    assert cloud.coordinate_dtype == np.float32
    np.testing.assert_array_equal(cloud.points, cloud.points.astype(np.float32))
    low, high = np.array(SCANS[name].box)
    assert np.all(cloud.points >= low - 1e-5)
    assert np.all(cloud.points <= high + 1e-5)
    np.testing.assert_allclose(np.ptp(cloud.points, axis=0), high - low, rtol=0.05)


@pytest.mark.parametrize(("n_points", "uneven"), [(1, 0.9), (2, 0.9), (70_001, 0.9), (300, 0.999), (300, 1e-310)])
def test_the_number_of_points_is_exact(n_points, uneven):
    assert len(sample("fan", n_points, uneven=uneven)) == n_points


def test_a_seed_gives_one_cloud():
    options = {"noise": 0.01, "outliers": 0.1, "uneven": 0.5}
    first, again = (sample("fan", 3000, **options, seed=4) for _ in range(2))
    np.testing.assert_array_equal(first.points, again.points)
    for key, values in first.attributes.items():
        np.testing.assert_array_equal(values, again.attributes[key])
    assert not np.array_equal(first.points, sample("fan", 3000, **options, seed=5).points)


def test_noise_has_the_standard_deviation_asked_for():
    clean, noisy = sample("sphere", 50_000), sample("sphere", 50_000, noise=0.01)
    sigma = 0.01 * 100.0 * np.sqrt(3.0)
    np.testing.assert_allclose((noisy.points - clean.points).std(axis=0), sigma, rtol=0.02)
    np.testing.assert_array_equal(noisy.normals(), clean.normals())


def test_outliers_have_the_share_asked_for_and_leave_the_others_alone():
    clean, cloud = sample("bracket", 20_000), sample("bracket", 20_000, outliers=0.05)
    outlier = cloud.attributes["outlier"].astype(bool)
    assert outlier.sum() == 1000
    np.testing.assert_array_equal(cloud.points[~outlier], clean.points[~outlier])
    from_centre = np.abs(cloud.points[outlier] - [0.0, 0.0, 35.0])
    assert np.all(from_centre <= [75.0, 45.0, 52.5])
    np.testing.assert_allclose(from_centre.mean(axis=0), [37.5, 22.5, 26.25], rtol=0.1)
    assert not cloud.normals()[outlier].any()


def test_uneven_density_falls_with_the_square_of_the_distance():
    x = sample("sphere", 100_000, uneven=0.9).points[:, 0]
    edges = np.linspace(-50.0, 50.0, 9)
    counts, _ = np.histogram(x, edges)
    assert np.all(np.diff(counts) < 0)
    # On a sphere, slices of one height have one area: the integral of 1/distance² remains.
    distance = 1.0 + (np.sqrt(10.0) - 1.0) * (edges + 50.0) / 100.0
    expected = np.diff(-1.0 / distance)
    np.testing.assert_allclose(counts / counts.sum(), expected / expected.sum(), rtol=0.04)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "braket"}, "found 'braket'; did you mean 'bracket'"),
        ({"name": "xyzzy"}, ", ".join(SCANS)),
        ({"n_points": 0}, "number of points to be a whole number from 1 on, found 0"),
        ({"noise": -0.1}, "0 or more, found -0.1"),
        ({"outliers": 1.0}, "outliers from 0 to below 1, found 1.0"),
        ({"uneven": -0.5}, "uneven from 0 to 0.999, found -0.5"),
        ({"uneven": 1 - 1e-12}, "uneven from 0 to 0.999, found 0.999999999999"),
        ({"n_points": 10**400}, "at most 100,000,000,000,000,000 points, found 10000"),
        ({"seed": -1}, "seed to be a whole number from 0 on, found -1"),
    ],
)
def test_arguments_out_of_range_are_refused(arguments, message):
    with pytest.raises(ParameterError, match=message):
        sample(**{"name": "sphere", **arguments})
