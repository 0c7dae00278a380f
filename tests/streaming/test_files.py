"""Files in passes: the same points as in memory, whatever the files and chunks; and when passes are taken."""

import dataclasses
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import gppcs
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.streaming import files as streaming_files
from gppcs.streaming import passes as streaming_passes
from gppcs.streaming import plan as planning
from gppcs.streaming.passes import simplify_in_passes
from gppcs.streaming.plan import Plan, Way, expected_seconds, plan
from gppcs.streaming.sizes import bytes_of, size_of
from heard import Heard

N = 6_000


@pytest.fixture(autouse=True)
def small_sample(monkeypatch):
    """Let a cloud of thousands be a large one, of which a sample is measured."""
    monkeypatch.setattr("gppcs.gp.local.survey.LARGE", 2_000)


def variants():
    """Clouds that differ in what the method makes of them."""
    rng = np.random.default_rng(0)
    bracket = gppcs.sample("bracket", N, seed=3).points
    noisy = bracket + 0.3 * rng.standard_normal(bracket.shape)
    gaps = bracket.copy()
    gaps[rng.integers(0, N, N // 3)] = np.nan
    gaps[5:2000, 1] = np.inf
    dot = bracket.copy()
    dot[: N // 2] = 1e-6 * noisy[: N // 2]
    return {
        "plain": bracket,
        "noisy": noisy,
        "with gaps": gaps,
        "twice": np.concatenate([bracket[: N // 2], bracket[: N // 2]]),
        "few places": bracket[:120][rng.integers(0, 120, N)],
        "one place": np.tile(bracket[:1], (N, 1)),
        "half in a dot": dot,
        "far away": np.float32(bracket) + np.float64(6e6),
        "tiny": bracket[:9],
    }


VARIANTS = variants()


def cloud_of(points):
    return gppcs.PointCloud(points, {"row": np.arange(len(points), dtype=np.int32)})


def written(cloud, folder, cuts, suffix=".npy"):
    paths = []
    for i, rows in enumerate(np.split(np.arange(len(cloud)), cuts)):
        paths.append(Path(folder) / f"{i}{suffix}")
        gppcs.write(paths[-1], cloud.take(rows))
    return paths


def in_passes(paths, rows, n_points, method=None, **options):
    made = Plan(Way.PASSES, N, n_points, 0, None, rows)
    options = {"invalid": "drop", "scores": True, **options}
    with CloudFiles(paths) as files:
        return simplify_in_passes(
            files, made, method or gppcs.LocalGP(), ratio=None, n_points=n_points, stages=Stages(), **options
        )


def assert_same(found, expected):
    np.testing.assert_array_equal(found.indices, expected.indices)
    assert found.indices.dtype == expected.indices.dtype
    assert found.cloud == expected.cloud
    assert found.diagnostics == expected.diagnostics


SPLITS = st.lists(st.integers(0, N), max_size=6).map(sorted)


@pytest.mark.parametrize("variant", VARIANTS)
@given(cuts=SPLITS, rows=st.integers(300, 8_000), n_points=st.sampled_from([1, 30, 70, 119, 121, 3_000, N - 1, 10**9]))
@example(cuts=[], rows=N, n_points=70)
@example(cuts=[1, 2, 3], rows=100, n_points=70)
@example(cuts=[5000], rows=1_000, n_points=120)
@settings(max_examples=3)
def test_files_and_chunks_make_no_difference(variant, cuts, rows, n_points):
    cloud = cloud_of(VARIANTS[variant])
    expected = gppcs.simplify(cloud, n_points=n_points, invalid="drop", scores=True)
    with tempfile.TemporaryDirectory() as folder:
        found, n = in_passes(written(cloud, folder, [min(cut, len(cloud)) for cut in cuts]), rows, n_points)
    assert n == len(cloud)
    assert len(found.indices) == min(n_points, np.isfinite(cloud.points).all(axis=1).sum())
    assert_same(found, expected)


@pytest.mark.parametrize("suffix", [".ply", ".csv", ".npz"])
def test_formats_make_no_difference(tmp_path, suffix):
    paths = written(cloud_of(VARIANTS["plain"]), tmp_path, [2_000, 7_000], suffix)
    gppcs.write(tmp_path / f"whole{suffix}", cloud_of(VARIANTS["plain"]))
    expected = gppcs.simplify(gppcs.read(tmp_path / f"whole{suffix}"), n_points=70, scores=True)
    assert_same(in_passes(paths, 1_000, 70)[0], expected)


def test_a_method_that_takes_all_points_takes_them_without_repeats(tmp_path):
    cloud = cloud_of(VARIANTS["twice"])
    found, _ = in_passes(written(cloud, tmp_path, [100]), 1_000, 70, gppcs.Random(seed=4), scores=False)
    assert_same(found, gppcs.simplify(cloud, n_points=70, method=gppcs.Random(seed=4)))


@pytest.mark.parametrize("variant", ["twice", "few places"])
def test_repeats_come_last(variant):
    """Also where only a sample is looked at."""
    points = VARIANTS[variant]
    places = len(np.unique(points, axis=0))
    for n_points in (30, 70, 119, 121, 3_000):
        kept = points[gppcs.simplify(points, n_points=n_points).indices]
        assert len(np.unique(kept, axis=0)) == min(n_points, places)


def test_no_more_passes_than_planned(tmp_path, monkeypatch):
    paths, passes = written(cloud_of(VARIANTS["plain"]), tmp_path, []), []
    plain = CloudFiles.chunks
    monkeypatch.setattr(CloudFiles, "chunks", lambda *of: passes.append(1) or plain(*of))
    in_passes(paths, 1_000, 70)
    assert len(passes) == planning.PASSES


def test_each_pass_tells_its_progress(tmp_path):
    heard = Heard()
    with CloudFiles(written(cloud_of(VARIANTS["plain"]), tmp_path, [5_000])) as files:
        made = Plan(Way.PASSES, N, 70, 0, None, 1_000)
        simplify_in_passes(files, made, gppcs.LocalGP(), None, 70, "error", False, Stages(heard))
    whole = [stage for stage, total, steps in heard.stages if total == steps == N]
    assert whole == ["bounds", "sample", "candidates", "kept points"]


def test_points_that_are_not_finite_are_told_as_in_memory(tmp_path):
    cloud = cloud_of(VARIANTS["with gaps"])
    paths = written(cloud, tmp_path, [3, 5_000])
    with pytest.raises(gppcs.InputError) as expected:
        gppcs.simplify(cloud, n_points=70)
    with pytest.raises(gppcs.InputError) as found:
        in_passes(paths, 1_000, 70, invalid="error")
    assert str(found.value) == str(expected.value)
    gppcs.write(tmp_path / "none.npy", np.full((9, 3), np.nan))
    with pytest.raises(gppcs.InputError, match="none of the 9 points has finite coordinates"):
        in_passes([tmp_path / "none.npy"], 2, 5, scores=False)


def test_files_that_change_meanwhile_are_refused(tmp_path, monkeypatch):
    [path] = written(cloud_of(VARIANTS["plain"]), tmp_path, [])
    choose = streaming_passes.choose

    def truncated(*arguments, **options):
        gppcs.write(path, cloud_of(VARIANTS["plain"][:-1]), force=True)
        return choose(*arguments, **options)

    monkeypatch.setattr(streaming_passes, "choose", truncated)
    with pytest.raises(gppcs.InputError, match=r"expected 6,000 points again, found 5,999: the files have changed"):
        in_passes([path], 1_000, 70)


@pytest.fixture
def large(monkeypatch):
    """Let `gp` take as much memory as if the cloud were large, unless it goes in passes."""
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(gppcs.Random, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(gppcs.AIVS, "memory", lambda self, n, n_points: 10**12)


@pytest.mark.parametrize("method", ["gp", gppcs.LocalGP(feature_weight=0.9)])
def test_files_in_passes_from_python(tmp_path, large, monkeypatch, method):
    cloud = cloud_of(VARIANTS["noisy"])
    paths = written(cloud, tmp_path, [4_000])
    expected = gppcs.simplify(cloud, n_points=70, method=method, scores=True)
    monkeypatch.setattr(streaming_files, "simplify", None)  # which takes a cloud in memory
    for names in (paths, tuple(map(str, paths))):
        assert_same(gppcs.simplify_files(names, n_points=70, method=method, scores=True, memory="1GB"), expected)


def test_files_that_fit_are_read(tmp_path, monkeypatch):
    cloud = cloud_of(VARIANTS["plain"])
    paths = written(cloud, tmp_path, [4_000])
    monkeypatch.setattr(streaming_files, "simplify_in_passes", None)
    assert_same(gppcs.simplify_files(paths, ratio=0.01), gppcs.simplify(cloud, ratio=0.01))
    found = gppcs.simplify_files(paths[0], n_points=9, method="random", seed=3, normals=True)
    assert_same(found, gppcs.simplify(cloud.take(np.arange(4_000)), n_points=9, method="random", seed=3, normals=True))
    assert found.seconds["reading"] > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "aivs"}, r"at least 1,000 GB of memory, as method 'aivs' takes all points at once and there"),
        ({"normals": True}, r"as normals takes all points at once and there are about 6,\d\d\d, found 1 GB; raise m"),
        ({"memory": "1MB"}, r"at least \d+ MB of memory to choose 70 of about [67],\d+ points, found 1 MB"),
    ],
)  # fmt: skip
def test_too_little_memory_is_an_error_that_says_what_is_needed(tmp_path, large, options, message):
    paths = written(cloud_of(VARIANTS["plain"]), tmp_path, [])
    with pytest.raises(gppcs.InputError, match=message):
        gppcs.simplify_files(paths, n_points=70, **{"memory": "1GB", **options})


def test_a_format_without_chunks_is_told(tmp_path, large):
    gppcs.write(tmp_path / "a.npz", VARIANTS["plain"])
    with pytest.raises(gppcs.InputError, match="as NPZ files are read as a whole"):
        gppcs.simplify_files(tmp_path / "a.npz", n_points=70, memory="1GB")


@pytest.mark.parametrize("memory", ["3GB", "1GB"])
def test_a_part_of_files_is_a_cloud(tmp_path, monkeypatch, memory):
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 2 * 10**9)
    cloud = cloud_of(VARIANTS["plain"])
    written(cloud, tmp_path, [5_000])
    features = [{"assets": {"data": {"href": f"{i}.npy"}}} for i in range(2)]
    (tmp_path / "all.vpc").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    box = [*np.median(cloud.points, axis=0)[:2], 1e9, 1e9]
    inside = (cloud.points[:, :2] >= box[:2]).all(axis=1)
    expected = gppcs.simplify(cloud[inside], n_points=70)
    for paths in (tmp_path / "all.vpc", [tmp_path / "0.npy", tmp_path / "1.npy"]):
        assert_same(gppcs.simplify_files(paths, n_points=70, box=box, memory=memory), expected)


def test_files_of_a_given_format_and_columns(tmp_path):
    points = gppcs.sample("bracket", 400, seed=3).points
    rows = np.column_stack([np.arange(400), points])
    for name, part in (("east.dat", rows[:150]), ("west.dat", rows[150:])):
        np.savetxt(tmp_path / name, part, fmt="%.17g")
    options = {"format": "xyz", "columns": ["label", "x", "y", "z"]}
    found = gppcs.simplify_files([tmp_path / "east.dat", tmp_path / "west.dat"], n_points=50, **options)
    np.testing.assert_array_equal(found.indices, gppcs.simplify(points, n_points=50).indices)
    np.testing.assert_array_equal(found.cloud.attributes["label"], found.indices)


def test_a_part_without_points_is_told(tmp_path):
    [path] = written(cloud_of(VARIANTS["tiny"]), tmp_path, [])
    with pytest.raises(gppcs.InputError, match=r"expected points in the box, found none; gppcs\.info shows") as caught:
        gppcs.simplify_files(path, n_points=2, box=[1e6, 1e6, 2e6, 2e6])
    assert "gppcs info shows" in caught.value.command


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"box": [0, 0, 1]}, "expected a box xmin, ymin, xmax, ymax or"),
        ({"box": [1, 0, 0, 1]}, "with no minimum above its maximum"),
        ({"resolution": 0}, "expected a resolution above 0, found 0"),
        ({"assume_same_crs": "yes"}, "expected assume_same_crs to be True or False, found 'yes'"),
    ],
)
def test_what_is_no_part_is_refused(tmp_path, options, message):
    with pytest.raises(gppcs.ParameterError, match=message):
        gppcs.simplify_files(tmp_path / "none.npy", n_points=2, **options)


