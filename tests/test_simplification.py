"""What holds for every method: exact counts, exact points, the same choice wherever and however large the cloud is."""

import gc
import itertools
import re
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gppcs
from gppcs.methods import Feature
from shapes import odd_clouds

METHODS = list(gppcs.METHODS.built_in)
FAR = np.array([500_000, 5_400_000, 0])  # as in UTM


SMALL = odd_clouds()


def chosen(points, n_points, method, **options):
    return gppcs.simplify(points, n_points=n_points, method=method, **options).indices


def assert_exactly(indices, count, n):
    assert indices.dtype == np.int64
    assert len(indices) == len(set(indices.tolist())) == count
    assert set(indices.tolist()) <= set(range(n))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("points", SMALL.values(), ids=SMALL)
def test_exact_counts_of_odd_clouds(points, method):
    n = len(points)
    for count in {1, min(2, n), -(-n // 2), max(1, n - 1), n}:
        assert_exactly(chosen(points, count, method), count, n)


@given(data=st.data(), method=st.sampled_from(METHODS), seed=st.integers(0, 2**32))
def test_exact_counts_of_any_cloud(data, method, seed):
    coordinate = st.one_of(st.integers(-3, 3), st.floats(-1e6, 1e6))
    points = np.array(data.draw(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=40)))
    count = data.draw(st.integers(1, len(points) + 3))
    made = gppcs.METHODS[method]()
    indices = chosen(points, count, replace(made, seed=seed) if hasattr(made, "seed") else made)
    assert_exactly(indices, min(count, len(points)), len(points))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scan", ["medallion", "bracket", "fan", "sphere"])
def test_kept_points_keep_every_bit(scan, method):
    cloud = gppcs.sample(scan, 800, noise=0.001, outliers=0.01)
    result = gppcs.simplify(cloud, ratio=0.1, method=method)
    assert_exactly(result.indices, 80, 800)
    assert result.cloud.points.tobytes() == cloud.points[result.indices].tobytes()
    assert result.cloud.coordinate_dtype == np.float32
    assert list(result.cloud.attributes) == list(cloud.attributes) != []
    for name, values in cloud.attributes.items():
        assert result.cloud.attributes[name].dtype == values.dtype
        assert result.cloud.attributes[name].tobytes() == values[result.indices].tobytes()


@pytest.mark.parametrize(("dtype", "expected"), [("f4", "f4"), (">f4", "f4"), ("f8", "f8"), ("i4", "f8")])
def test_a_result_can_be_used_as_a_cloud_in_the_precision_of_the_input(tmp_path, dtype, expected):
    points = (1000 * gppcs.sample("bracket", 800).points).astype(dtype)
    result = gppcs.simplify(points, n_points=80, method="fps")
    assert len(result) == 80
    for array in (result.points, np.asarray(result)):
        assert array.dtype == np.dtype(expected)
        np.testing.assert_array_equal(array, points[result.indices])
    assert gppcs.evaluate(points, result) == gppcs.evaluate(points, result.cloud)
    gppcs.write(tmp_path / "small.npy", result)
    assert np.load(tmp_path / "small.npy").dtype == np.dtype(expected)
    assert gppcs.simplify(result, n_points=5, method="fps").indices.tolist() == list(range(5))


def test_fps_starts_with_the_points_to_keep():
    points = np.random.default_rng(3).random((400, 3))
    for keep in ([17], [5, 17, 200]):
        expected = list(keep)
        while len(expected) < 12:
            distances = np.linalg.norm(points[:, None] - points[expected], axis=2).min(axis=1)
            expected.append(int(np.argmax(distances)))
        assert gppcs.simplify(points, n_points=12, method="fps", keep=keep).indices.tolist() == expected
    assert gppcs.simplify(points, n_points=1, method="fps", keep=[17]).indices.tolist() == [17]


@pytest.mark.parametrize("method", METHODS)
def test_as_many_points_as_there_are_come_back_in_order(method):
    points = SMALL["mostly repeats"]
    assert len(chosen(points, None, method, ratio=1e-9)) == 1
    assert len(chosen(points, None, method, ratio=0.2)) == 2  # 2.4 rounded
    for count in (len(points), len(points) + 1, 10**30):
        assert chosen(points, count, method).tolist() == list(range(len(points)))
    assert gppcs.simplify(points, ratio=1, method=method).indices.tolist() == list(range(len(points)))


@pytest.mark.parametrize("method", METHODS)
def test_repeats_are_chosen_last(method):
    rng = np.random.default_rng(1)
    points = rng.permutation(np.repeat(rng.random((15, 3)), 3, axis=0))
    for count in (1, 8, 14, 15, 16, 44):
        first = chosen(points, count, method)[:15]
        assert len(np.unique(points[first], axis=0)) == len(first)


def quantised(scan, n_points=1200):
    """Return points that large shifts leave exact."""
    return np.round(gppcs.sample(scan, n_points).points * 1024) / 1024


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scan", ["bracket", "fan"])
def test_the_choice_does_not_depend_on_place_unit_or_run(scan, method):
    points = quantised(scan)
    indices = chosen(points, 120, method).tolist()
    assert chosen(points, 120, method).tolist() == indices
    assert chosen(points + FAR, 120, method).tolist() == indices
    assert chosen(points * 1024, 120, method).tolist() == indices
    assert chosen(points / 1024, 120, method).tolist() == indices
    in_millimetres = chosen(points * 1000, 120, method)
    assert np.isin(in_millimetres, indices).mean() >= 0.99


@pytest.mark.parametrize(
    ("method", "options"),
    [
        *((name, {"n_points": 2500}) for name in ("gp", "fps", "voxel")),  # so many that all stages are shared
        *(pytest.param(name, {"n_points": 400}, marks=pytest.mark.slow) for name in METHODS),
        (gppcs.LocalGP(denoise=True), {"n_points": 400}),
        ("gp", {"tolerance": "5%", "keep": range(9)}),
    ],
)
def test_the_choice_does_not_depend_on_the_number_of_threads(method, options, on_threads):
    noisy = gppcs.sample("fan", 20_000, noise=0.002).points
    one, *several = on_threads(lambda: gppcs.simplify(noisy, method=method, **options))
    for result in several:
        np.testing.assert_array_equal(result.indices, one.indices)
        np.testing.assert_array_equal(result.points, one.points)


def test_the_seed_decides_a_random_choice():
    points = quantised("bracket")
    first, again, other = (chosen(points, 120, gppcs.Random(seed=seed)).tolist() for seed in (1, 1, 2))
    assert first == again != other
    result = gppcs.simplify(points, n_points=120, method=gppcs.Random(seed=1))
    assert re.fullmatch(r"Result\(120 points by random \(seed=1\) in \S+ s\)", repr(result))


def test_old_names_of_arguments_work_with_a_warning_that_tells_the_new_ones(tmp_path):
    cloud = gppcs.sample("bracket", n_points=2000)
    gppcs.write(tmp_path / "a.ply", cloud)
    with pytest.warns(DeprecationWarning, match=r"use gppcs.open\(paths, only=...\), which gppcs.simplify takes"):
        result = gppcs.simplify(tmp_path / "a.ply", n_points=9, only="z > 6", method="random")
    assert result.points[:, 2].min() > 6
    with pytest.warns(DeprecationWarning, match="which gppcs.read takes"):
        assert len(gppcs.read(tmp_path / "a.ply", inside=[0, 0, 9, 9])) < len(cloud)
    with pytest.warns(DeprecationWarning, match=r"method=gppcs.Random\(seed=3\)"):
        assert gppcs.simplify(cloud, n_points=9, method="random", seed=3).method == gppcs.Random(seed=3)
    with pytest.warns(DeprecationWarning, match=r"method=gppcs.LocalGP\(denoise=True\)"):
        assert gppcs.simplify(cloud, n_points=9, denoise=True).method == gppcs.LocalGP(denoise=True)
    with pytest.warns(DeprecationWarning, match=r"method=gppcs.Random"):
        gppcs.simplify_batch([cloud, cloud], n_points=9, method="random", seed=3)
    refused = pytest.raises(gppcs.ParameterError, match="'fps' has no parameter 'seed'")
    with pytest.warns(DeprecationWarning, match="Random"), refused:
        gppcs.simplify(cloud, n_points=9, method="fps", seed=3)


@pytest.mark.filterwarnings("ignore:.*is deprecated here:DeprecationWarning")
def test_arguments_of_reading_are_taken_by_position_and_refused_without_files(tmp_path):
    (tmp_path / "a.txt").write_text("x,y,z\n0,0,1\n0,0,3\n")
    assert len(gppcs.read(tmp_path / "a.txt", "csv", only="z > 2")) == 1
    with pytest.raises(gppcs.GppcsError, match="LAS"):
        gppcs.read(tmp_path / "a.txt", "las", only="z > 2")
    with pytest.raises(TypeError, match="path"):
        gppcs.read(only="z > 2")
    with pytest.raises(gppcs.ParameterError, match=r"cloud\[mask\]"):
        gppcs.simplify(gppcs.sample("bracket", n_points=20), n_points=9, only="z > 2")
    for wrong in ({"format": "csv"}, {"columns": ["x", "y", "z"]}, {"only": "z > 2"}):
        with pytest.raises(gppcs.ParameterError, match=r"gppcs\.open"):
            gppcs.read(gppcs.open(tmp_path / "a.txt", "csv"), **wrong)


@pytest.mark.parametrize("method", METHODS)
def test_the_input_is_never_changed(method):
    cloud = gppcs.sample("bracket", 300)
    before = cloud.points.tobytes(), [values.tobytes() for values in cloud.attributes.values()]
    for array in (cloud.points, *cloud.attributes.values()):
        array.flags.writeable = False
    result = gppcs.simplify(cloud, n_points=30, method=method)
    assert not np.shares_memory(result.cloud.points, cloud.points)
    assert (cloud.points.tobytes(), [values.tobytes() for values in cloud.attributes.values()]) == before


@pytest.mark.parametrize("dtype", ["f4", "f8", ">f8", "i4"])
def test_any_number_type_and_memory_layout_will_do(dtype):
    points = np.round(gppcs.sample("bracket", 300).points)
    expected = chosen(points, 30, "fps-variation").tolist()
    for array in (points.astype(dtype), np.asfortranarray(points.astype(dtype)), points.astype(dtype).tolist()):
        assert chosen(array, 30, "fps-variation").tolist() == expected


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite_are_counted_or_dropped(bad):
    cloud = gppcs.sample("bracket", 300)
    points = cloud.points.copy()
    points[[7, 250], [1, 2]] = bad
    broken = gppcs.PointCloud(points, cloud.attributes)
    with pytest.raises(gppcs.InputError, match=r"2 of 300 points .* the first at index 7"):
        gppcs.simplify(broken, ratio=0.1)
    result = gppcs.simplify(broken, ratio=0.1, method="fps", invalid="drop")
    rest = np.delete(np.arange(300), [7, 250])
    assert result.indices.tolist() == rest[chosen(points[rest], 30, "fps")].tolist()
    assert result.cloud.points.tobytes() == points[result.indices].tobytes()
    assert result.cloud.attributes["red"].tolist() == cloud.attributes["red"][result.indices].tolist()
    everything = gppcs.simplify(broken, ratio=1, invalid="drop")
    assert everything.indices.tolist() == rest.tolist()


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (np.empty((0, 3)), "empty"),
        (np.full((2, 3), np.nan), "none of the 2 points has finite coordinates"),
        ([[1e308, 0, 0], [-1e308, 0, 0], [1, 2, 3]], "overflow"),
    ],
)
def test_what_is_no_cloud_is_refused(cloud, message):
    with pytest.raises(gppcs.InputError, match=message):
        gppcs.simplify(cloud, ratio=0.5, invalid="drop")


