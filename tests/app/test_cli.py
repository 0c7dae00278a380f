"""The command as its user meets it: what it writes, what it prints and where, how it fails."""

import dataclasses
import json
import math
import os
import pty
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import gppcs
from gppcs.app import cli, console
from gppcs.drawing.camera import Viewpoint
from meshes import hull_mesh

COMMAND = Path(sys.executable).with_name("gppcs")
FAST = ("--method", "fps")  # where it makes no difference


@pytest.fixture(scope="module", autouse=True)
def kernels():
    """Compile the kernels, so that the command does not say that it does."""
    cloud = gppcs.sample("bracket", 5000)  # more than there are landmarks
    for method in gppcs.METHODS:
        gppcs.evaluate(cloud, gppcs.simplify(cloud, ratio=0.1, method=method).cloud)
    gppcs.info(cloud)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Each test runs in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def scan():
    cloud = gppcs.sample("bracket", 400)
    gppcs.write("scan.ply", cloud)
    return cloud


@pytest.fixture
def gppcs_command(monkeypatch, capsys):
    """Run the command in this process; return its exit code, stdout and stderr, less the notice of a first run."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["gppcs", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return stop.value.code, out, err.replace(f"{console.NOTICE}\n", "")

    return run


def write_scan_with(points_of):
    cloud = gppcs.sample("bracket", 400)
    points = cloud.points.copy()
    points_of(points)
    gppcs.write("scan.ply", gppcs.PointCloud(points, cloud.attributes, cloud.coordinate_dtype), force=True)
    return points


def files():
    return sorted(path.name for path in Path().iterdir())


# what it writes


@pytest.mark.parametrize("method", gppcs.METHODS)
def test_simplify_writes_the_points_asked_for_with_all_they_carry(gppcs_command, scan, method):
    code, out, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--ratio", 0.1, "--method", method)
    assert (code, err) == (0, "")
    assert "400 in, 40 out" in out
    assert files() == ["out.ply", "scan.ply"]
    expected = scan.take(gppcs.simplify(scan, ratio=0.1, method=method).indices)
    written = gppcs.read("out.ply")
    assert written.points.tobytes() == expected.points.tobytes()
    assert written.coordinate_dtype == np.float32
    assert list(written.attributes) == list(expected.attributes)
    for name, values in expected.attributes.items():
        assert written.attributes[name].dtype == values.dtype
        assert written.attributes[name].tobytes() == values.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("method", gppcs.METHODS)
def test_the_dragon_is_thinned_to_its_own_vertices(gppcs_command, shared_data, method):
    source = shared_data / "dragon.ply"
    code, _, err = gppcs_command("simplify", source, "-o", "out.ply", "--ratio", 0.03, "--method", method)
    assert (code, err) == (0, "")
    original, kept = (_vertices(path) for path in (source, "out.ply"))
    assert len(original) == 437_645
    assert len(kept) == len(np.unique(kept)) == 13_129
    assert np.isin(kept, original).all()


def _vertices(path):
    """Return the bytes of each vertex of a binary PLY file of x, y, z and faces."""
    header, _, body = Path(path).read_bytes().partition(b"end_header\n")
    count = int(header.partition(b"element vertex ")[2].split()[0])
    return np.frombuffer(body[: 12 * count], "V12")


def test_parameters_seed_and_number_of_points_reach_the_method(gppcs_command, scan):
    options = ("--points", 30, "--method", "gp-spectral", "--set", "k_add=5", "--set", "nu=inf", "--seed", 3)
    assert gppcs_command("simplify", "scan.ply", "-o", "out.npy", *options)[0] == 0
    method = gppcs.SpectralGP(k_add=5, nu=math.inf, seed=3)
    expected = gppcs.simplify(scan, n_points=30, method=method).cloud.points
    assert gppcs.read("out.npy").points.tobytes() == expected.tobytes()


def test_scores_go_into_the_file(gppcs_command, scan):
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 40, "--scores")
    assert (code, err) == (0, "")
    kept = gppcs.read("out.ply")
    expected = gppcs.simplify(scan, n_points=40, scores=True).cloud
    assert list(kept.attributes) == [*scan.attributes, "score", "deviation"]
    for name in ("score", "deviation"):
        np.testing.assert_array_equal(kept.attributes[name], expected.attributes[name])


def test_scores_of_a_method_without_are_refused(gppcs_command, scan):
    code, out, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 40, "--scores", *FAST)
    assert code != 0
    assert out == ""
    assert "method 'fps' gives its points no scores" in err
    assert not Path("out.ply").exists()


def test_normals_of_the_whole_cloud_are_written(gppcs_command, scan):
    bare = gppcs.PointCloud(scan.points, {"red": scan.attributes["red"]}, scan.coordinate_dtype)
    gppcs.write("scan.ply", bare, force=True)
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 40, "--normals", *FAST)
    assert (code, err) == (0, "")
    written = gppcs.read("out.ply")
    assert list(written.attributes) == ["red", "nx", "ny", "nz"]
    assert written.attributes["nx"].dtype == np.float32
    np.testing.assert_allclose(written.normals(), gppcs.estimate_normals(scan, written), atol=1e-5)


def test_several_inputs_go_to_a_folder(gppcs_command, scan):
    gppcs.write("more.ply", gppcs.sample("fan", 200))
    Path("results").mkdir()
    code, out, err = gppcs_command("simplify", "scan.ply", "more.ply", "-o", "results", "--ratio", 0.1, "--json", *FAST)
    assert (code, err) == (0, "")
    assert [json.loads(line)["points_out"] for line in out.splitlines()] == [40, 20]
    assert [len(gppcs.read(f"results/{name}.ply")) for name in ("scan", "more")] == [40, 20]


def test_force_overwrites(gppcs_command, scan):
    Path("out.ply").write_text("old")
    code, _, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 7, "--force", *FAST)
    assert (code, err) == (0, "")
    assert len(gppcs.read("out.ply")) == 7


def test_invalid_points_are_dropped_when_asked_to(gppcs_command):
    def spoil(points):
        points[[3, 8], 0] = np.nan

    points = write_scan_with(spoil)
    arguments = ("simplify", "scan.ply", "-o", "out.ply", "--ratio", 1, "--invalid", "drop", "--figures", "--json")
    code, out, err = gppcs_command(*arguments)
    assert (code, err) == (0, "")
    assert gppcs.read("out.ply").points.tobytes() == np.delete(points, [3, 8], axis=0).tobytes()
    record = json.loads(out)
    assert (record["points_in"], record["points_out"], record["figures"]["chamfer"]) == (400, 398, 0)


def test_a_picture_is_drawn(gppcs_command, scan):
    pytest.importorskip("matplotlib")
    code, _, err = gppcs_command(
        "simplify", "scan.ply", "-o", "out.ply", "--points", 40, "--picture", "picture.png", *FAST
    )
    assert (code, err) == (0, "")
    assert Path("picture.png").read_bytes().startswith(b"\x89PNG\r\n")
    assert len(gppcs.read("out.ply")) == 40


@pytest.mark.parametrize("command", [("simplify", "-o", "out.ply", "--picture", "a.png"), ("compare", "-o", "side")])
def test_view_and_up_turn_the_picture(gppcs_command, scan, monkeypatch, command):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    drawn = []
    for home in ("pair.draw_pair", "comparison.draw_comparison"):
        monkeypatch.setattr(f"gppcs.drawing.{home}", lambda file, *given: drawn.append(given[-1]))
    monkeypatch.setattr("gppcs.app.commands.compare.MOST_TO_REBUILD", 0)
    name, *rest = command
    methods = ["--methods", "fps"] if name == "compare" else FAST
    arguments = (name, "scan.ply", *rest, "--points", 2, "--force", *methods)
    for options in ((), ("--view", "-30,20.5"), ("--up", "-z"), ("--view=5,0", "--up=y")):
        assert gppcs_command(*arguments, *options)[0] == 0
    assert drawn == [Viewpoint(), Viewpoint(None, (-30.0, 20.5)), Viewpoint("-z"), Viewpoint("y", (5.0, 0.0))]


@pytest.mark.parametrize("settings", ["voxel place=mean", "wlop snap=false"])
def test_points_that_a_method_moved_are_drawn_where_it_moved_them(gppcs_command, scan, monkeypatch, settings):
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr("gppcs.drawing.pair.draw_pair", lambda file, *given: drawn.extend(given))
    method, setting = settings.split()
    options = ("--points", 40, "--method", method, "--set", setting, "--picture", "picture.png")
    gppcs_command("simplify", "scan.ply", "-o", "out.npy", *options)
    moved = gppcs.read("out.npy").points
    assert np.linalg.norm(moved[:, None] - scan.points, axis=2).min(axis=1).max() > 0.1
    np.testing.assert_allclose(drawn[2].points, moved, atol=1e-4)  # the file has single precision


def test_samples_are_the_same_for_the_same_seed(gppcs_command):
    options = ("--points", 300, "--noise", 0.001, "--outliers", 0.1, "--uneven", 0.5)
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        assert gppcs_command("sample", "fan", "-o", f"{name}.ply", *options, "--seed", seed) == (0, "", "")
    assert Path("a.ply").read_bytes() == Path("b.ply").read_bytes() != Path("c.ply").read_bytes()
    expected = gppcs.sample("fan", 300, noise=0.001, outliers=0.1, uneven=0.5)
    assert gppcs.read("a.ply").points.tobytes() == expected.points.tobytes()


def test_sample_json_says_what_was_made(gppcs_command):
    code, out, err = gppcs_command("sample", "fan", "-o", "a.ply", "--points", 300, "--noise", 0.001, "--json")
    assert (code, err) == (0, "")
    options = {"noise": 0.001, "outliers": 0.0, "uneven": 0.0, "seed": 0}
    expected = {"output": "a.ply", "name": "fan", "points": 300, **options, "version": gppcs.__version__}
    assert json.loads(out) == expected


# what it prints


def test_simplify_json_is_one_strict_object_a_line(gppcs_command, scan):
    options = ("--points", 40, "--method", "gp-spectral", "--set", "nu=inf", "--figures", "--json")
    code, out, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", *options)
    assert (code, err, out.count("\n")) == (0, "", 1)
    record = json.loads(out, parse_constant=pytest.fail)
    assert (record["input"], record["output"]) == ("scan.ply", "out.ply")
    assert (record["points_in"], record["points_out"], record["method"]) == (400, 40, "gp-spectral")
    defaults = dataclasses.asdict(gppcs.SpectralGP())
    assert record["parameters"] == defaults | {"nu": None}  # JSON has no infinity
    assert {"reading", "eigenfunctions", "greedy selection", "writing", "figures"} <= set(record["seconds"])
    assert all(seconds >= 0 for seconds in record["seconds"].values())
    assert record["seconds_compiling"] >= 0
    assert record["peak_memory"] > 1e7  # an interpreter with NumPy takes more
    assert record["figures"] == gppcs.evaluate(gppcs.read("scan.ply"), gppcs.read("out.ply")).figures()
    assert record["version"] == gppcs.__version__


def test_simplify_prints_times_parameters_and_figures(gppcs_command, scan):
    _, out, _ = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 40, "--figures")
    title, *rows = out.splitlines()
    assert title == "scan.ply → out.ply"
    for name in (
        "points",
        "method",
        "noise_in_spacings",
        "reading, s",
        "greedy selection, s",
        "all, s",
        "covering radius",
    ):
        assert sum(row.startswith(f"{name} ") for row in rows) == 1
    assert "gp (feature_weight=0.5, lengthscale=1.5, neighbours=4," in out


def test_info_prints_the_facts(gppcs_command):
    def spoil(points):
        points[5] = points[4]
        points[9, 1] = np.inf

    write_scan_with(spoil)
    code, out, err = gppcs_command("info", "scan.ply")
    assert (code, err) == (0, "")
    rows = [" ".join(row.split()) for row in out.splitlines()]
    assert rows[:2] == ["scan.ply", "points 400"]
    for row in ("low corner -50 -30 0", "repeats 1", "not finite 1", "coordinates float32", "attribute red uint8"):
        assert row in rows
    assert any(row.startswith("spacing 3.") for row in rows)


def test_info_json_is_the_summary(gppcs_command, scan):
    code, out, err = gppcs_command("info", "scan.ply", "--json")
    summary = json.loads(json.dumps(dataclasses.asdict(gppcs.info(scan))))
    assert (code, json.loads(out), err) == (0, {"file": "scan.ply"} | summary, "")


@pytest.mark.parametrize("points", [np.empty((0, 3)), np.full((2, 3), np.nan)])
def test_info_of_clouds_without_finite_points(gppcs_command, points):
    gppcs.write("scan.ply", gppcs.PointCloud(points))
    code, out, err = gppcs_command("info", "scan.ply", "--json")
    record = json.loads(out, parse_constant=pytest.fail)
    assert (code, err) == (0, "")
    assert (record["points"], record["non_finite"], record["low"]) == (len(points), len(points), [None] * 3)
    code, out, err = gppcs_command("info", "scan.ply")
    assert (code, err) == (0, "")
    assert "spacing nan" in " ".join(out.split())


def test_methods_lists_parameters_with_their_defaults(gppcs_command):
    code, out, err = gppcs_command("methods")
    assert (code, err) == (0, "")
    for name, method in gppcs.METHODS.items():
        assert f"{name}: {method.summary}\n" in out
        assert method.source in out
        for parameter, value in dataclasses.asdict(method()).items():
            assert f"{parameter}={value}" in out
    _, out, _ = gppcs_command("methods", "--json")
    records = [json.loads(line) for line in out.splitlines()]
    assert {record["name"]: record["parameters"] for record in records} == {
        name: dataclasses.asdict(method()) for name, method in gppcs.METHODS.items()
    }


@pytest.mark.parametrize("name", gppcs.METHODS)
def test_methods_explains_one_and_each_of_its_parameters(gppcs_command, name):
    code, out, err = gppcs_command("methods", name)
    assert (code, err) == (0, "")
    text = " ".join(out.split())
    method = gppcs.METHODS[name]
    assert text.startswith(f"{name}: {method.summary}")
    assert method.source in text
    assert "----" not in text
    for key, parameter in method.parameters().items():
        assert f"{key} ({parameter.kind}, default {parameter.default}) {parameter.meaning}" in text
    assert ("no parameters" in text) == (not method.parameters())
    _, out, _ = gppcs_command("methods", name, "--json")
    assert json.loads(out)["meanings"] == {key: each.meaning for key, each in method.parameters().items()}


def test_help_shows_examples_and_each_method_with_its_source(gppcs_command):
    code, out, err = gppcs_command("simplify", "--help")
    assert (code, err) == (0, "")
    text = " ".join(out.split())
    assert "gppcs simplify scan.ply -o small.ply --ratio 0.03" in text
    assert "peak_memory, the most bytes that the process has held so far" in text
    for name, method in gppcs.METHODS.items():
        assert f"{name}: {method.summary} ({method.source})" in text


@pytest.mark.slow
def test_warmup_says_how_many_kernels_it_compiled_and_where_they_are(gppcs_command):
    code, out, err = gppcs_command("warmup")
    assert (code, err) == (0, "")
    told = re.fullmatch(r"kernels compiled: \d+, in \d+\.\d s; all are kept in (.*)\n", out)
    code, out, err = gppcs_command("warmup", "--json")
    record = json.loads(out)
    assert (code, err) == (0, "")
    assert record.pop("seconds") > 0
    assert record == {"compiled": 0, "folders": told[1].split(", "), "version": gppcs.__version__}  # not a second time
    assert all(list(Path(folder).glob("*.nbi")) for folder in record["folders"])


def test_the_help_of_warmup_says_where_kernels_are_kept(gppcs_command):
    code, out, err = gppcs_command("warmup", "--help")
    assert (code, err) == (0, "")
    assert "NUMBA_CACHE_DIR" in out


@pytest.mark.parametrize("arguments", [(), ("--help",)])
def test_the_bare_command_shows_its_help(gppcs_command, arguments):
    code, out, err = gppcs_command(*arguments)
    assert (code, err) == (0, "")
    assert all(name in out for name in ("simplify", "info", "sample", "methods", "warmup", "Examples"))


def test_version(gppcs_command):
    assert gppcs_command("--version") == (0, f"{gppcs.__version__}\n", "")


@pytest.mark.parametrize("name", ["[red]a:smile:.ply", f"{'long' * 40}.ply", "två\n.ply", os.fsdecode(b"\xff.ply")])
def test_any_file_name_is_printed_as_it_is(gppcs_command, name):
    gppcs.write(name, gppcs.sample("sphere", 30))
    code, out, err = gppcs_command("info", name)
    assert (code, err) == (0, "")
    assert out.startswith(name.encode(errors="backslashreplace").decode() + "\n")


def test_a_terminal_of_another_encoding_is_no_reason_to_fail(scan):
    run = subprocess.run(
        [COMMAND, "simplify", "scan.ply", "-o", "out.ply", "--points", "9", *FAST],
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        check=True,
    )
    assert run.stdout.startswith(rb"scan.ply \u2192 out.ply")


# how it fails


def assert_one_line(result, *parts):
    code, out, err = result
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("gppcs: ")
    assert err.endswith("\n")
    for part in parts:
        assert part in err


def truncate(path):
    path.write_bytes(path.read_bytes()[:-10])


def without_x(path):
    path.write_bytes(path.read_bytes().replace(b"float x", b"float u"))


def empty(path):
    gppcs.write(path, gppcs.PointCloud(np.empty((0, 3))), force=True)


def not_finite(path):
    def spoil(points):
        points[7, 1], points[9, 0] = np.nan, np.inf

    write_scan_with(spoil)


def as_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("damage", "parts"),
    [
        (Path.unlink, ["scan.ply: No such file"]),
        (as_folder, ["scan.ply: expected a file, found a folder"]),
        (truncate, ["scan.ply: the file ends in vertex 400 of 400"]),
        (without_x, ["scan.ply: expected x, y and z", "'u', 'y', 'z'"]),
        (empty, ["scan.ply: the cloud is empty"]),
        (not_finite, ["scan.ply: 2 of 400 points", "first at index 7", "--invalid drop"]),
        (lambda path: path.write_bytes(b""), ["scan.ply: expected"]),
        (lambda path: path.write_bytes(bytes(range(256))), ["scan.ply: expected 'ply'"]),
    ],
)
def test_input_that_cannot_be_used(gppcs_command, scan, damage, parts):
    damage(Path("scan.ply"))
    before = files()
    assert_one_line(gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--ratio", 0.1), *parts)
    assert files() == before


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--ratio", 0], ["a ratio above 0 and at most 1, found 0"]),
        (["--ratio", -1], ["found -1"]),
        (["--ratio", 1.5], ["found 1.5"]),
        (["--ratio", "nan"], ["found nan"]),
        (["--ratio", "abc"], ["'--ratio'", "number"]),
        (["--points", 0], ["whole number from 1 on, found 0"]),
        (["--points", -3], ["found -3"]),
        (["--points", "abc"], ["'--points'", "integer"]),
        (["--points", 2.5], ["'--points'", "integer"]),
        ([], ["either a ratio or a number of points, found neither"]),
        (["--points", 5, "--ratio", 0.5], ["found both"]),
        (["--points", 5, "--method", "gp-spektral"], ["did you mean 'gp-spectral'?"]),
        (["--points", 5, "--set", "neighbors=9"], ["did you mean 'neighbours'?"]),
        (["--points", 5, "--set", "neighbours=0"], ["neighbours to be from 1 to 64, found 0"]),
        (["--points", 5, "--set", "neighbours=few"], ["neighbours to be int, found 'few'"]),
        (["--points", 5, "--set", "neighbours"], ["--set KEY=VALUE, found 'neighbours'"]),
        (["--points", 5, "--method", "random", "--seed", -1], ["seed to be at least 0, found -1"]),
        (["--points", 5, "--invalid", "ignore"], ["'ignore' is not one of 'error', 'drop'"]),
        (["--points", 5, "--picture", "picture.jpg"], ["picture.jpg: expected a name that ends in .png"]),
        (["--points", 5, "--picture", "none/picture.png"], ["none/picture.png: expected a folder"]),
        (["--points", 5, "--picture", "p.png", "--view", "30"], ["--view AZIMUTH,ELEVATION", "found '30'"]),
        (["--points", 5, "--picture", "p.png", "--view", "30,99"], ["-90 to 90", "found 30 and 99"]),
        (["--points", 5, "--picture", "p.png", "--up", "w"], ["'--up'", "'w' is not one of"]),
        (["--points", 5, "--view", "30,20"], ["expected a picture to turn with --view and --up"]),
        (["--points", 5, "--rato", 1], ["No such option: --rato", "--ratio"]),
        (["--points", 5, "-o", "none/out.ply"], ["none/out.ply: expected a folder"]),
        (["--points", 5, "-o", "scan.ply"], ["scan.ply: expected a new file, found one"]),
        (["--points", 5, "-o", "out.foo"], ["out.foo: expected one of the formats .ply", "found '.foo'"]),
        (["--points", 5, "missing.ply"], ["out.ply: expected a folder for the results of 2 inputs"]),
        (["--points", 5, "sub/scan.ply", "-o", "."], ["inputs with different names"]),
    ],
)
def test_options_that_cannot_be_used(gppcs_command, scan, arguments, parts):
    before = Path("scan.ply").read_bytes()
    assert_one_line(gppcs_command("simplify", "scan.ply", "-o", "out.ply", *arguments), *parts)
    assert files() == ["scan.ply"]
    assert Path("scan.ply").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["simplfy"], "Did you mean 'simplify'"),
        (["simplify"], "Missing argument"),
        (["simplify", "scan.ply"], "Missing option '--output'"),
        (["info", "missing.ply"], "missing.ply: No such file"),
        (["sample", "brackt", "-o", "a.ply"], "did you mean 'bracket'?"),
        (["sample", "bracket", "-o", "a.ply", "--points", 0], "whole number from 1 on, found 0"),
        (["sample", "bracket", "-o", "a.ply", "--points", 10**15], "Unable to allocate"),
        (["sample", "bracket", "-o", "a.ply", "--noise", "nan"], "found nan"),
        (["sample", "bracket", "-o", "none/a.ply"], "expected a folder"),
        (["methods", "fps", "hc"], "unexpected extra argument"),
        (["methods", "fpss"], "did you mean 'fps'?"),
    ],
)
def test_commands_that_cannot_be_run(gppcs_command, arguments, part):
    assert_one_line(gppcs_command(*arguments), part)
    assert files() == []


def test_one_bad_file_does_not_cost_the_others(gppcs_command, scan):
    gppcs.write("broken.ply", scan)
    truncate(Path("broken.ply"))
    empty("empty.ply")
    gppcs.write("done.ply", scan)
    Path("results").mkdir()
    Path("results/done.ply").write_text("old")
    inputs = ["broken.ply", "missing.ply", "empty.ply", "done.ply", "scan.ply"]
    code, out, err = gppcs_command("simplify", *inputs, "-o", "results", "--points", 9, "--json", *FAST)
    assert code == 2
    assert [json.loads(line)["input"] for line in out.splitlines()] == ["scan.ply"]
    named = ["broken.ply", "missing.ply", "empty.ply", "results/done.ply"]
    assert [line.split(": ")[1] for line in err.splitlines()] == named
    assert len(gppcs.read("results/scan.ply")) == 9
    assert sorted(path.name for path in Path("results").iterdir()) == ["done.ply", "scan.ply"]
    assert Path("results/done.ply").read_text() == "old"


def test_a_bad_parameter_is_told_once_for_all_files(gppcs_command, scan):
    gppcs.write("more.ply", scan)
    Path("results").mkdir()
    result = gppcs_command("simplify", "scan.ply", "more.ply", "-o", "results", "--ratio", 2)
    assert_one_line(result, "a ratio above 0 and at most 1, found 2")
    assert not any(Path("results").iterdir())


def test_a_picture_shows_one_input(gppcs_command, scan):
    result = gppcs_command("simplify", "scan.ply", "b.ply", "-o", ".", "--points", 9, "--picture", "p.png")
    assert_one_line(result, "expected one input with --picture, found 2")


def test_a_missing_extra_is_told_before_any_work(gppcs_command, scan, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 9, "--picture", "p.png")
    assert_one_line(result, "pip install 'gppcs[picture]'")
    assert files() == ["scan.ply"]


def test_faults_of_the_program_itself_are_not_hidden(monkeypatch):
    def broken(*arguments, **options):
        raise ZeroDivisionError

    monkeypatch.setattr(cli, "app", broken)
    with pytest.raises(ZeroDivisionError):
        cli.main()


def test_an_interrupted_command_leaves_nothing(gppcs_command, scan, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("gppcs.io.ply._type_of_coordinates", interrupted)  # while the result is written
    code, out, err = gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 9)
    assert (code, out, err.strip()) == (130, "", "")
    assert files() == ["scan.ply"]


# as a program


@pytest.mark.slow
def test_exit_codes_and_streams_of_the_installed_command(scan):
    def run(*arguments):
        done = subprocess.run([COMMAND, *arguments], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout, done.stderr

    code, out, err = run("simplify", "scan.ply", "-o", "out.ply", "--points", "9", *FAST)
    assert (code, err) == (0, "")
    assert "400 in, 9 out" in out
    assert_one_line(run("simplify", "scan.ply", "-o", "out.ply", "--points", "9"), "out.ply: expected a new file")


def test_help_comes_at_once():
    def seconds():
        start = time.perf_counter()
        subprocess.run([COMMAND, "--help"], capture_output=True, check=True)
        return time.perf_counter() - start

    assert min(seconds() for _ in range(5)) < 0.6  # 0.3 s where nothing else runs


def in_terminal(code, term="xterm"):
    """Return what Python code prints to stderr where that is a terminal, and its exit code."""
    master, slave = pty.openpty()
    environment = os.environ | {"TERM": term}
    with subprocess.Popen([sys.executable, "-c", code], stderr=slave, env=environment) as run:
        os.close(slave)
        shown = b""
        try:
            while part := os.read(master, 4096):
                shown += part
        except OSError:  # how Linux says that the other end is closed
            pass
        os.close(master)
    return shown.decode(), run.returncode


STAGE = """
import time
from gppcs.app import console
from gppcs.engine.stages import Stages
console.PATIENCE = 0.2
with Stages(console.ProgressBar())("slow stage", 4) as advanced:
    for _ in range(4):
        time.sleep({seconds})
        advanced(1)
    {end}