def test_only_copc_has_a_resolution(tmp_path):
    [path] = written(cloud_of(VARIANTS["tiny"]), tmp_path, [])
    with pytest.raises(gppcs.FileFormatError, match=r"0\.npy: expected a COPC file, .* leave out resolution="):
        gppcs.simplify_files(path, n_points=2, resolution=1.0)


@pytest.mark.parametrize("memory", [2 * 10**9, 10**12])
def test_files_with_different_coordinate_systems(two_systems, monkeypatch, memory):
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: memory)
    with pytest.raises(gppcs.FileFormatError, match=r"expected one coordinate system .* with assume_same_crs=True"):
        gppcs.simplify_files(two_systems, n_points=20, memory="3GB")
    found = gppcs.simplify_files(two_systems, n_points=20, memory="3GB", assume_same_crs=True)
    assert (len(found.indices), found.cloud.header.crs) == (20, "UTM 32N")


@pytest.mark.parametrize("paths", [[], None, 3])
def test_paths_that_are_none(paths):
    with pytest.raises(gppcs.ParameterError, match="expected a file or a list of files"):
        gppcs.simplify_files(paths, n_points=70)


@pytest.mark.parametrize(
    ("text", "size"),
    [("4GB", 4e9), ("512 MiB", 2**29), ("1.5g", 1.5e9), (" 9 ", 9), (7, 7), (".5kB", 500), ("2TiB", 2**41), ("1b", 1)],
)
def test_sizes_of_memory(text, size):
    assert bytes_of(text) == size