@pytest.mark.parametrize("method", ["gp", "gp-spectral"])
def test_every_step_is_reported_in_small_ones(method):
    """No step of the choice is more than two fifths of all points."""
    reports = []
    points = gppcs.sample("medallion", 40_000 if method == "gp" else 1200)
    number = len(points) // 4
    timer = gppcs.Timer(lambda *report: reports.append(report))
    gppcs.simplify(points, n_points=number, method=method, timer=timer)
    assert {stage for stage, _, _ in reports} == timer.seconds.keys() - {"compilation"}
    assert all(done == 0 for stage, done, total in reports if total is None)
    steps = [(done, total) for stage, done, total in reports if stage == "greedy selection"]
    assert all(total is not None and done <= total for done, total in steps)
    ends = [total for done, total in steps if done == total]
    if method == "gp":
        assert sum(ends) == number
        assert all(after[0] - before[0] <= 0.4 * number for before, after in itertools.pairwise(steps))


def test_a_result_is_an_array_and_options_may_be_flags_of_numpy():
    result = gppcs.simplify(np.eye(3), n_points=2, method="random", scores=np.False_, normals=np.False_)
    assert np.array(result).tolist() == result.points.tolist()
    with pytest.raises(ValueError, match="copy"):
        np.array(result, copy=False)


