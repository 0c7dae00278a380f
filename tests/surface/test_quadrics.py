import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gppcs.spatial.kdtree import KdTree
from gppcs.surface.quadrics import TWO_PEAKS, fit_quadrics
from shapes import rotation

LATTICE = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 2), axis=-1).reshape(-1, 2)


def fitted(points, place, k=None):
    """Height in the points' unit along the normal, and the normal."""
    points, place = np.asarray(points, dtype=np.float64), np.asarray(place, dtype=np.float64)
    k = k or len(points)
    (height,), ((x,), (y,), (z,)), (reach,), _ = fit_quadrics(KdTree.build(points), KdTree.build(place[None]), k)
    assert (
        reach == pytest.approx(np.sort(np.linalg.norm(points - place, axis=1))[k - 1], rel=1e-14, abs=1e-300)
        or reach == 1
    )
    return height, np.array([x, y, z])


def plain_fit(points, place, k):
    """Height and normal by NumPy's eigensolver and weighted least squares, and the slope."""
    local = points[np.argsort(((points - place) ** 2).sum(axis=1))[:k]] - place
    reach = np.linalg.norm(local, axis=1).max()
    _, axes = np.linalg.eigh(np.cov(local.T))
    z, u, v = (local / reach @ axes).T
    terms = np.column_stack([np.ones(k), u, v, u * u, u * v, v * v])
    root = np.exp(-(u * u + v * v) / 2)
    a, b, c = np.linalg.lstsq(terms * root[:, None], z * root, rcond=None)[0][:3]
    length = np.sqrt(1 + b * b + c * c)
    return a / length * reach, axes @ [1, -b, -c] / length, np.hypot(b, c)


@given(st.integers(15, 60), st.integers(12, 40), st.integers(0, 999))
def test_equals_least_squares_and_turns_with_the_points(n, k, seed):
    rng, turn, k = np.random.default_rng(seed), rotation(seed), min(n, k)
    u, v = rng.random((2, n))
    points = np.column_stack([u, v, 0.2 * np.sin(5 * u) * v + 0.02 * rng.standard_normal(n)])
    place = points[0] + 0.03 * rng.standard_normal(3)
    expected_height, expected_normal, slope = plain_fit(points, place, k)
    if slope > 1.7:
        return
    height, normal = fitted(points, place, k)
    assert np.sign(normal @ expected_normal) * height == pytest.approx(expected_height, abs=1e-4)
    assert abs(normal @ expected_normal) > 1 - 1e-6
    turned_height, turned_normal = fitted(points @ turn.T, turn @ place, k)
    assert abs(turned_normal @ turn @ normal) > 1 - 1e-8
    assert abs(turned_height) == pytest.approx(abs(height), abs=1e-5)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_fewer_than_six_points_give_their_plane_and_no_height(n):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.random((n, 2)), np.full(n, 3.0)])
    height, normal = fitted(points, [0.5, 0.5, 3.2])
    assert height == 0
    np.testing.assert_allclose(np.abs(normal), [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 6, 20])
def test_points_on_a_line_give_a_normal_across_it(n):
    along = np.array([1.0, 2, 2]) / 3
    place = 0.3 * along
    height, normal = fitted(np.linspace(0, 1, n)[:, None] * along, place)
    assert np.linalg.norm(normal) == pytest.approx(1)
    assert height == pytest.approx(0, abs=1e-7)
    if n > 1:
        assert normal @ along == pytest.approx(0, abs=1e-7)


def test_a_steep_place_keeps_the_plane_it_stands_on():
    """A paraboloid far from where its points are, at a slope of 2.4."""
    surface = np.column_stack([LATTICE, 0.4 * (LATTICE**2).sum(axis=1)])
    _, normal = fitted(surface, [3.0, 0.0, 3.6])
    np.testing.assert_allclose(np.abs(normal), [0, 0, 1], atol=1e-9)
    _, normal = fitted(surface, [2.0, 0.0, 1.6])
    np.testing.assert_allclose(normal / normal[2], [-1.6, 0, 1], atol=1e-5)


def test_many_places_at_a_time_as_each_by_itself():
    """A leaf's places share a search, unless density jumps, or ties leave no ball with just k points."""
    rng = np.random.default_rng(0)
    lattice = np.column_stack([np.indices((30, 30)).reshape(2, -1).T * 0.02, np.zeros(900)])
    points = np.concatenate([rng.random((3_000, 3)) * [1, 1, 0.1], lattice, [[40.0, 0, 0]]])
    tree, places = KdTree.build(points), points[::3] + 0.01 * rng.standard_normal((len(points[::3]), 3))
    of_places = KdTree.build(places)
    together = fit_quadrics(tree, of_places, 20)
    for i in range(0, len(places), 7):
        height, normal = fitted(points, places[of_places.order[i]], 20)
        assert abs(together.heights[i]) == pytest.approx(abs(height), abs=1e-9)
        assert abs(together.normals[:, i] @ normal) == pytest.approx(1.0, abs=1e-9)