@pytest.mark.parametrize(
    "text", ["", "GB", "-1GB", "1 GB 2", "1e9", "nan", "٣GB", 0, -5, True, 2.5, None, b"1GB", "0.8", "1.5b"]
)
def test_what_is_no_size_of_memory(text):
    with pytest.raises(gppcs.ParameterError, match="expected an amount of memory such as 4GB or 512MB, found"):
        bytes_of(text)


def test_sizes_are_told_with_units():
    assert [size_of(size) for size in (1, 999_999, 2_500_000, 999_000_000, 10**9, 23_400_000_000, 10**12)] == [
        "1 B", "999,999 B", "3 MB", "999 MB", "1 GB", "23 GB", "1,000 GB",
    ]  # fmt: skip


def test_a_plan_grows_with_the_cloud(tmp_path, monkeypatch):
    paths = written(cloud_of(VARIANTS["plain"]), tmp_path, [])
    plans = []
    with CloudFiles(paths) as files:
        head = files.head()
        for points in (10**6, 10**8, 10**9):
            monkeypatch.setattr(CloudFiles, "head", lambda self, points=points: head._replace(points=points))
            plans.append(plan(files, gppcs.LocalGP(), None, 100_000, 3 * 10**9))
        seconds = [expected_seconds(files, made, gppcs.LocalGP()) for made in plans]
        assert expected_seconds(files, plans[0], gppcs.QEM()) is None
    assert [made.in_memory for made in plans] == [True, False, False]
    assert plans[1].memory == plans[2].memory < 3 * 10**9
    assert 0 < seconds[0] < seconds[2]


