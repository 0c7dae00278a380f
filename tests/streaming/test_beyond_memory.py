"""Clouds larger than memory: exactly as many points, chosen equally well, the same for any number of workers."""

import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import product
from multiprocessing import get_context
from time import sleep

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gppcs
from gppcs.amounts.accuracy import distances_to
from gppcs.engine.threads import number_of_threads
from gppcs.streaming.graph import engine
from scans import sample
from shapes import on_sphere, square

MEMORY = "1GB"


@pytest.fixture(autouse=True)
def beyond_memory(monkeypatch):
    """Let no method fit into memory, and cut clouds into small parts."""
    for method in gppcs.METHODS.values():
        monkeypatch.setattr(method, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr("gppcs.streaming.source.CHUNK", 3_000)
    monkeypatch.setattr("gppcs.streaming.source.RUN", 2)
    monkeypatch.setattr("gppcs.streaming.beyond_memory.TILE", 4_000)
    monkeypatch.setattr("gppcs.streaming.beyond_memory.PILOT", 8_000)
    monkeypatch.setattr("gppcs.streaming.beyond_memory.BLOCK", 100)
    monkeypatch.setattr("gppcs.streaming.survey.SAMPLED", 8_000)


def written(tmp_path, cloud, name="cloud.ply"):
    gppcs.write(tmp_path / name, cloud, force=True)
    return tmp_path / name


def errors(cloud, kept):
    """Mean distance to the local surface, and distance to the nearest kept point: the mean and the largest."""
    nearest = cKDTree(kept).query(cloud.points)[0]
    return np.array([distances_to(kept, cloud.points).mean(), nearest.mean(), nearest.max()])


METHODS = ["gp", "fps", "voxel", "random", gppcs.Random(even=True)]


@pytest.mark.parametrize("method", [*METHODS, gppcs.Voxel(keep="lowest")], ids=str)
@pytest.mark.parametrize("count", [1, 9_000])
def test_exactly_as_many_points_with_their_attributes(tmp_path, method, count):
    cloud = gppcs.sample("bracket", 20_000)
    result = gppcs.simplify(written(tmp_path, cloud), n_points=count, method=method, memory=MEMORY)
    assert len(np.unique(result.indices)) == len(result.indices) == count
    assert result.cloud == gppcs.read(tmp_path / "cloud.ply").take(result.indices)


@pytest.mark.slow
def test_points_are_chosen_nearly_as_well_as_in_memory(tmp_path, monkeypatch):
    """In tiles of about 1,000 kept points, a tenth of them beside a border; most is lost on flat faces with edges."""
    for name, value in {"TILE": 15_000, "PILOT": 30_000, "BLOCK": 400}.items():
        monkeypatch.setattr(f"gppcs.streaming.beyond_memory.{name}", value)
    monkeypatch.setattr("gppcs.streaming.survey.SAMPLED", 20_000)
    ratios = []
    for name in ("bracket", "medallion", "terrain", "statue", "avenue"):
        cloud = sample(name, 60_000)
        tiled = gppcs.simplify(written(tmp_path, cloud), n_points=4_000, memory=MEMORY)
        together = gppcs.simplify(cloud, n_points=4_000)
        for count in (3_000, 4_000):
            few, all_at_once = (result.cloud.points[:count] for result in (tiled, together))
            ratios.append(errors(cloud, few) / errors(cloud, all_at_once))
    assert np.max(ratios, axis=0)[0] < 1.2
    assert (np.exp(np.log(ratios).mean(axis=0))[:2] < [1.07, 1.02]).all()


def test_no_seam_shows(tmp_path):
    """On a plane, the largest gap is about that of all points at once."""
    points = square(40_000)
    path = written(tmp_path, gppcs.PointCloud(points))
    for method, gap in (("fps", 0.019), ("gp", 0.028)):
        kept = gppcs.simplify(path, n_points=3_000, method=method, memory=MEMORY).cloud.points
        assert cKDTree(kept).query(points)[0].max() < gap


def test_the_same_for_any_number_of_threads_files_and_chunks(tmp_path, monkeypatch):
    cloud = gppcs.sample("bracket", 20_000)
    path, results = written(tmp_path, cloud), []
    names = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for name, rows in zip(names, (np.arange(7_000), np.arange(7_000, 20_000)), strict=True):
        gppcs.write(name, cloud.take(rows))
    for threads, paths, memory in ((1, path, "400MB"), (3, path, "4GB"), (2, names, MEMORY), (2, names[::-1], MEMORY)):
        gppcs.set_threads(threads)
        results.append(gppcs.simplify(paths, n_points=1_500, memory=memory).points)
    gppcs.set_threads(None)
    before = number_of_threads()
    with ThreadPoolExecutor(4) as executor:
        results.append(gppcs.simplify(path, n_points=1_500, memory=MEMORY, workers=executor).points)
    assert number_of_threads() == before
    monkeypatch.setattr("gppcs.streaming.source.CHUNK", 1_700)
    results.append(gppcs.simplify(path, n_points=1_500, memory=MEMORY).points)
    for other in results[1:]:
        np.testing.assert_array_equal(results[0], other)


def test_points_to_keep_and_weights(tmp_path):
    cloud = gppcs.sample("bracket", 20_000)
    cloud.attributes["side"] = (cloud.points[:, 0] > np.median(cloud.points[:, 0])).astype(np.float32)
    cloud.attributes["number"] = np.arange(20_000, dtype=np.int32)
    path = written(tmp_path, cloud)
    for method in ("gp", "fps"):
        kept = gppcs.simplify(path, n_points=1_000, keep="number < 50", method=method, memory=MEMORY)
        assert sorted(kept.indices[:50]) == list(range(50))
        assert len(set(kept.indices)) == 1_000
    cloud.attributes["side"] = 1 + 9 * cloud.attributes["side"]
    gppcs.write(path, cloud, force=True)
    weighed = gppcs.simplify(path, n_points=1_000, weight="side", memory=MEMORY)
    plain = gppcs.simplify(path, n_points=1_000, memory=MEMORY)
    share = [(result.cloud.attributes["side"] > 5).mean() for result in (weighed, plain)]
    assert share[0] / (1 - share[0]) > 5 * share[1] / (1 - share[1])


@pytest.mark.parametrize("method", ["gp", "fps"])
def test_all_points_to_keep_are_kept_where_tiles_hold_nothing_else(tmp_path, method):
    """A strip is so dense that its tiles have no points to spare."""
    rng = np.random.default_rng(2)
    xy = rng.random((24_000, 2))
    xy[:12_000, 0] *= 0.02
    xy[12_000:, 0] += 0.02
    wanted = np.arange(len(xy)) < 12_000
    cloud = gppcs.PointCloud(np.column_stack([xy, np.zeros(len(xy))]), {"wanted": wanted.astype(np.uint8)})
    path = written(tmp_path, cloud)
    result = gppcs.simplify(path, n_points=13_000, keep="wanted == 1", method=method, memory=MEMORY)
    assert len(result.indices) == 13_000
    assert np.isin(np.flatnonzero(wanted), result.indices).all()


def test_no_points_are_added_where_all_stay(tmp_path):
    """Half of a plane is kept: the other half gets all others, and has no larger gaps for it."""
    points = square(24_000)
    wanted = points[:, 0] < 0.5
    cloud = gppcs.PointCloud(points, {"wanted": wanted.astype(np.uint8)})
    options = {"n_points": int(wanted.sum()) + 800, "keep": "wanted == 1", "method": "fps"}
    results = gppcs.simplify(written(tmp_path, cloud), memory=MEMORY, **options), gppcs.simplify(cloud, **options)
    tiled, together = (cKDTree(result.cloud.points).query(points)[0].max() for result in results)
    assert tiled < 1.3 * together


def test_outliers_that_are_dropped_neither_count_in_a_tolerance_nor_in_the_diagonal(tmp_path):
    cloud = gppcs.sample("bracket", 20_000, outliers=0.01)
    options = {"tolerance": "1%", "drop_outliers": True}
    tiled = gppcs.simplify(written(tmp_path, cloud), memory=MEMORY, **options)
    together = gppcs.simplify(cloud, **options)
    assert len(tiled.indices) < 3 * len(together.indices)
    assert tiled.diagnostics["tolerance"] < 1.2 * together.diagnostics["tolerance"]


def test_errors_and_gaps_are_within_what_is_allowed(tmp_path, monkeypatch):
    cloud = gppcs.sample("bracket", 20_000)
    path = written(tmp_path, cloud)
    fine = gppcs.simplify(path, tolerance="1%", memory=MEMORY)
    even = gppcs.simplify(path, n_points=500, max_gap=4.0, memory=MEMORY)
    monkeypatch.undo()
    assert distances_to(fine.points, cloud.points).max() <= 0.01 * gppcs.info(cloud).diagonal
    assert len(fine.indices) <= 1.3 * len(gppcs.simplify(cloud, tolerance="1%").indices)
    assert cKDTree(even.points).query(cloud.points)[0].max() <= 4.0
    assert len(np.unique(even.indices)) == len(even.indices) > 500


def test_points_go_to_the_surface_and_get_its_normals(tmp_path):
    noisy = on_sphere(20_000) * (1.0 + 0.02 * np.random.default_rng(1).standard_normal((20_000, 1)))
    path = written(tmp_path, gppcs.PointCloud(noisy))
    result = gppcs.simplify(path, n_points=400, method=gppcs.LocalGP(denoise=True), normals=True, memory=MEMORY)
    radii = np.linalg.norm(result.points, axis=1)
    assert np.abs(radii - 1.0).mean() < 0.5 * 0.016  # the mean distance of all points is 0.016
    cosines = np.einsum("ij,ij->i", result.cloud.normals(), result.points / radii[:, None])
    assert np.quantile(cosines, 0.05) > 0.9


@pytest.mark.slow
def test_detail_is_kept_as_well_as_in_memory(tmp_path, monkeypatch):
    path = written(tmp_path, sample("painted", 40_000))
    cloud, asked = gppcs.read(path), {"n_points": 3_000, "detail": "rgb"}
    found = [gppcs.simplify(cloud, n_points=3_000), gppcs.simplify(path, memory=MEMORY, **asked)]
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        shared = gppcs.simplify(path, memory=MEMORY, workers=executor, **asked)
    np.testing.assert_array_equal(shared.indices, found[1].indices)
    monkeypatch.undo()
    found.append(gppcs.simplify(cloud, **asked))
    errors = [gppcs.evaluate(cloud, each.cloud, detail="rgb").detail["rgb"].error_mean for each in found]
    assert errors[1] == pytest.approx(errors[2], rel=0.1)
    assert errors[1] < 0.75 * errors[0]


def classed(tmp_path, outliers=0.0):
    """Write 20,000 points of classes 1, 2 and, few, 6, in pulses of up to 4 points, some of them not finite."""
    cloud = sample("terrain", 20_000, outliers=outliers)
    cloud.points[::1_000] = np.nan
    rng = np.random.default_rng(0)
    classes = rng.choice(np.array([1, 2, 6], dtype=np.uint8), 20_000, p=[0.5, 0.4, 0.1])
    pulses = np.sort(rng.integers(0, 8_000, 20_000)) / 7.0
    return written(tmp_path, gppcs.PointCloud(cloud.points, {"kind": classes, "pulse": pulses}))


@pytest.mark.parametrize(("method", "outliers"), [("gp", 0.02), ("random", 0.0)])
def test_quotas_are_exact(tmp_path, method, outliers):
    path = classed(tmp_path, outliers)
    asked = {"method": method, "invalid": "drop", "drop_outliers": outliers > 0.0}
    asked |= {"keep": "kind == 6 and pulse < 100"} if method == "gp" else {}
    quota = {"kind == 6": 600, "kind == 2": "10%"}
    found = gppcs.simplify(path, n_points=2_000, quota=quota, memory=MEMORY, **asked).cloud
    assert np.bincount(found.attributes["kind"]).tolist() == [0, 1_200, 200, 0, 0, 0, 600]
    assert np.isfinite(found.points).all()


def test_a_spacing_tells_the_number_and_fps_keeps_to_it(tmp_path, monkeypatch):
    cloud = gppcs.sample("bracket", 20_000)
    path = written(tmp_path, cloud)
    found = {
        method: gppcs.simplify(path, spacing=4.0, method=method, memory=MEMORY) for method in ("gp", "fps", "voxel")
    }
    kept = found["fps"].cloud.points
    assert cKDTree(kept).query(kept, k=2)[0][:, 1].min() >= 4.0
    assert cKDTree(kept).query(cloud.points)[0].max() <= 4.0
    monkeypatch.undo()
    for method in ("gp", "voxel"):
        number = len(gppcs.simplify(cloud, spacing=4.0, method=method).indices)
        assert len(found[method].indices) == pytest.approx(number, rel=0.05)


@pytest.mark.parametrize("keep", ["nearest", "least"])
def test_cells_keep_the_same_points_as_in_memory(tmp_path, monkeypatch, keep):
    method = gppcs.Voxel(keep=keep, attribute="time" if keep == "least" else None)
    points = sample("terrain", 20_000).points
    times = np.random.default_rng(0).permutation(20_000) * 1e9  # a number of type float32 would not do
    path = written(tmp_path, gppcs.PointCloud(points, {"time": times}))
    found = gppcs.simplify(path, spacing="2 %", method=method, memory=MEMORY).indices
    monkeypatch.undo()
    np.testing.assert_array_equal(found, gppcs.simplify(gppcs.read(path), spacing="2 %", method=method).indices)


def test_an_even_density_knows_no_parts(tmp_path):
    dense = np.random.default_rng(0).random((20_000, 3)) * [1, 1, 0]
    points = dense[(dense[:, 0] < 0.5) | (np.arange(20_000) % 10 == 0)]
    path = written(tmp_path, gppcs.PointCloud(points))
    shares = np.zeros((2, 2))
    for even, seed in product((0, 1), range(8)):
        method = gppcs.Random(seed, bool(even))
        found = gppcs.simplify(path, n_points=100, method=method, memory=MEMORY)
        kept = [found.cloud.points, gppcs.simplify(points, n_points=100, method=method).cloud.points]
        shares[even] += [(each[:, 0] < 0.5).mean() / 8 for each in kept]
    np.testing.assert_allclose(shares, [[10 / 11] * 2, [0.5] * 2], atol=0.06)


def test_outliers_are_those_in_memory(tmp_path, monkeypatch):
    cloud = gppcs.sample("bracket", 20_000, outliers=0.01)
    path = written(tmp_path, cloud)
    found = gppcs.simplify(path, n_points=500, drop_outliers=True, memory=MEMORY)
    expected = np.flatnonzero(gppcs.find_outliers(gppcs.read(path)))
    assert len(np.setxor1d(found.outliers, expected)) <= 0.03 * len(expected)
    assert not len(np.intersect1d(found.indices, found.outliers))


def test_of_repeats_the_first_is_kept(tmp_path):
    path = written(tmp_path, gppcs.PointCloud(np.tile(np.random.default_rng(0).random((20_000, 3)), (2, 1))))
    assert gppcs.simplify(path, n_points=300, memory=MEMORY).indices.max() < 20_000


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("n_places", [1, 2, 3, 40, 900])
def test_repeats_are_chosen_last(tmp_path, method, n_places):
    rng = np.random.default_rng(n_places)
    points = rng.random((n_places, 3))[rng.integers(n_places, size=20_000)]
    path = written(tmp_path, gppcs.PointCloud(points))
    for count in (1, 10, 500):
        result = gppcs.simplify(path, n_points=count, method=method, memory=MEMORY)
        assert len(np.unique(result.indices)) == count
        assert len(np.unique(result.cloud.points, axis=0)) == min(count, n_places)


def test_invalid_points_are_told_or_dropped(tmp_path):
    cloud = gppcs.sample("bracket", 9_000)
    cloud.points[[5_005, 7_000]] = np.nan
    parts = (cloud.take(np.arange(4_000)), cloud.take(np.arange(4_000, 9_000)))
    path = [written(tmp_path, part, f"{number}.ply") for number, part in enumerate(parts)]
    with pytest.raises(gppcs.InputError, match=r"2 of 9000 points have coordinates .*, the first at index 5005"):
        gppcs.simplify(path, n_points=9, memory=MEMORY)
    result = gppcs.simplify(path, ratio=0.1, invalid="drop", memory=MEMORY)
    assert len(result.indices) == 900
    assert np.isfinite(result.cloud.points).all()


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"n_points": 9, "method": "hc"}, "method 'hc' takes all points at once"),
        (
            {"n_points": 9, "quota": {"x < 1e9": 5}},
            "expected at least 4 points of no quota, found 0; change the quotas",
        ),
        ({"n_points": 9, "detail": "colour"}, "no attribute 'colour' to count as detail"),
        ({"n_points": 9, "keep": "z > 1e9"}, "expected points with z > 1e9 to keep, found none"),
    ],
)
def test_what_needs_memory_says_so(tmp_path, asked, message):
    with pytest.raises(gppcs.InputError, match=message):
        gppcs.simplify(written(tmp_path, gppcs.sample("bracket", 2_000)), memory=MEMORY, **asked)


