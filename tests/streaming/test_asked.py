"""What is asked for besides a number, in passes: the same points as in memory, whatever the files and chunks."""

from dataclasses import replace

import numpy as np
import pytest

import gppcs
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.spatial.chunks import ChunkedPoints
from gppcs.spatial.kdtree import KdTree
from gppcs.streaming import asked as streaming_asked
from gppcs.streaming import files as streaming_files
from gppcs.streaming import plan as planning
from gppcs.streaming.passes import simplify_in_passes
from gppcs.streaming.plan import Besides, Plan, Way
from heard import Heard

N = 6_000


@pytest.fixture(autouse=True)
def small_sample(monkeypatch):
    """Let a cloud of thousands be a large one, of which a sample is measured."""
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 2_000)


@pytest.fixture
def short_rankings(monkeypatch):
    """Let a few hundred points be so few that a sample of the cloud is measured."""
    monkeypatch.setattr("gppcs.gp.local.survey.PER_POINT", 8)
    monkeypatch.setattr("gppcs.amounts.accuracy.FIRST", 100)


@pytest.fixture
def in_passes(monkeypatch):
    """Let no cloud fit into memory, and chunks be small."""
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(streaming_files, "simplify", None)  # which takes a cloud in memory

    def run(rows, paths, **options):
        for name in ("ROWS", "FEWEST_ROWS"):
            monkeypatch.setattr(planning, name, rows)
        monkeypatch.setattr(planning, "ROWS_PER_KEPT", 0)
        return gppcs.simplify_files(paths, memory="3GB", invalid="drop", **{"scores": True, **options})

    return run


@pytest.fixture(scope="module")
def cloud():
    """A bracket with repeats, also of points to keep, and points that are not finite."""
    points = gppcs.sample("bracket", N, seed=3).points
    points[500:520, 1] = np.nan
    points[3000:3500] = points[:500]
    kind = (np.arange(N) % 500 < 8).astype(np.uint8)  # each eight points repeat others
    wanted = np.random.default_rng(4).random(N) * (1.0 + 3.0 * (points[:, 2] > 5.0))
    wanted[510] = -1.0  # of a point that is not finite
    return gppcs.PointCloud(points, {"kind": kind, "wanted": wanted, "half": (points[:, 2] > 5.0).astype(np.uint8)})


