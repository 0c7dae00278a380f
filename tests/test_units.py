"""Clouds whose axes have different units are measured in one of them, and keep their coordinates."""

from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from types import SimpleNamespace

import laspy
import numpy as np
import pytest

import gppcs
from gppcs import PointCloud
from gppcs.app import program
from gppcs.app.printing import note_units
from gppcs.drawing.single import draw_single
from gppcs.drawing.web.contents import Named, report_page
from las_file import las_of
from shapes import metres_of_degrees

FOOT = 1200 / 3937
GEOGRAPHIC = 'GEOGCS["WGS 84",DATUM["W",SPHEROID["W",6378137,298.25]],UNIT["degree",0.0174532925199433]]'
FEET_IN_HEIGHT = f'COMPD_CS["x",PROJCS["x",{GEOGRAPHIC},UNIT["metre",1]],VERT_CS["h",UNIT["foot",{FOOT}]]]'
# The system, the metres of each unit, and the finest scale.
SYSTEMS = {
    "degrees": (GEOGRAPHIC, [*metres_of_degrees(7, 47), 1.0], 1e-9),
    "feet": (FEET_IN_HEIGHT, [1.0, 1.0, FOOT], 1e-6),
}


def factors_of(cloud):
    return cloud.units.factors(cloud.points.min(axis=0), cloud.points.max(axis=0))


def in_metres(cloud):
    """The same points from their lower corner on, in metres."""
    return (cloud.points - cloud.points.min(axis=0)) * factors_of(cloud)


@pytest.fixture(params=SYSTEMS)
def two(request, tmp_path):
    """The same houses on waves in a LAS file with two units, as it is read, and in metres."""
    text, metres, scale = SYSTEMS[request.param]
    rng = np.random.default_rng(0)
    x, y = np.hstack([rng.random((2, 12_000)) * 100, [[50, 50], [0, 100]]])  # the middle is at 47 degrees
    z = 2 * np.sin(x / 15) + np.where((abs(x % 50 - 25) < 8) & (abs(y % 50 - 25) < 8), 6, 0)
    points = np.stack([x - 50, y - 50, z], axis=1) / metres + [7, 47, 0]
    las = las_of(points, scales=[scale, scale, 1e-6], offsets=[7, 47, 0], gps_time=rng.permutation(len(x)))
    las.header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0"))
    las.header.global_encoding.wkt = True
    las.write(tmp_path / "two.las")
    cloud = gppcs.read(tmp_path / "two.las")
    np.testing.assert_allclose(factors_of(cloud), metres, rtol=1e-9)
    return SimpleNamespace(path=tmp_path / "two.las", cloud=cloud, metres=in_metres(cloud))


@pytest.mark.parametrize("method", ["gp", "fps", "voxel", "sample-elimination", "hc"])
def test_methods_choose_as_in_metres(two, method):
    result = gppcs.simplify(two.cloud, n_points=500, method=method)
    assert (result.indices == gppcs.simplify(two.metres, n_points=500, method=method).indices).all()
    assert (result.cloud.points == two.cloud.points[result.indices]).all()


@pytest.mark.parametrize(
    "options",
    [
        {"spacing": "300cm", "method": "voxel"},
        {"max_gap": "3m"},
        {"tolerance": "20cm:p95"},
        {"ratio": 0.01, "drop_outliers": True, "normals": True},
    ],
    ids=str,
)
def test_lengths_are_metres(two, options):
    result = gppcs.simplify(two.cloud, **options)
    expected = gppcs.simplify(two.metres, unit="m", **options)
    assert (result.indices == expected.indices).all()
    assert result.diagnostics == pytest.approx(expected.diagnostics, rel=1e-4)
    if options.get("normals"):
        np.testing.assert_allclose(result.cloud.normals(), expected.cloud.normals(), atol=1e-4)


def test_moved_points_are_scaled_back(two):
    noise = np.random.default_rng(1).normal(0, 0.2, two.metres.shape)
    cloud = two.cloud.moved(two.cloud.points + noise / factors_of(two.cloud))
    corner, factors = cloud.points.min(axis=0), factors_of(cloud)
    for options in ({"method": gppcs.LocalGP(denoise=True)}, {"method": "wlop"}):
        moved = gppcs.simplify(in_metres(cloud), n_points=300, **options).cloud.points
        actual = gppcs.simplify(cloud, n_points=300, **options).cloud.points
        np.testing.assert_allclose((actual - corner) * factors, moved, atol=1e-6)


