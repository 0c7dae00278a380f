"""The figures of a simplification: their definitions, what leaves them as they are, what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import gppcs
from dense import distances_to_triangles
from gppcs.evaluation import reconstruction
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.spacing import surface_area
from gppcs.surface.local_surface import LocalSurface
from meshes import hull_mesh
from shapes import square

ZERO_FOR_ITSELF = (
    "covering_radius", "covering_p999", "mean_distance", "mean_distance_by_area", "chamfer", "surface_mean",
    "surface_mean_by_area", "surface_rms", "surface_p95", "surface_p95_by_area", "surface_max", "feature_error",
    "feature_error_by_area", "normal_deviation",
)  # fmt: skip
OF_THE_BOX = ("diagonal", "mean_surface_variation")  # the paper's radius follows the bounding box


@pytest.fixture(scope="module", autouse=True)
def coarse_octree():
    """Rebuild quickly. The fixture is the depth of octrees without it."""
    depth = reconstruction.OCTREE_DEPTH
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reconstruction, "OCTREE_DEPTH", 6)
        yield depth


@pytest.fixture(scope="module")
def sphere(sphere):
    return sphere[:15_000]


@pytest.fixture(scope="module")
def pair():
    original = gppcs.sample("bracket", 2000, noise=0.001).points
    return original, original[gppcs.simplify(original, n_points=150, method="fps").indices]


def test_a_cloud_against_itself_is_zero(pair):
    repeated = np.concatenate([pair[0], pair[0][:100]])
    for original in (pair[0], repeated):
        report = gppcs.evaluate(original, original)
        assert [getattr(report, name) for name in ZERO_FOR_ITSELF] == [0] * len(ZERO_FOR_ITSELF)
        assert (report.points_in, report.points_out, report.feature_recall) == (len(original), len(original), 1)


def test_distances_equal_their_definitions(pair):
    original, simplified = pair
    simplified = simplified + 0.5  # so that neither direction is zero
    distance = cdist(original, simplified)
    report = gppcs.evaluate(original, simplified)
    assert report.covering_radius == pytest.approx(distance.min(axis=1).max())
    assert report.mean_distance == pytest.approx(distance.min(axis=1).mean())
    assert report.chamfer == pytest.approx((distance.min(axis=1) ** 2).mean() + (distance.min(axis=0) ** 2).mean())
    assert report.diagonal == pytest.approx(np.linalg.norm(np.ptp(original, axis=0)))
    distances, _ = LocalSurface.from_points(simplified).nearest_to(original)
    assert report.surface_mean == pytest.approx(distances.mean())
    assert report.surface_rms == pytest.approx(np.sqrt((distances**2).mean()))
    assert report.surface_p95 == pytest.approx(np.quantile(distances, 0.95))
    assert report.surface_max == pytest.approx(distances.max())


def plane_normals(points, k=12):
    """The direction in which each point's neighbourhood is thinnest."""
    order = np.argsort(cdist(points, points), axis=1, kind="stable")[:, :k]
    return np.array([np.linalg.eigh(np.cov(points[near].T))[1][:, 0] for near in order])


def test_the_feature_error_is_the_mean_of_distance_times_angle(pair):
    original, simplified = pair
    distances, normals = LocalSurface.from_points(simplified).nearest_to(original)
    cosines = np.abs(np.einsum("ij,ij->i", plane_normals(original), normals)) / np.linalg.norm(normals, axis=1)
    expected = (distances * np.arccos(np.minimum(cosines, 1))).mean()
    assert gppcs.evaluate(original, simplified).feature_error == pytest.approx(expected, rel=1e-4)


def variation_of(points, neighbours):
    """The share of the smallest eigenvalue of the covariance of each point's neighbours."""
    eigenvalues = np.array([np.linalg.eigvalsh(np.cov(points[near].T, bias=True)) for near in neighbours])
    return eigenvalues[:, 0] / eigenvalues.sum(axis=1)