@pytest.fixture(scope="module", params=[[], [2_000, 2_001, 4_500]], ids=["one file", "four files"])
def paths(cloud, request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    found = []
    for number, rows in enumerate(np.split(np.arange(N), request.param)):
        found.append(folder / f"{number}.ply")
        gppcs.write(found[-1], cloud.take(rows))
    return found


ASKED = [
    {"spacing": 20.0},
    {"spacing": "1.6 cm", "unit": "mm"},
    {"spacing": "12%"},
    {"n_points": 120, "keep": "kind == 1"},
    {"ratio": 0.02, "keep": "kind == 1 and z > 5"},
    {"n_points": 88, "keep": "kind == 1"},
    {"n_points": 120, "weight": "wanted"},
    {"ratio": 0.02, "weight": "half"},
    {"n_points": 120, "weight": "half", "keep": "kind == 1"},
    {"n_points": 60, "weight": "half"},
    {"n_points": 60, "max_gap": 9.0},
    {"max_gap": "7%"},
    {"spacing": 20.0, "max_gap": "1.2cm", "unit": "mm"},
    {"n_points": 120, "max_gap": 10.0, "keep": "kind == 1"},
    {"max_gap": 10.0, "weight": "half", "keep": "kind == 1"},
]


@pytest.mark.parametrize("rows", [300, pytest.param(N, marks=pytest.mark.slow)])
@pytest.mark.parametrize("wanted", ASKED)
def test_files_and_chunks_make_no_difference(in_passes, cloud, paths, wanted, rows):
    expected = gppcs.simplify(cloud, invalid="drop", scores=True, **wanted)
    assert expected.ranked
    assert_same(in_passes(rows, paths, **wanted), expected)


def assert_same(found, expected):
    np.testing.assert_array_equal(found.indices, expected.indices)
    assert found.cloud == expected.cloud
    assert found.diagnostics == expected.diagnostics


@pytest.mark.parametrize("n_points", [1_000, 5_600, N])
def test_where_all_points_are_measured_too(cloud, paths, n_points):
    expected = gppcs.simplify(cloud, n_points=n_points, keep="kind == 1", invalid="drop", scores=True)
    with CloudFiles(paths) as files:
        made = Plan(Way.PASSES, N, n_points, 0, None, 1_000)
        asked = {"ratio": None, "n_points": n_points, "invalid": "drop", "scores": True, "keep": "kind == 1"}
        found, _ = simplify_in_passes(files, made, gppcs.LocalGP(), stages=Stages(), **asked)
    assert_same(found, expected)


PASSES = ["bounds", "weights", "sample", "candidates", "weights", "kept points"]
BY_PASSES = [
    ({"weight": "wanted"}, PASSES),
    ({"weight": "half", "keep": "kind == 1"}, PASSES),
    ({"max_gap": 9.0}, ["bounds", "sample", "candidates", "gaps", "gaps", "gaps", "kept points"]),
    ({"max_gap": 9.0, "weight": "half"}, [*PASSES[:-1], "gaps", "gaps", "gaps", "kept points"]),
]


@pytest.mark.parametrize(("wanted", "passes"), BY_PASSES)
def test_no_more_passes_than_planned_and_never_all_points(in_passes, paths, monkeypatch, wanted, passes):
    read, plain = [], CloudFiles.chunks
    monkeypatch.setattr(CloudFiles, "chunks", lambda *of: read.append(1) or plain(*of))
    monkeypatch.setattr("gppcs.amounts.choice._Asked", None)  # which holds all places
    heard = Heard()
    in_passes(1_000, paths, n_points=90, stages=Stages(heard), **wanted)
    besides = Besides(False, "weight" in wanted, "max_gap" in wanted)
    assert len(read) == Plan(Way.PASSES, N, 90, 0, None, 1_000, besides=besides).passes == len(passes)
    whole = [stage for stage, _, steps in heard.stages if steps > 2_000]  # fewer are candidates
    assert whole == passes


@pytest.mark.parametrize("more", [{}, {"weight": "half"}])
def test_an_accuracy_takes_about_as_many_passes_as_we_say(in_passes, short_rankings, paths, monkeypatch, more):
    read, plain = [], CloudFiles.chunks
    monkeypatch.setattr(CloudFiles, "chunks", lambda *of: read.append(1) or plain(*of))
    in_passes(1_000, paths, tolerance=4.0, **more)
    least = Plan(Way.PASSES, N, 90, 0, None, 1_000, besides=Besides(weights=bool(more), accuracy=True)).passes
    assert max(10, least) <= len(read) <= 25


def test_points_without_weight_are_not_kept(in_passes, cloud, paths):
    kept = in_passes(1_000, paths, n_points=120, weight="half").cloud
    assert kept.attributes["half"].all()


@pytest.mark.parametrize("bad", [{4_700: -2.0, 4_800: np.inf}, {30: np.nan}, dict.fromkeys(range(N), 0.0)])
def test_bad_weights_are_told_as_in_memory(in_passes, cloud, tmp_path, bad):
    """Wherever they are, but not of a point that is not finite."""
    wanted = cloud.attributes["wanted"].copy()
    wanted[list(bad)] = list(bad.values())
    cloud = gppcs.PointCloud(cloud.points, {"wanted": wanted})
    paths = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for path, rows in zip(paths, np.split(np.arange(N), [4_000]), strict=True):
        gppcs.write(path, cloud.take(rows))
    with pytest.raises(gppcs.InputError) as expected:
        gppcs.simplify(cloud, n_points=100, weight="wanted", invalid="drop")
    with pytest.raises(gppcs.InputError) as found:
        in_passes(1_000, paths, n_points=100, weight="wanted")
    assert str(found.value) == str(expected.value)


MEASURED = [
    ({"tolerance": 4.0}, "p95"),
    ({"tolerance": "1%", "measure": "mean"}, "mean"),
    ({"tolerance": 1.0, "measure": "rms", "weight": "half"}, "rms"),
    ({"tolerance": "0.5cm", "unit": "mm", "measure": "max", "keep": "kind == 1"}, "max"),
]


@pytest.mark.parametrize(("wanted", "measure"), MEASURED)
def test_a_tolerance_is_reached_and_five_per_cent_fewer_points_miss_it(
    in_passes, short_rankings, cloud, tmp_path, wanted, measure
):
    """Both as `gppcs.evaluate` judges the written file. Without repeats, of which there it takes no note."""
    cloud = cloud.take(np.r_[0:500, 520:3_000, 3_500:N])
    results = []
    for name, cuts, rows in (("one", [], 6_000), ("four", [800, 801, 4_000], 700)):
        (tmp_path / name).mkdir()
        paths = [tmp_path / name / f"{number}.ply" for number in range(len(cuts) + 1)]
        for path, part in zip(paths, np.split(np.arange(len(cloud)), cuts), strict=True):
            gppcs.write(path, cloud.take(part))
        results.append(in_passes(rows, paths, **wanted))
    assert_same(*results)
    found = results[0]
    usable = cloud.take(np.flatnonzero(cloud.attributes["half"])) if "weight" in wanted else cloud
    diagonal = gppcs.info(cloud).diagonal
    tolerance = {4.0: 4.0, "1%": 0.01 * diagonal, 1.0: 1.0, "0.5cm": 5.0}[wanted["tolerance"]]
    gppcs.write(tmp_path / "small.ply", found.cloud)
    reached = gppcs.evaluate(usable, tmp_path / "small.ply").figures()
    assert reached[f"surface_{measure}"] <= tolerance
    for name in ("mean", "rms", "p95", "max"):
        assert found.diagnostics[f"surface_{name}"] == pytest.approx(reached[f"surface_{name}"], rel=1e-9)
    fewer = found.prefix(int(0.95 * len(found.indices)))
    assert gppcs.evaluate(usable, fewer.cloud).figures()[f"surface_{measure}"] > tolerance


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"tolerance": 1e-9}, "expected a tolerance that 300 points reach, the most that fit into memory, found one"),
        (
            {"tolerance": 4.0, "keep": "z > 30"},
            r"points to keep: expected at most 300, the most that can be ranked in memory, found 1,589; select fewer",
        ),
    ],
)
def test_a_tolerance_that_takes_too_long_a_ranking_is_refused(
    in_passes, short_rankings, monkeypatch, paths, wanted, message
):
    monkeypatch.setattr(streaming_asked, "_most_ranked", lambda *of: 300)
    with pytest.raises(gppcs.InputError, match=message):
        in_passes(1_000, paths, **wanted)