def test_a_timer_of_two_runs_does_not_change_the_first_result():
    timer = gppcs.Timer()
    first = gppcs.simplify(np.eye(3), n_points=2, method="random", timer=timer)
    seconds = dict(first.seconds)
    with timer("something else"):
        pass
    assert first.seconds == seconds


@pytest.mark.parametrize(
    "indices",
    [np.zeros(5, int), np.arange(4), np.arange(6), np.arange(5) - 1, np.arange(5) + 96, np.arange(5.0), None],
)
def test_what_a_method_of_others_returns_is_checked(indices):
    @dataclass(frozen=True)
    class Wrong(gppcs.Method):
        name, summary, source = "wrong", "returns what it must not", "a test"

        def __call__(self, task):
            return gppcs.Selection(indices)

    with pytest.raises(gppcs.ParameterError, match="5 different indices from 0 to 99 from method 'wrong'"):
        gppcs.simplify(np.random.default_rng(0).random((100, 3)), n_points=5, method=Wrong())


def test_a_result_does_not_hold_the_original():
    points = np.random.default_rng(0).random((5_000, 3))
    original = weakref.ref(points)
    result = gppcs.simplify(points, n_points=50)
    del points
    gc.collect()
    assert original() is None
    assert len(result.cloud) == 50


def test_what_is_no_ranking_has_no_prefixes():
    cloud = gppcs.sample("bracket", n_points=3000)
    with pytest.raises(gppcs.ParameterError, match="a method that supports ranking, found 'voxel'; use 'gp' or "):
        gppcs.simplify(cloud, n_points=50, method="voxel").prefix(10)
    points = cloud.points[:200]
    for cloud_or_points, options in (
        (points, {"ratio": 1}),
        (np.concatenate([points, points]), {"n_points": 300}),
        (np.concatenate([points, [[np.nan] * 3]]), {"n_points": 200, "invalid": "drop"}),
        (points, {"n_points": 100, "weight": np.arange(200) >= 100}),
    ):
        with pytest.raises(gppcs.ParameterError, match="all points"):
            gppcs.simplify(cloud_or_points, **options).prefix(10)
    with pytest.raises(gppcs.ParameterError, match="at most 50 points, as the result has, found 51"):
        gppcs.simplify(cloud, n_points=50, method="fps").prefix(51)