def test_recall_equals_a_count(pair):
    original = pair[0]
    simplified = original[np.argsort(original[:, 0])[:1200:8]]  # of a part
    variation = variation_of(original, np.argsort(cdist(original, original), axis=1)[:, :25])
    distances = cdist(original, simplified).min(axis=1)
    rough = np.argsort(variation)[-len(original) // 10 :]
    expected = np.mean(distances[rough] <= np.sqrt(surface_area(KdTree.build(original)) / len(simplified)))
    assert 0.2 < expected < 0.9
    assert gppcs.evaluate(original, simplified).feature_recall == pytest.approx(expected, abs=0.005)


def test_normal_deviation_is_the_angle_of_a_fold():
    """Two halves of a plane, of which one is tilted: the half of the points that keep no neighbour is off by that."""
    tilt = np.radians(30)
    flat = np.random.default_rng(0).random((2000, 3)) * [1, 1, 0]
    folded = flat.copy()
    right = flat[:, 0] > 0.5
    folded[right] = [0.5, 0, 0] + (flat[right] - [0.5, 0, 0]) @ Rotation.from_euler("y", tilt).as_matrix().T
    assert gppcs.evaluate(folded, folded[~right]).normal_deviation == pytest.approx(15, abs=1)


def test_surface_variation_is_that_of_the_simplified_cloud(pair):
    original, simplified = pair
    radius = np.sqrt(25 * np.cbrt(np.ptp(simplified, axis=0).prod()) ** 2 / len(simplified))
    variation = variation_of(simplified, cdist(simplified, simplified) <= radius)
    assert gppcs.evaluate(original, simplified).mean_surface_variation == pytest.approx(np.mean(variation))


@settings(max_examples=10)
@given(st.integers(0, 99), st.floats(1e-4, 1e4), st.integers(-2000, 2000))
def test_rotation_shift_and_scale_change_figures_as_their_units_say(pair, seed, scale, shift):
    rotation = Rotation.from_quat(np.random.default_rng(seed).standard_normal(4)).as_matrix()
    before = gppcs.evaluate(*pair)
    after = gppcs.evaluate(*(scale * (points @ rotation + [shift, -shift, 2 * shift]) for points in pair))
    for name, figure in gppcs.Report.definitions().items():
        factor = {"length": scale, "squared length": scale**2}.get(figure.unit, 1)
        if name not in OF_THE_BOX:
            assert getattr(after, name) == pytest.approx(factor * getattr(before, name), rel=1e-5), name


def test_relative_figures_are_in_diagonals(pair):
    report = gppcs.evaluate(*pair)
    relative = report.figures(relative=True)
    assert relative["covering_radius"] == report.covering_radius / report.diagonal
    assert relative["chamfer"] == report.chamfer / report.diagonal**2
    assert {name for name, value in relative.items() if value == report.figures()[name]} == {
        "points_in", "points_out", "diagonal", "feature_recall", "normal_deviation", "mean_surface_variation"
    }  # fmt: skip


@pytest.mark.parametrize("cloud", [np.zeros((1, 3)), np.ones((5, 3)), np.outer(np.arange(8.0), [1, 2, 3])])
def test_degenerate_clouds_have_figures(cloud):
    report = gppcs.evaluate(cloud, cloud[:1])
    length = np.linalg.norm(cloud[-1] - cloud[0])
    assert report.covering_radius == report.surface_max == pytest.approx(length)
    assert report.mean_surface_variation == 0
    assert all(np.isfinite(value) for value in report.figures().values())


@pytest.mark.parametrize("place", ["original", "simplified"])
def test_what_cannot_be_compared_is_refused(place):
    for cloud, message in ((np.empty((0, 3)), "cloud is empty"), (np.full((2, 3), np.nan), "NaN or infinite")):
        with pytest.raises(gppcs.InputError, match=message):
            gppcs.evaluate(**{"original": np.zeros((1, 3)), "simplified": np.zeros((1, 3)), place: cloud})


POINT = np.array([[0.1, 0.2, 0.3]])
LATTICE = np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0), [0.0]), axis=-1).reshape(-1, 3)
DIAGONAL = np.array([0, 0, np.linalg.norm([29, 29])])