def test_queries_near_a_fit_take_its_quadric():
    """On a smooth surface it is nearly that of each, on both sides of the surface."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, 4_000))
    points = np.column_stack([x, y, 0.2 * np.sin(2 * x) * np.cos(y)]) @ rotation(0)
    tree = KdTree.build(points)
    queries = KdTree.build(points[::2] + 0.01 * rng.standard_normal((2_000, 3)))
    single, shared = (fit_quadrics(tree, queries, 30, within) for within in (0.0, 0.5))
    assert len(np.unique(single.radii)) == 2_000
    assert len(np.unique(shared.radii)) < 1_200
    np.testing.assert_allclose(np.abs(shared.heights), np.abs(single.heights), atol=1e-4)
    assert np.abs((shared.normals * single.normals).sum(axis=0)).min() > np.cos(np.radians(1))


def test_a_fit_that_sees_two_sheets_is_that_of_the_own_one():
    """Two bent sheets, 2.5 spacings apart: a quadric of both lies between them."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1.0, 1.0, (2, 4_000))
    upper = rng.random(4_000) < 0.5
    points = np.column_stack([x, y, 0.2 * x * x - 0.3 * x * y + 0.08 * upper])
    tree = KdTree.build(points)
    own, both = (fit_quadrics(tree, tree, 60, sheets=sheets) for sheets in (TWO_PEAKS, 0.0))
    inner = (np.abs(tree.points[:2]) < 0.8).all(axis=0)
    two = own.two_sheets & inner
    assert np.array_equal(own.take(np.flatnonzero(inner)).two_sheets, own.two_sheets[inner])
    assert two.sum() > 0.7 * inner.sum()
    assert np.quantile(np.abs(own.heights[two]), 0.99) < 0.004
    assert np.median(np.abs(both.heights[two])) == pytest.approx(0.04, rel=0.1)


@pytest.mark.parametrize(
    ("heights", "kurtosis"),
    [
        (lambda rng, n: rng.random(n) < 0.5, 1.0),
        (lambda rng, n: rng.random(n), 1.8),
        (lambda rng, n: rng.standard_normal(n), 3.0),
        (lambda rng, n: 4.0 * (rng.random(n) < 0.5) + rng.standard_normal(n), 1.72),
    ],
)
def test_the_kurtosis_tells_sheets_from_noise(heights, kurtosis):
    """Its values are those of two points, a uniform and a normal distribution, and of two normal ones; 2 at a rim."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1.0, 1.0, (20_000, 2)), 1e-3 * heights(rng, 20_000)])
    is_middle = (np.abs(points[:, :2]) < 0.5).all(axis=1)
    middle, rim = (KdTree.build(points[where]) for where in (is_middle, points[:, 0] > 0.99))
    fitted, at_rim = (fit_quadrics(KdTree.build(points), queries, 400, sheets=2.3) for queries in (middle, rim))
    assert np.median(fitted.kurtosis) == pytest.approx(kurtosis, rel=0.05)
    assert np.isinf(at_rim.kurtosis).all()


@given(
    st.tuples(*[st.floats(-0.25, 0.25)] * 3),
    st.floats(-0.5, 0.5),
    st.tuples(*[st.floats(-0.6, 0.6)] * 2),
    st.integers(0, 99),
)
def test_a_quadric_is_met_exactly_on_and_off_the_surface(bends, off, foot, seed):
    """Over a lattice without slope on the whole, so that the plane fitted is the quadric's; then turned."""
    (d, e, f), (u, v), turn = bends, foot, rotation(seed)
    surface = np.column_stack([LATTICE, d * LATTICE[:, 0] ** 2 + e * LATTICE.prod(axis=1) + f * LATTICE[:, 1] ** 2])
    exact_normal = np.array([-2 * d * u - e * v, -e * u - 2 * f * v, 1])
    steepness = np.linalg.norm(exact_normal)
    place = np.array([u, v, d * u * u + e * u * v + f * v * v + off])
    height, normal = fitted(surface @ turn.T, turn @ place)
    sign = np.sign(normal @ turn @ exact_normal)
    np.testing.assert_allclose(sign * normal, turn @ exact_normal / steepness, atol=1e-6)
    assert sign * height == pytest.approx(-off / steepness, abs=1e-6)