def test_the_longest_ranking_is_found_up_to_a_fifth():
    def in_passes(count):
        if count > 7_777:
            raise gppcs.InputError

    begun = Plan(Way.PASSES, N * 100, 1_000, 0, None, 1_000)
    assert 7_777 / 1.2 <= streaming_asked._most_ranked(begun, in_passes) <= 7_777
    assert streaming_asked._most_ranked(replace(begun, points=5_000), in_passes) == 5_000


@pytest.fixture
def few_places(cloud, tmp_path):
    """A cloud of 80 places, each of them 50 times, in two files. Two of them are to be kept."""
    usable = cloud.take(np.arange(0, 480, 6))
    cloud = usable.take(np.random.default_rng(7).permutation(np.repeat(np.arange(80), 50)))
    paths = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for path, rows in zip(paths, np.split(np.arange(len(cloud)), [1_500]), strict=True):
        gppcs.write(path, cloud.take(rows))
    return cloud, paths


@pytest.mark.parametrize("keep", [None, "kind == 1"])
def test_where_points_repeat_few_places_a_ranking_of_these_is_judged(in_passes, short_rankings, few_places, keep):
    cloud, paths = few_places
    found = in_passes(1_000, paths, tolerance=6.0, measure="mean", keep=keep)
    expected = gppcs.simplify(cloud, tolerance=6.0, measure="mean", keep=keep)
    assert found.diagnostics["surface_mean"] <= 6.0
    assert len(expected.indices) < 500
    assert abs(len(found.indices) - len(expected.indices)) <= 1
    assert in_passes(1_000, paths, tolerance=1e-9, measure="max").diagnostics["surface_max"] == 0.0


@pytest.mark.parametrize("n_points", [101, 120, 300])
def test_few_places_are_never_all_read_into_memory(in_passes, short_rankings, monkeypatch, few_places, n_points):
    cloud, paths = few_places
    wanted = {"n_points": n_points, "keep": "kind == 1", "weight": "half"}
    expected = gppcs.simplify(cloud, scores=True, **wanted)
    plain = ChunkedPoints.every

    def every(self, step, *more):
        assert step > 1 or len(self) <= 80
        return plain(self, step, *more)

    monkeypatch.setattr(ChunkedPoints, "every", every)
    assert_same(in_passes(1_000, paths, **wanted), expected)


def test_an_accuracy_and_no_larger_gap(in_passes, short_rankings, paths):
    found = in_passes(1_000, paths, tolerance=4.0, max_gap=9.0)
    assert found.diagnostics["surface_p95"] <= 4.0
    assert found.diagnostics["largest_gap"] <= 9.0