@pytest.mark.parametrize(
    ("original", "simplified"),
    [
        (LATTICE, 1000 * LATTICE[::3]),
        (LATTICE, LATTICE[::3] + 1e4 * DIAGONAL),
        (LATTICE, LATTICE[::3] + 0.101 * DIAGONAL),  # a tenth is allowed
        (POINT, POINT + 1e-3),
    ],
)
def test_a_cloud_elsewhere_is_refused(original, simplified):
    gppcs.evaluate(LATTICE, LATTICE[::3] + 0.099 * DIAGONAL)
    gppcs.evaluate(POINT, POINT.astype(np.float32))
    with pytest.raises(gppcs.InputError, match="does not lie on the original"):
        gppcs.evaluate(original, simplified)


@pytest.mark.parametrize("factor", [0.1, 0.001])
def test_a_cloud_too_small_is_refused_though_it_lies_inside(factor):
    """Of two sheets beside each other, the middle is near to both: a small copy there is near to either."""
    rng = np.random.default_rng(0)
    original = np.c_[rng.random((4000, 2)) - 0.5, np.where(rng.random(4000) < 0.5, 0.05, -0.05)]
    gppcs.evaluate(original, original[:80])
    with pytest.raises(gppcs.InputError, match="simplified cloud does not lie on the original"):
        gppcs.evaluate(original, factor * original[:80])


@pytest.mark.parametrize("factor", [1.7e308, 1e75, 1e-75])
def test_sizes_whose_squares_are_no_numbers_are_refused(pair, factor):
    allowed = 1e65 if factor > 1 else 1e-65
    before, after = gppcs.evaluate(*pair), gppcs.evaluate(*(allowed * cloud for cloud in pair))
    assert after.figures(relative=True) == pytest.approx({**before.figures(relative=True), "diagonal": after.diagonal})
    points = np.random.default_rng(0).random((50, 3)) - 0.5
    points[0] = 1.0  # times 1.7e308 still finite
    for clouds, name in (((factor * points, points), "original"), ((points, factor * points), "simplified")):
        with pytest.raises(gppcs.InputError, match=f"the {name} cloud to have a size of 1e-70 to 1e.70, found"):
            gppcs.evaluate(*clouds)
    mesh = gppcs.Mesh(factor * points, [[0, 1, 2]])
    with pytest.raises(gppcs.InputError, match="the mesh to have a size of"):
        gppcs.evaluate(points, points, mesh)


BY_AREA = ("mean_distance", "surface_mean", "surface_p95", "feature_error")  # figures with a form by area


def test_twice_the_density_of_one_half_changes_means_but_not_those_by_area():
    """A plane below a tilted one: the error grows with x, so more points on the left lower its mean."""
    rng = np.random.default_rng(5)
    kept = np.c_[rng.random((400, 2)), np.zeros(400)]
    kept[:, 2] = 0.2 * kept[:, 0]
    even, dense = (gppcs.evaluate(square(4000, left), kept) for left in (1, 2))
    for name in BY_AREA:
        assert getattr(dense, name) / getattr(even, name) < 0.98, name
        by_area = f"{name}_by_area"
        assert getattr(dense, by_area) == pytest.approx(getattr(even, by_area), rel=0.01), name


def test_one_outlier_decides_the_largest_distance_but_not_its_percentile():
    points = square(3000)
    kept = points[::10]
    before, after = (gppcs.evaluate(cloud, kept) for cloud in (points, np.concatenate([points, [[0.5, 0.5, 1]]])))
    assert after.covering_radius > 5 * before.covering_radius
    assert after.covering_p999 == pytest.approx(before.covering_p999, rel=0.1)
    distances = cdist(points, kept).min(axis=1)
    assert before.covering_p999 == pytest.approx(np.quantile(distances, 0.999))


def with_normals(points, normals):
    return gppcs.PointCloud(points, dict(zip(["nx", "ny", "nz"], normals.T, strict=True)))