"""
SHOW_CURSOR, ERASE_LINE = "\x1b[?25h", "\x1b[2K"


def test_a_bar_shows_for_a_slow_stage_and_goes_away():
    shown, code = in_terminal(STAGE.format(seconds=0.2, end="pass"))
    assert code == 0
    assert "slow stage" in shown
    assert shown.rindex(ERASE_LINE) > shown.rindex("slow stage")
    assert SHOW_CURSOR in shown


def test_a_bar_goes_away_when_the_stage_fails():
    shown, code = in_terminal(STAGE.format(seconds=0.2, end="raise SystemExit(7)"))
    assert code == 7
    assert shown.rindex(ERASE_LINE) > shown.rindex("slow stage")
    assert SHOW_CURSOR in shown


@pytest.mark.parametrize(("seconds", "term"), [(0, "xterm"), (0.2, "dumb")])
def test_no_bar_for_quick_stages_and_plain_terminals(seconds, term):
    assert in_terminal(STAGE.format(seconds=seconds, end="pass"), term) == ("", 0)


def test_no_bar_where_stderr_is_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr(console, "PATIENCE", 0)
    bar = console.ProgressBar()
    bar.started("stage", 10)
    time.sleep(0.05)
    bar.advanced(5)
    bar.finished()
    assert capsys.readouterr() == ("", "")


def test_compiling_is_told_once_and_timed(capsys):
    compilation = console.Compilation()
    for _ in range(2):  # one kernel needs another
        compilation.on_start(None)
        compilation.on_start(None)
        time.sleep(0.01)
        compilation.on_end(None)
        compilation.on_end(None)
    assert capsys.readouterr().err == "gppcs: compiling its kernels, once on this machine\n"
    assert 0.02 <= compilation.seconds < 1


@pytest.mark.parametrize("output", ["scan.ply", "link.ply", "."])
def test_an_input_is_never_overwritten(gppcs_command, scan, output):
    Path("link.ply").symlink_to("scan.ply")
    before = Path("scan.ply").read_bytes()
    result = gppcs_command("simplify", "scan.ply", "-o", output, "--points", 5, "--force")
    assert_one_line(result, "expected a file other than the input")
    assert Path("scan.ply").read_bytes() == before


# evaluate


def test_evaluate_prints_each_figure_with_its_unit(gppcs_command, scan):
    gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 40, *FAST)
    code, out, err = gppcs_command("evaluate", "scan.ply", "out.ply")
    assert (code, err) == (0, "")
    assert "scan.ply → out.ply" in out
    assert "400 in, 40 out" in out
    for name in set(gppcs.figures_of(gppcs.Report)) - {"points_in", "points_out"}:
        assert name.replace("_", " ") in out
    assert "of the diagonal)" in out
    assert "of the squared diagonal)" in out
    assert " degrees" in out
    assert "in the unit of the coordinates" in out
    recall = gppcs.evaluate(scan, gppcs.read("out.ply")).feature_recall
    assert f"feature recall {100 * recall:.4g} %" in " ".join(out.split())


def test_evaluate_json_holds_raw_and_relative_figures(gppcs_command, scan):
    gppcs_command("simplify", "scan.ply", "-o", "out.ply", "--points", 40, *FAST)
    code, out, _ = gppcs_command("evaluate", "scan.ply", "out.ply", "--json")
    report = gppcs.evaluate(gppcs.read("scan.ply"), gppcs.read("out.ply"))
    assert code == 0
    assert json.loads(out) == {
        "original": "scan.ply", "simplified": "out.ply", "mesh": None,
        "figures": report.figures(), "relative": report.figures(relative=True),
    }  # fmt: skip


def test_evaluate_leaves_out_points_that_are_not_finite(gppcs_command):
    def spoil(points):
        points[3, 1] = np.nan

    write_scan_with(spoil)
    code, out, _ = gppcs_command("evaluate", "scan.ply", "scan.ply")
    assert (code, "399 in, 399 out" in out) == (0, True)


def test_evaluate_with_a_mesh(gppcs_command):
    pytest.importorskip("pymeshlab")
    ball = gppcs.sample("sphere", 3000)
    gppcs.write("scan.ply", ball)
    faces = "\n".join(f"3 {a} {b} {c}" for a, b, c in hull_mesh(ball.points).faces)
    rows = "\n".join(f"{x} {y} {z}" for x, y, z in ball.points)
    Path("mesh.off").write_text(f"OFF\n3000 {faces.count(chr(10)) + 1} 0\n{rows}\n{faces}\n")
    code, out, err = gppcs_command("evaluate", "scan.ply", "scan.ply", "--mesh", "mesh.off")
    assert (code, err) == (0, "")
    assert "hausdorff mean" in out
    assert "carried hausdorff max" in out


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["scan.ply", "missing.ply"], ["missing.ply", "No such file"]),
        (["scan.ply", "far.ply"], ["does not lie on the original", "same unit"]),
        (["scan.ply", "scan.ply", "--mesh", "scan.ply"], ["scan.ply", "400 points and no triangle"]),
        (["scan.ply", "empty.ply"], ["simplified cloud is empty"]),
    ],
)
def test_what_evaluate_refuses(gppcs_command, scan, arguments, parts):
    if "--mesh" in arguments:
        pytest.importorskip("pymeshlab")
    gppcs.write("far.ply", gppcs.PointCloud(scan.points[:9] + 1e5))
    gppcs.write("empty.ply", gppcs.PointCloud(np.empty((0, 3))))
    code, out, err = gppcs_command("evaluate", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert all(part in err for part in parts)


def test_the_help_of_evaluate_defines_every_figure(gppcs_command):
    out = " ".join(gppcs_command("evaluate", "--help")[1].split())
    for report in (gppcs.Report, gppcs.Rebuilt):
        for name in gppcs.figures_of(report):
            assert f"{name.replace('_', ' ')} (" in out


# compare


def test_compare_writes_tables_and_prints_one(gppcs_command, scan):
    code, out, err = gppcs_command(
        "compare", "scan.ply", "--ratio", 0.1, "--methods", "fps, random", "-o", "side", "--no-picture"
    )
    assert (code, err) == (0, "")
    assert sorted(path.name for path in Path("side").iterdir()) == ["table.csv", "table.md"]
    titles, *rows = Path("side/table.csv").read_text().splitlines()
    assert titles.startswith("method,parameters,seconds,points_in,points_out,")
    assert titles.endswith(",failure")
    assert rows[1].startswith("random,seed=0,")
    assert [row.split(",")[0] for row in rows] == ["fps", "random"]
    assert "| fps | 40 |" in Path("side/table.md").read_text()
    first = [line.split()[:2] for line in out.splitlines() if line]
    assert ["fps", "40"] in first
    assert ["random", "40"] in first
    assert out.endswith("side: table.csv, table.md\n")


def test_compare_json_is_one_object_a_method(gppcs_command, scan):
    code, out, _ = gppcs_command(
        "compare",
        "scan.ply",
        "--points",
        40,
        "--methods",
        "fps,random",
        "--seed",
        3,
        "-o",
        "side",
        "--no-picture",
        "--json",
    )
    records = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert [(record["method"], record["parameters"]) for record in records] == [("fps", {}), ("random", {"seed": 3})]
    assert records[0]["figures"] == gppcs.compare(gppcs.read("scan.ply"), ["fps"], n_points=40)[0].report.figures()


def test_compare_drops_invalid_points_when_asked_to(gppcs_command, scan):
    scan.points[9] = np.nan
    gppcs.write("broken.ply", scan)
    options = ("--points", 40, "--methods", "fps", "-o", "side", "--no-picture", "--invalid", "drop", "--json")
    code, out, err = gppcs_command("compare", "broken.ply", *options)
    assert (code, err) == (0, "")
    assert json.loads(out)["figures"]["points_in"] == 399


@pytest.mark.slow
def test_compare_draws_clouds_and_meshes(gppcs_command, monkeypatch):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    columns = []
    monkeypatch.setattr("gppcs.drawing.side_by_side.draw_comparison", lambda file, given, _: columns.extend(given))
    ball = gppcs.sample("sphere", 2000)
    ball.points[7] = np.nan
    gppcs.write("ball.ply", ball)
    options = ("--points", 200, "--methods", "fps,random", "-o", "side", "--invalid", "drop")
    assert gppcs_command("compare", "ball.ply", *options)[::2] == (0, "")
    assert [column.title for column in columns] == ["original", "fps", "random"]
    assert [len(column.points) for column in columns] == [1999, 200, 200]
    assert all(column.mesh for column in columns)


@pytest.mark.slow
def test_compare_rebuilds_no_mesh_of_an_original_too_large_for_it(gppcs_command, monkeypatch):
    for module in ("pymeshlab", "pyvista", "matplotlib"):
        pytest.importorskip(module)
    monkeypatch.setattr("gppcs.app.commands.compare.MOST_TO_REBUILD", 1000)
    gppcs.write("ball.ply", gppcs.sample("sphere", 1999))
    code, _, err = gppcs_command("compare", "ball.ply", "--points", 200, "--methods", "random", "-o", "side")
    assert code == 0
    assert "no mesh of the original: it has 1,999 points" in err
    assert err.count("\n") == 1
    assert Path("side/picture.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["scan.ply", "--ratio", "0.1", "-o", "side", "--methods", "fps,fsp"], "no method 'fsp'"),
        (["scan.ply", "-o", "side", "--methods", "fps"], "found neither"),
        (["missing.ply", "--ratio", "5", "-o", "side", "--methods", "fps"], "at most 1, found 5"),
        (["scan.ply", "--ratio", "0.1", "-o", "side", "--methods", ""], "no method ''"),
        (["broken.ply", "--ratio", "0.1", "-o", "side", "--methods", "fps"], "1 of 400 points"),
        (["in/table.csv", "--ratio", "0.1", "-o", "in", "--force"], "expected a file other than the input"),
        (["missing.ply", "--ratio", "0.1", "-o", "side"], "missing.ply"),
        (["scan.ply", "--ratio", "0.1", "-o", "scan.ply"], "expected a folder, found a file"),
        (["scan.ply", "--ratio", "0.1", "-o", "no/side"], "make it first"),
        (["scan.ply", "--ratio", "0.1", "-o", "old"], "--force"),
    ],
)
def test_what_compare_refuses_leaves_nothing(gppcs_command, scan, arguments, part):
    Path("old").mkdir()
    Path("old/table.md").write_text("mine")
    Path("in").mkdir()
    gppcs.write("in/table.csv", scan)
    scan.points[9] = np.nan
    gppcs.write("broken.ply", scan)
    code, out, err = gppcs_command("compare", *arguments, "--no-picture")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert part in err
    assert files() == ["broken.ply", "in", "old", "scan.ply"]
    assert len(gppcs.read("in/table.csv")) == 400
    assert Path("old/table.md").read_text() == "mine"


@pytest.mark.parametrize("module", ["pymeshlab", "pyvista"])
def test_compare_names_the_missing_extra_before_any_work(gppcs_command, scan, monkeypatch, module):
    pytest.importorskip("pymeshlab")
    monkeypatch.setitem(sys.modules, module, None)
    extra = {"pymeshlab": "evaluate", "pyvista": "view"}[module]
    code, _, err = gppcs_command("compare", "scan.ply", "--ratio", 0.1, "-o", "side")
    assert code == 2
    assert f"pip install 'gppcs[{extra}]'" in err
    assert files() == ["scan.ply"]