@pytest.mark.parametrize("method", ["fps", "random", gppcs.Voxel(place="mean")])
def test_gaps_between_points_of_other_methods_are_filled(in_passes, monkeypatch, cloud, paths, method):
    for kind in (gppcs.FarthestPoint, gppcs.Random, gppcs.Voxel):
        monkeypatch.setattr(kind, "memory", lambda self, n, n_points: 10**12)
    found = in_passes(1_000, paths, n_points=60, max_gap=9.0, method=method, scores=False)
    assert len(found.indices) == 60 + found.diagnostics["added_in_gaps"] > 60
    original = cloud.points[np.isfinite(cloud.points).all(axis=1)]
    covering = KdTree.build(found.cloud.points).nearest_of(original, 1)[1].max() ** 0.5
    assert covering == pytest.approx(found.diagnostics["largest_gap"])
    assert covering < 9.0
    if method == gppcs.Voxel(place="mean"):
        expected = gppcs.simplify(cloud, n_points=60, max_gap=9.0, method=method, invalid="drop")
        np.testing.assert_array_equal(found.indices, expected.indices)
        np.testing.assert_array_equal(found.cloud.points, expected.cloud.points)


def test_points_to_keep_come_first(cloud):
    wanted = np.flatnonzero(cloud.attributes["kind"] & np.isfinite(cloud.points).all(axis=1))
    result = gppcs.simplify(cloud, n_points=120, keep="kind == 1", invalid="drop")
    assert sorted(result.indices[: len(wanted)]) == wanted.tolist()
    assert result.diagnostics["points_to_keep"] == len(wanted)
    assert len(np.unique(result.indices)) == 120
    others = cloud.points[result.indices[len(wanted) :]]
    assert len(np.unique(np.concatenate([cloud.points[wanted], others]), axis=0)) == len(others) + len(wanted) - 8


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"n_points": 87, "keep": "kind == 1"}, "points to keep: expected at most 87, .* found 88"),
        ({"n_points": 95, "keep": "kind == 7"}, "expected points with kind == 7 to keep, found none"),
        ({"n_points": 95, "keep": "kin == 7"}, "no attribute 'kin'; did you mean 'kind'"),
        ({"spacing": "4mm"}, "does not say in which unit"),
        ({"n_points": 95, "keep": [1, 2]}, "as keep takes all points at once"),
        (
            {"n_points": 100, "weight": "kind"},
            "expected at least 100 points of a weight above 0, found 88; ask for fewer",
        ),
        ({"n_points": 95, "weight": "hall"}, "the cloud has no attribute 'hall' to weigh its points by; did you mean"),
        ({"n_points": 95, "weight": np.ones(N)}, "as weight takes all points at once"),
        ({"tolerance": 1.0, "method": "fps"}, "as tolerance takes all points at once"),
        ({"tolerance": "4mm"}, "does not say in which unit"),
        ({"max_gap": "4mm"}, "does not say in which unit"),
        ({"max_gap": 4.0, "keep": "kind == 7"}, "expected points with kind == 7 to keep, found none"),
        ({"max_gap": 4.0, "method": "fps"}, "as max_gap takes all points at once"),
        ({"tolerance": 4.0, "normals": True}, "as normals takes all points at once"),
        ({"spacing": 4.0, "method": "fps"}, "as spacing takes all points at once"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(in_passes, short_rankings, monkeypatch, paths, wanted, message):
    monkeypatch.setattr(gppcs.FarthestPoint, "memory", lambda self, n, n_points: 10**12)
    with pytest.raises(gppcs.InputError, match=message):
        in_passes(1_000, paths, **{"method": "gp", **wanted})


def test_a_spacing_below_that_of_the_points_keeps_each_place_once(in_passes, cloud, paths):
    expected = gppcs.simplify(cloud, spacing=1e-3, invalid="drop", scores=True)
    assert len(expected.indices) == N - 20 - 500
    assert_same(in_passes(1_000, paths, spacing=1e-3), expected)


def test_cloud_in_memory_is_not_counted_in_passes(monkeypatch, cloud, paths):
    monkeypatch.setattr(streaming_asked, "count_in_passes", None)
    found = gppcs.simplify_files(paths, spacing=4.0, invalid="drop")
    np.testing.assert_array_equal(found.indices, gppcs.simplify(cloud, spacing=4.0, invalid="drop").indices)