@pytest.fixture(scope="module")
def bowl():
    """A bowl, whose opening is closed with a membrane; in a box from the origin on, of a size between 1/2 and 1."""
    pytest.importorskip("pymeshlab")
    n = 21
    x, y = (0.9 * grid.ravel() / (n - 1) for grid in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    vertices = np.stack([x, y, 1.8 * ((x - 0.4) ** 2 + (y - 0.5) ** 2)], axis=1)
    vertices -= vertices.min(axis=0)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([corner, corner + n, corner + 1], axis=1),
                            np.stack([corner + n, corner + n + 1, corner + 1], axis=1)])  # fmt: skip
    rng = np.random.default_rng(0)
    weights = rng.dirichlet([1, 1, 1], 4000)
    inside = np.einsum("ij,ijk->ik", weights, vertices[faces[rng.integers(len(faces), size=4000)]])
    original = np.concatenate([vertices, inside])
    return original, inside[:700], gppcs.Mesh(vertices, faces)


def test_mesh_figures_equal_their_definitions(bowl):
    original, simplified, mesh = bowl
    report = gppcs.evaluate(original, simplified, mesh)
    found, rebuilt = report.rebuilt, report.rebuilt.mesh
    forth = distances_to_triangles(mesh.vertices, rebuilt.vertices[rebuilt.faces])
    back = distances_to_triangles(rebuilt.vertices, mesh.vertices[mesh.faces])
    assert (found.hausdorff_mean, found.hausdorff_max) == pytest.approx((forth.mean(), forth.max()), rel=1e-5)
    # to coarse triangles, MeshLab's distances are too long here and there
    assert (found.back_mean, found.back_max) == pytest.approx((back.mean(), back.max()), rel=0.02)
    astray = back[rebuilt.faces] > 0.05 * report.diagonal
    areas = rebuilt.face_areas()
    share = areas[astray.any(axis=1)].sum() / areas.sum()
    assert found.stray_share == pytest.approx(share, rel=0.05)
    others = [areas[astray.all(axis=1)].sum() / areas.sum(), astray.any(axis=1).mean()]
    assert min(abs(other / share - 1) for other in others) > 0.1  # what it is not


def test_the_first_figures_are_those_of_points_that_carry_the_normals_of_the_mesh(bowl):
    """Points that moved carry those of the points where they came from."""
    original, simplified, mesh = bowl
    normals = reconstruction.exact_normals(mesh, simplified)
    report = gppcs.evaluate(original, with_normals(simplified + 1e-4, normals), mesh)
    assert report.rebuilt == report.rebuilt_carried != report.rebuilt_estimated
    unit = [
        normals / np.linalg.norm(normals, axis=1)[:, None] for normals in (mesh.vertex_normals(), mesh.face_normals())
    ]
    places = mesh.vertices, mesh.vertices[mesh.faces].mean(axis=1)
    for expected, points in zip(unit, places, strict=True):
        np.testing.assert_allclose(reconstruction.exact_normals(mesh, points), expected, atol=1e-12)