def test_results_and_meshes_are_measured_in_metres(two):
    result = gppcs.simplify(two.cloud, n_points=300, method="fps")
    figures = gppcs.evaluate(two.cloud, result.cloud.points).figures()
    expected = gppcs.evaluate(two.metres, two.metres[result.indices]).figures()
    assert figures == pytest.approx(expected, rel=1e-3)
    made, in_metres = (gppcs.mesh(cloud, n_points=300, unit=None) for cloud in (two.cloud, two.metres))
    assert (made.indices == in_metres.indices).all()
    assert (made.mesh.vertices == two.cloud.points[made.indices]).all()
    assert made.diagnostics.mean_distance == pytest.approx(in_metres.diagnostics.mean_distance, rel=1e-4)
    summary, in_metres = gppcs.info(two.cloud), gppcs.info(two.metres)
    assert (summary.diagonal, summary.spacing) == pytest.approx((in_metres.diagonal, in_metres.spacing), rel=1e-4)
    assert summary.minimum == tuple(two.cloud.points.min(axis=0))
    np.testing.assert_array_equal(gppcs.find_outliers(two.cloud), gppcs.find_outliers(two.metres))


def test_pages_and_pictures_show_the_same_shape(two, tmp_path):
    kept = two.cloud.take(np.arange(0, len(two.cloud), 50))
    shown, expected_page = (
        report_page(
            Named("all", PointCloud(points, header=header)), [Named("few", PointCloud(points[::50]))], []
        ).described
        for points, header in ((two.cloud.points, two.cloud.header), (two.metres, None))
    )
    assert shown["unit"] == "m"
    assert shown["diagonal"] == pytest.approx(expected_page["diagonal"], rel=1e-6)
    for cloud, expected in zip(shown["clouds"], expected_page["clouds"], strict=True):
        np.testing.assert_allclose(cloud["step"], expected["step"], rtol=1e-6)
        assert cloud["spacing"] == pytest.approx(expected["spacing"], rel=1e-6)
    pictures = BytesIO(), BytesIO()
    for picture, cloud in zip(pictures, (kept, PointCloud(in_metres(kept))), strict=True):
        draw_single(picture, cloud, size=(64, 64))
    assert pictures[0].getvalue() == pictures[1].getvalue()


def test_one_frame_holds_for_all_tiles_beyond_memory(two, tmp_path):
    halves = np.array_split(np.argsort(two.cloud.points[:, 1]), 2)
    tiles = [tmp_path / "south.laz", tmp_path / "north.laz"]
    for tile, half in zip(tiles, halves, strict=True):
        gppcs.write(tile, two.cloud.take(half))
    points = two.metres[np.concatenate(halves)]
    result = gppcs.simplify(tiles, spacing="3m", method="voxel", workers=ThreadPoolExecutor(1))
    chosen = gppcs.simplify(points, spacing=3.0, method="voxel").indices
    assert set(result.indices) == set(chosen)
    assert (result.cloud.points == two.cloud.points[np.concatenate(halves)][result.indices]).all()


def test_another_unit_may_be_said_to_hold(two):
    indices = gppcs.simplify(two.cloud, n_points=300, method="fps", unit="m").indices
    assert (indices == gppcs.simplify(two.cloud.points, n_points=300, method="fps").indices).all()


def test_numbers_that_are_no_degrees_are_metres(two, capsys):
    moved = np.add(two.metres, [0, 1000, 0])
    cloud = gppcs.PointCloud(moved, header=two.cloud.header)
    if cloud.units.is_geographic:
        note_units("a.las", cloud)
        assert "metres are assumed" in capsys.readouterr().err
        indices = gppcs.simplify(cloud, max_gap="3m", method="fps").indices
        assert (indices == gppcs.simplify(moved, max_gap=3.0, method="fps").indices).all()


def test_the_command_names_both_units(two, capsys, tmp_path):
    def printed(*arguments):
        assert program.run(list(map(str, arguments))) == 0
        return capsys.readouterr()

    out, err = printed(
        "simplify", two.path, "-o", tmp_path / "out.las", "--max-gap", "3m", "--method", "fps", "--spacing", "5m"
    )
    assert err.count("distances are measured in m") == 1
    gap = next(line.split() for line in out.splitlines() if line.startswith("largest gap"))
    assert (float(gap[2]) <= 3, gap[3]) == (True, "m")
    before, after = (laspy.read(path).points.array[["X", "Y", "Z"]] for path in (two.path, tmp_path / "out.las"))
    assert set(after.tolist()) <= set(before.tolist())
    for command in (
        ("evaluate", tmp_path / "out.las"),
        ("mesh", "-o", tmp_path / "mesh.ply", "--points", 300, "--lossy"),
    ):
        assert printed(command[0], two.path, *command[1:]).err.count("distances are measured in m") == 1
    unit = next(line for line in printed("info", two.path).out.splitlines() if line.startswith("unit "))
    assert unit.endswith("in z; of lengths: m")
