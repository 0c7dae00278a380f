"""Outliers of files larger than memory: the same as in memory, and all else as if they were not there."""

import numpy as np
import pytest

import gppcs
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.spatial import stored
from gppcs.streaming import files as streaming_files
from gppcs.streaming import plan as planning
from gppcs.streaming.outliers import OutlierSearch
from gppcs.streaming.partitions import LeftOut
from gppcs.streaming.plan import NOTHING, Besides, Plan, Way
from gppcs.surface.outliers import tiles
from heard import Heard

N = 5_000


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Let a cloud of thousands be a large one that does not fit into memory, in small chunks and tiles."""
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 2_000)
    for kind in (gppcs.LocalGP, gppcs.Voxel, gppcs.Random):
        monkeypatch.setattr(kind, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(streaming_files, "simplify", None)  # which takes a cloud in memory
    monkeypatch.setattr(planning, "ROWS_PER_KEPT", 0)
    for name in ("ROWS", "FEWEST_ROWS"):
        monkeypatch.setattr(planning, name, 700)
    for module, name, value in ((tiles, "TILE", 1_500), (tiles, "HALO", 1_500), (stored, "BOX", 400)):
        monkeypatch.setattr(module, name, value)


@pytest.fixture(scope="module")
def cloud():
    """A bracket with strays, repeats of them, too, and points that are not finite."""
    points = gppcs.sample("bracket", N, seed=3, outliers=0.02).points
    points[600:620, 1] = np.nan
    points[-90:-30] = points[:60]
    points[-30:] = points[gppcs.find_outliers(points)][:30]
    kind, half = np.arange(N) % 500 < 8, points[:, 2] > 5.0
    return gppcs.PointCloud(points, {"kind": kind.astype(np.uint8), "half": half.astype(np.float32)})


@pytest.fixture(scope="module", params=[[], [1_000, 1_001, 3_500]], ids=["one file", "four files"])
def paths(cloud, request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    found = []
    for number, rows in enumerate(np.split(np.arange(N), request.param)):
        found.append(folder / f"{number}.ply")
        gppcs.write(found[-1], cloud.take(rows))
    return found


def in_passes(paths, **options):
    return gppcs.simplify_files(paths, drop_outliers=True, memory="3GB", invalid="drop", **options)


ASKED = [
    {"n_points": 80, "scores": True},
    {"ratio": 0.02, "keep": "kind == 1"},
    {"n_points": 80, "weight": "half"},
    {"ratio": 0.02, "max_gap": 10.0},
    {"spacing": 20.0},
    {"max_gap": "7%"},
    {"n_points": 120, "method": gppcs.Voxel(place="mean")},
]


@pytest.mark.parametrize("wanted", ASKED, ids=str)
def test_the_same_result_as_in_memory(cloud, paths, wanted):
    expected = gppcs.simplify(cloud, drop_outliers=True, invalid="drop", **wanted)
    found = in_passes(paths, **wanted)
    np.testing.assert_array_equal(found.indices, expected.indices)
    np.testing.assert_array_equal(found.outliers, np.flatnonzero(gppcs.find_outliers(cloud)))
    np.testing.assert_array_equal(found.outliers, expected.outliers)
    assert found.cloud == expected.cloud
    assert found.diagnostics == expected.diagnostics
    assert found.diagnostics["outliers"] == len(found.outliers) > 60


def test_in_memory_it_is_as_if_outliers_were_not_there(cloud):
    outside = gppcs.find_outliers(cloud)
    for options in ({"ratio": 0.05, "weight": "half"}, {"n_points": 60, "normals": True}):
        found = gppcs.simplify(cloud, drop_outliers=True, invalid="drop", **options)
        expected = gppcs.simplify(cloud[~outside], invalid="drop", **options)
        np.testing.assert_array_equal(found.indices, np.flatnonzero(~outside)[expected.indices])
        assert found.cloud == expected.cloud
        assert dict(found.diagnostics) == {**expected.diagnostics, "outliers": outside.sum()}
        assert found.curve() == expected.curve()
        assert len(found.prefix(9).outliers) == outside.sum()


def test_an_outlier_is_left_out_also_if_it_is_to_be_kept(cloud):
    outside = gppcs.find_outliers(cloud)
    found = gppcs.simplify(cloud, drop_outliers=True, invalid="drop", n_points=200, keep=np.flatnonzero(outside)[:50])
    assert not outside[found.indices].any()
    with pytest.raises(gppcs.InputError, match="expected points with z > 1e3 to keep, found none"):
        gppcs.simplify(np.concatenate([cloud.points, [[0, 0, 5e3]]]), drop_outliers=True, invalid="drop", n_points=9,
                       keep="z > 1e3")  # fmt: skip


def test_random_points_are_no_outliers(cloud, paths):
    found = in_passes(paths, n_points=2_000, method="random")
    assert len(np.unique(found.indices)) == 2_000
    assert not gppcs.find_outliers(cloud)[found.indices].any()


def test_an_accuracy_is_measured_without_outliers(cloud, paths, monkeypatch):
    monkeypatch.setattr("gppcs.gp.local.survey.PER_POINT", 8)
    monkeypatch.setattr("gppcs.amounts.accuracy.FIRST", 100)
    found = in_passes(paths, tolerance=4.0, measure="max")
    assert len(found.indices) < 0.2 * N
    assert found.diagnostics["surface_max"] <= 4.0


def test_their_list_has_all_attributes_and_the_types_of_all_points(cloud, paths):
    with CloudFiles(paths) as files, OutlierSearch(files, "drop", True, Stages()) as search:
        found = search.found(Plan(Way.PASSES, N, 9, 0, None, 700))
        assert search.found(None) is found  # once
    assert found.cloud == cloud[gppcs.find_outliers(cloud)]


def test_points_that_are_not_finite_are_told_as_without(paths):
    with pytest.raises(gppcs.InputError, match=r"20 of 5000 points have coordinates that are NaN .* at index 600"):
        gppcs.simplify_files(paths, n_points=9, drop_outliers=True, memory="3GB")


def test_no_more_passes_than_planned(cloud, tmp_path, monkeypatch):
    gppcs.write(tmp_path / "finite.ply", cloud.take(cloud.finite_rows()))
    read, plain = [], CloudFiles.chunks
    monkeypatch.setattr(CloudFiles, "chunks", lambda *of: read.append(1) or plain(*of))
    heard = Heard()
    in_passes(tmp_path / "finite.ply", n_points=80, stages=Stages(heard))
    assert len(read) == Plan(Way.PASSES, N, 80, 0, None, 700, besides=Besides(outliers=True)).passes == 7
    assert [stage for stage, total, _ in heard.stages if total][:4] == ["bounds", "sample", "boxes", "outliers"]
    assert all(done == total for _, total, done in heard.stages[:4])


def test_the_plan_counts_memory_and_disk(paths):
    plans = []
    with CloudFiles(paths) as files:
        for besides in (NOTHING, Besides(outliers=True)):
            plans.append(planning.plan(files, gppcs.LocalGP(), None, 50, 3 * 10**9, besides=besides))
    assert plans[1].memory > plans[0].memory
    assert (plans[0].disk, plans[1].disk) == (0, tiles.ON_DISK * plans[1].points)


class Interrupt(Heard):
    """Interrupts a run at the first step of a stage."""

    def __init__(self, stage=None):
        super().__init__()
        self._stage = stage

    def advanced(self, steps):
        super().advanced(steps)
        if self.stages[-1][0] == self._stage:
            raise InterruptedError


@pytest.mark.parametrize(
    ("wanted", "stage", "first"),
    [
        ({"n_points": 80}, "boxes", "sample"),  # the bounds are known
        pytest.param({"n_points": 80}, "listed outliers", "listed outliers", marks=pytest.mark.slow),
        ({"n_points": 80}, "kept points", "kept points"),
        ({"max_gap": 12.0}, "kept points", "bounds"),  # to count the points, but the outliers are known
    ],
)
def test_an_interrupted_search_goes_on(cloud, paths, tmp_path, wanted, stage, first):
    expected = gppcs.simplify(cloud, drop_outliers=True, invalid="drop", **wanted)
    options = {"scratch": tmp_path, "resume": True, **wanted}
    with pytest.raises(InterruptedError):
        in_passes(paths, stages=Stages(Interrupt(stage)), **options)
    assert list(tmp_path.iterdir())
    heard = Interrupt()
    found = in_passes(paths, stages=Stages(heard), **options)
    np.testing.assert_array_equal(found.indices, expected.indices)
    again = [name for name, total, _ in heard.stages if total]
    assert again[0] == first
    assert "boxes" not in again or stage == "boxes"
    assert not list(tmp_path.iterdir())


class Part:
    """A part of a file, by its first row there."""

    def __init__(self, first):
        self.first = first


def test_rows_are_divided_among_parts_of_files():
    """Three files begin at rows 0, 100 and 110; the last one is read in two parts."""
    left_out = LeftOut(np.array([0, 99, 100, 129, 130, 500]), [0, 100, 110])
    found = left_out.divided([Part(0), Part(0), Part(0), Part(20)])
    assert [rows.tolist() for rows in found] == [[0, 99], [0], [19], [0, 370]]