@pytest.mark.parametrize(
    "method",
    [name for name, method in gppcs.METHODS.built_in.items() if Feature.RANKING in method.supports and name != "gp"],
)
def test_the_first_points_of_a_ranking_are_those_of_a_smaller_run_or_as_evenly_spread(method):
    cloud = gppcs.sample("bracket", n_points=3000)
    long, short = (gppcs.simplify(cloud, n_points=n, method=method) for n in (200, 100))
    assert (long.prefix(100).indices == long.indices[:100]).all()
    if method == "sample-elimination":  # which orders the points by removing half of them again and again
        radii = [gppcs.evaluate(cloud, result.cloud).covering_radius for result in (long.prefix(100), short)]
        assert radii[0] < 1.2 * radii[1]
    else:
        assert (long.indices[:100] == short.indices).all()


@pytest.mark.parametrize("beyond_memory", [False, True])
def test_the_same_points_come_in_the_order_asked_for(tmp_path, beyond_memory):
    cloud = gppcs.sample("bracket", n_points=3000)
    times = np.random.default_rng(0).integers(0, 500, 3000) / 8  # with repeats
    gppcs.write(tmp_path / "a.ply", gppcs.PointCloud(cloud.points, {"gps_time": times}))
    path, options = tmp_path / "a.ply", {"n_points": 300, "scores": True}
    if beyond_memory:
        options["workers"] = ThreadPoolExecutor(1)
    ranking = gppcs.simplify(path, **options)
    for order, positions in (
        ("input", np.argsort(ranking.indices)),
        ("gps_time", np.lexsort([ranking.indices, times[ranking.indices]])),
    ):
        result = gppcs.simplify(path, order=order, **options)
        assert result.indices.tolist() == ranking.indices[positions].tolist()
        assert result.cloud == ranking.cloud.take(positions)
        assert sorted(result.prefix(10).indices) == sorted(ranking.indices[:10])
        assert (result.with_attributes(rank=True).cloud.attributes["rank"] == positions).all()
        assert not result.ranked
    with pytest.raises(gppcs.InputError, match="no attribute 'gps_time'"):
        gppcs.simplify(cloud, n_points=300, order="gps_time")