def test_files_that_change_meanwhile_are_told(tmp_path, monkeypatch):
    path = written(tmp_path, gppcs.sample("bracket", 9_000))
    choose = gppcs.Random.__call__

    def changed(self, wanted):
        gppcs.write(path, gppcs.sample("bracket", 8_000), force=True)
        return choose(self, wanted)

    monkeypatch.setattr(gppcs.Random, "__call__", changed)
    with pytest.raises(gppcs.InputError, match="expected 9,000 points again, found 8,000: the files have changed"):
        gppcs.simplify(path, n_points=9, method="random", memory=MEMORY)


def _end_at_once(item):
    import os

    os._exit(1)


def test_a_lost_worker_is_told():
    with (
        ProcessPoolExecutor(1, get_context("spawn")) as executor,
        pytest.raises(gppcs.GppcsError, match="the workers were lost"),
        engine(executor, 1) as run_on,
    ):
        run_on.run(_end_at_once, [1])


def test_after_an_error_no_other_task_begins():
    begun = []

    def task(number):
        begun.append(number)
        if not number:
            raise ValueError
        sleep(0.01)  # the error arrives long before the last task could begin

    with ThreadPoolExecutor(1) as pool, pytest.raises(ValueError), engine(pool, 1) as run_on:  # noqa: PT011
        run_on.run(task, range(1000))
    assert len(begun) < 1000


def test_a_worker_on_another_machine_uses_one_thread(monkeypatch, default_threads):
    gppcs.set_threads(3)
    machines = iter(["here", "there"])  # whose processes may have the same number
    monkeypatch.setattr("platform.node", lambda: next(machines))
    with engine(None, 1) as run_on:
        assert run_on.run(lambda part: number_of_threads(), [0]) == [1]


def test_a_full_disk_for_temporary_files_is_told(tmp_path, monkeypatch):
    def full(*arguments):
        monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10**9, 10**9, 0))
        raise OSError("324838 requested and 195831 written")

    monkeypatch.setattr("gppcs.streaming.source.Run.write", full)
    path = written(tmp_path, gppcs.sample("bracket", 20_000))
    with pytest.raises(gppcs.errors.OutputError, match="of disk space for temporary files, found that it is full"):
        gppcs.simplify(path, n_points=700, memory=MEMORY, scratch=tmp_path)
    assert list(tmp_path.iterdir()) == [path]