def test_without_word_of_free_memory_all_is_read(tmp_path, monkeypatch, large):
    monkeypatch.setattr(planning, "available_memory", lambda: None)
    with CloudFiles(written(cloud_of(VARIANTS["plain"]), tmp_path, [])) as files:
        made = plan(files, gppcs.LocalGP(), 0.1, None)
    assert (made.in_memory, made.limit) == (True, None)


@pytest.fixture
def small_tiles(large, monkeypatch):
    """Let no passes fit into memory, and let a tile be small."""
    monkeypatch.setattr(gppcs.LocalGP, "memory_in_passes", lambda self, n, n_points: 10**12)
    monkeypatch.setattr("gppcs.gp.tiled.ranking.TILE", 3_000)
    monkeypatch.setattr("gppcs.spatial.stored.BOX", 250)


def test_files_in_tiles(tmp_path, small_tiles):
    """Neither files nor chunks make a difference; the folder for temporary files is empty afterwards."""
    cloud = cloud_of(VARIANTS["with gaps"])
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    results = []
    for name, cuts, rows in (("one", [], 15_000), ("many", list(range(300, N, 1_700)), 700)):
        (tmp_path / name).mkdir()
        with CloudFiles(written(cloud, tmp_path / name, cuts)) as files:
            made = plan(files, gppcs.LocalGP(), None, 1_000, 3 * 10**9)
            assert made.way is Way.TILES
            made = dataclasses.replace(made, rows=rows)
            results.append(
                simplify_in_passes(files, made, gppcs.LocalGP(), None, 1_000, "drop", True, Stages(), scratch)[0]
            )
        assert not list(scratch.iterdir())
    assert_same(results[1], results[0])
    kept = results[0]
    assert len(np.unique(kept.indices)) == 1_000
    assert kept.cloud.take(np.arange(1_000)).attributes["row"].tolist() == kept.indices.tolist()
    np.testing.assert_array_equal(kept.cloud.points, cloud.points[kept.indices])
    assert (kept.cloud.attributes["score"] > 0).all()