@pytest.mark.parametrize("method", ["gp", "fps"])
@pytest.mark.parametrize("axes", [2, 3])
def test_a_batch_gets_the_result_of_each_cloud(method, axes):
    batch = np.random.default_rng(0).random((5, 300, axes))
    expected = [gppcs.simplify(points, n_points=40, method=method) for points in batch]
    steps = []
    timer = gppcs.Timer(on_progress=lambda stage, done, total: steps.append((stage, done, total)))
    results = gppcs.simplify_batch(batch, n_points=40, method=method, timer=timer)
    assert [result.indices.tolist() for result in results] == [result.indices.tolist() for result in expected]
    assert results.indices.shape == (5, 40)
    chosen = np.take_along_axis(batch, results.indices[..., np.newaxis], axis=1)
    assert np.array_equal(results.points[..., :axes], chosen)
    assert steps[-1] == ("clouds", 5, 5)


def test_a_list_of_clouds_of_any_kind_is_a_batch(tmp_path, bracket):
    gppcs.write(tmp_path / "a.ply", bracket)
    results = gppcs.simplify_batch([bracket, tmp_path / "a.ply", bracket[:100]], ratio=0.1, method="fps")
    assert results[0].indices.tolist() == results[1].indices.tolist()
    assert len(results[2]) == 10
    with pytest.raises(gppcs.InputError, match=f"found 10, {len(bracket) // 10};"):
        results.indices  # noqa: B018


@pytest.mark.parametrize("batch", [np.zeros((9, 3)), "scan.ply", None, 3])
def test_what_is_no_batch_is_refused(batch):
    with pytest.raises(gppcs.InputError, match=r"\(B, N, 3\)"):
        gppcs.simplify_batch(batch, n_points=3)


def test_an_error_in_a_batch_is_that_of_the_cloud():
    with pytest.raises(gppcs.InputError, match="finite"):
        gppcs.simplify_batch(np.full((3, 9, 3), np.nan), n_points=3)