@pytest.mark.slow
def test_the_reconstruction_is_the_papers(bowl, coarse_octree, monkeypatch):
    """With PyMeshLab alone: planes of ten neighbours, signs of the nearest vertices, depth 8, distances of vertices."""
    import pymeshlab

    monkeypatch.setattr(reconstruction, "OCTREE_DEPTH", coarse_octree)
    original, points, mesh = bowl
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(points))
    meshes.compute_normal_for_point_clouds(k=10)
    normals = meshes.current_mesh().vertex_normal_matrix()
    upwards = normals * np.where(normals[:, 2:] < 0, -1, 1)  # as all triangles are
    meshes.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=upwards))
    meshes.generate_surface_reconstruction_screened_poisson(depth=8, preclean=True, threads=1)
    rebuilt = meshes.current_mesh_id()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    expected = meshes.get_hausdorff_distance(
        sampledmesh=meshes.current_mesh_id(), targetmesh=rebuilt, samplevert=True, sampleface=False,
        samplenum=len(mesh.vertices), maxdist=pymeshlab.PercentageValue(50),
    )  # fmt: skip
    found = gppcs.evaluate(original, points, mesh).rebuilt_estimated
    assert (found.hausdorff_mean, found.hausdorff_max) == pytest.approx((expected["mean"], expected["max"]), rel=1e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_normals_have_the_sign_of_the_guide_nearest_by(sign):
    """Of two sheets, one above the other, turned outwards or inwards."""
    pytest.importorskip("pymeshlab")
    sheet = np.random.default_rng(0).random((400, 3)) * [1, 1, 0]
    points = np.concatenate([sheet, sheet + np.array([0, 0, 0.2])])
    guides = np.repeat([[0, 0, -sign], [0, 0, sign]], 400, axis=0)
    normals = reconstruction.estimated_normals(points, points + 0.001, guides)
    np.testing.assert_allclose(normals, guides, atol=1e-6)


@pytest.mark.parametrize("far", [10, 1e12])
def test_a_far_point_does_not_blow_up_the_radius(sphere, far):
    strayed = (np.concatenate([points, np.full((1, 3), far)]) for points in (sphere, sphere[:4000]))
    expected = gppcs.evaluate(sphere, sphere[:4000]).mean_surface_variation
    assert gppcs.evaluate(*strayed).mean_surface_variation == pytest.approx(expected, rel=0.05)


@pytest.mark.slow
def test_a_mesh_is_measured_in_both_directions():
    pytest.importorskip("pymeshlab")
    ball = gppcs.sample("sphere", n_points=2000)
    surface, small = hull_mesh(ball.points), hull_mesh(ball.points[:150])
    report = gppcs.evaluate_mesh(ball, small)
    forth = distances_to_triangles(ball.points, small.vertices[small.faces])
    assert report.mesh_mean == pytest.approx(forth.mean(), rel=1e-4)
    assert report.mesh_max == pytest.approx(forth.max(), rel=1e-4)
    assert report.mesh_back_max == pytest.approx(0, abs=1e-9)  # its vertices are points of the cloud
    corners = small.vertices[small.faces]
    edges = ((np.roll(corners, 1, axis=1) - corners) ** 2).sum(axis=(1, 2))
    assert report.slivers == pytest.approx((4 * np.sqrt(3) * small.face_areas() / edges < 0.2).mean())
    assert (report.mesh_pieces, report.boundary_loops, report.genus) == (1, 0, 0)
    shrunk = gppcs.Mesh(0.95 * small.vertices, small.faces)
    with_surface = gppcs.evaluate_mesh(ball, shrunk, surface)
    back = distances_to_triangles(shrunk.vertices, surface.vertices[surface.faces])
    assert with_surface.mesh_back_mean == pytest.approx(back.mean(), rel=1e-3)


def test_triangles_that_cut_each_other_are_counted():
    pytest.importorskip("pymeshlab")
    ball = gppcs.sample("sphere", n_points=2000)
    crossed = np.array([[0, -20, -20], [0, 20, -20], [0, 0, 20], [-20, 0, -5], [20, 2, -5], [0, 4, 15]])
    points = np.concatenate([ball.points[:1000], crossed])
    faces = np.concatenate([hull_mesh(ball.points[:1000]).faces, [[1000, 1001, 1002], [1003, 1004, 1005]]])
    assert gppcs.evaluate_mesh(ball, gppcs.Mesh(points, faces)).self_intersections == 2
    assert gppcs.evaluate_mesh(ball, hull_mesh(ball.points)).self_intersections == 0


@pytest.fixture(scope="module")
def ball(sphere):
    """A mesh, points of it, and their report."""
    pytest.importorskip("pymeshlab")
    mesh, points = hull_mesh(sphere[-5000:]), sphere[:3000]
    return mesh, points, gppcs.evaluate(sphere, with_normals(points, points), mesh)


@pytest.mark.slow
def test_normals_are_carried_and_points_that_repeat_count_once(ball, sphere):
    mesh, points, report = ball
    assert report.rebuilt_estimated != report.rebuilt_carried
    assert gppcs.evaluate(sphere, points, mesh).rebuilt_carried is None
    double = np.tile(points, (2, 1))
    again = gppcs.evaluate(np.tile(sphere, (2, 1)), with_normals(double, double), mesh)
    assert {**again.figures(), "points_in": 15_000, "points_out": 3000} == report.figures()