def test_all_points_of_files_in_tiles_are_kept(tmp_path, small_tiles):
    cloud = cloud_of(VARIANTS["tiny"])
    found = gppcs.simplify_files(written(cloud, tmp_path, [4]), n_points=50, memory="3GB")
    assert_same(found, gppcs.simplify(cloud, n_points=50))


def test_a_failure_leaves_no_temporary_files(tmp_path, small_tiles, monkeypatch):
    paths = written(cloud_of(VARIANTS["plain"]), tmp_path, [])
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("gppcs.gp.tiled.ranking.tiled_field", None)
    with pytest.raises(TypeError):
        gppcs.simplify_files(paths, n_points=1_000, memory="3GB", scratch=tmp_path / "scratch")
    assert not list((tmp_path / "scratch").iterdir())


def test_too_little_disk_space_is_told(tmp_path, small_tiles, monkeypatch):
    paths = written(cloud_of(VARIANTS["plain"]), tmp_path, [])
    monkeypatch.setattr(gppcs.LocalGP, "disk_in_tiles", lambda self, n, n_points: 10**16)
    with pytest.raises(
        gppcs.OutputError, match=r"at least 10,000,000 GB of disk space for temporary files, found .*GB"
    ):
        gppcs.simplify_files(paths, n_points=1_000, memory="3GB", scratch=tmp_path)
    with pytest.raises(gppcs.OutputError, match="expected an existing folder for temporary files"):
        gppcs.simplify_files(paths, n_points=1_000, memory="3GB", scratch=tmp_path / "none")


def test_random_points_of_files(tmp_path, large):
    cloud = cloud_of(VARIANTS["with gaps"])
    (tmp_path / "many").mkdir()
    one, many = (
        gppcs.simplify_files(
            written(cloud, folder, cuts), n_points=500, method="random", seed=2, invalid="drop", memory="1GB"
        )
        for folder, cuts in ((tmp_path, []), (tmp_path / "many", [90, 4_000]))
    )
    assert_same(many, one)
    assert len(np.unique(one.indices)) == 500
    assert np.isfinite(one.cloud.points).all()


def test_means_of_cells_of_files(tmp_path, monkeypatch):
    """They are moved points: in the unit of the files, not in that of the choice."""
    monkeypatch.setattr(gppcs.Voxel, "memory", lambda self, n, n_points: 10**12)
    method, cloud = gppcs.Voxel(place="mean"), cloud_of(VARIANTS["far away"])
    expected = gppcs.simplify(cloud, n_points=200, method=method)
    found = gppcs.simplify_files(written(cloud, tmp_path, [5_000]), n_points=200, method=method, memory="1GB")
    np.testing.assert_array_equal(found.indices, expected.indices)
    np.testing.assert_array_equal(found.cloud.points, expected.cloud.points)
