"""The page in a browser, and the built page as compared with its sources."""

import base64
import io
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

import gppcs
from copc_file import write_copc
from gppcs.clouds.cloud import PointCloud
from gppcs.drawing.web.contents import Named, report_page, view_page
from gppcs.drawing.web.levels import Levels
from gppcs.drawing.web.serving import LevelsServer
from gppcs.io.copc import CopcNodes
from las_file import las_of
from scans import sample

ROOT = Path(__file__).parents[3]
VIEWER = ROOT / "viewer"
BUILT = ROOT / "src" / "gppcs" / "drawing" / "web" / "page.html"
BROWSERS = "chromium", "chromium-browser", "google-chrome"
MARKUP = "<img src=x onerror=alert(1)>"

SCORES = {"score": np.linspace(2, 1, 1000), "deviation": np.linspace(0.9, 0.2, 1000)}  # as gp writes them


def lacks(need, reason):
    """Skip a test that cannot run here, or fail it where GPPCS_CI_NEEDS says that it must run."""
    needed = need in os.environ.get("GPPCS_CI_NEEDS", "").split(",")
    (pytest.fail if needed else pytest.skip)(reason)


@pytest.fixture(scope="module")
def node():
    found = shutil.which("node")
    if not found:
        lacks("node", "no Node.js")
    if not (VIEWER / "node_modules").is_dir():
        lacks("node", "the packages of the viewer are not installed: run npm ci in viewer")
    return found


@pytest.fixture(scope="module")
def scan():
    cloud = gppcs.sample("medallion", n_points=20_000)
    return PointCloud(cloud.points, {**cloud.attributes, MARKUP: (np.arange(20_000) % 2).astype(np.uint8)})


@pytest.fixture(scope="module")
def kept(scan):
    return gppcs.simplify(scan, n_points=1000, method="fps")


@pytest.fixture(scope="module")
def browser():
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    return found or lacks("chromium", f"no browser: none of {', '.join(BROWSERS)}")


@pytest.fixture(scope="module")
def seen(node, browser, scan, kept, tmp_path_factory):
    """What a person sees and does on the page."""
    voxels = gppcs.simplify(scan, n_points=1000, method="voxel").cloud
    scored = PointCloud(kept.cloud.points, {**kept.cloud.attributes, **SCORES})
    page = report_page(
        Named(f"{MARKUP}.ply", scan, gppcs.mesh(scan, n_points=2000).mesh),
        [
            Named("fps.ply", scored, gppcs.mesh(scan, n_points=500).mesh, "farthest points"),
            Named("voxel.ply", voxels, reason="a point for each cell"),
        ],
        [("command", f"gppcs report {MARKUP}")],
    )
    avenue = sample("avenue", n_points=30_000)
    scene = PointCloud(avenue.points, {**avenue.attributes, "height": avenue.points[:, 2]})
    folder = tmp_path_factory.mktemp("page")
    paths = folder / "report.html", folder / "view.html"
    for path, each in zip(paths, (page, view_page([Named("avenue.ply", scene)], [])), strict=True):
        with open(path, "wb") as file:
            file.write(each.content())
    run = subprocess.run([node, VIEWER / "drive.mjs", browser, *paths], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def digests(pictures):
    return [picture["digest"] for picture in pictures]


def all_differ(before, after):
    return all(one != other for one, other in zip(digests(before), digests(after), strict=True))


def test_the_built_page_is_that_of_its_sources(node, tmp_path):
    built = tmp_path / "page.html"
    subprocess.run([node, VIEWER / "build.mjs", built], check=True)
    assert built.read_bytes() == BUILT.read_bytes(), "run make viewer, and commit what it writes"


def test_the_types_of_the_viewer_are_right(node):
    run = subprocess.run(
        [node, VIEWER / "node_modules" / "typescript" / "bin" / "tsc", "--noEmit", "--project", VIEWER],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout


@pytest.mark.slow
class TestInTheBrowser:
    def test_it_opens_without_errors_and_without_network(self, seen):
        assert seen["messages"] == []
        assert seen["requests"] == []

    def test_each_view_draws_its_points(self, seen):
        assert [label.splitlines()[0] for label in seen["labels"]] == [f"{MARKUP}.ply", "fps.ply", "voxel.ply"]
        for pictures in (seen["start"], seen["narrow"]["pictures"]):
            assert len(pictures) == 3
            assert all(0.1 < picture["share"] < 0.9 for picture in pictures)

    def test_markup_in_names_is_shown_as_text(self, seen):
        assert seen["heading"] == f"{MARKUP}.ply"
        assert seen["title"].startswith(MARKUP)
        assert MARKUP in seen["colourings"]
        assert f"gppcs report {MARKUP}" in seen["made"]

    def test_the_views_turn_together_and_come_back(self, seen):
        for moved in (seen["dragged"], seen["turned"], seen["up"]["pictures"]):
            assert all_differ(seen["start"], moved)
        assert digests(seen["reset"]) == digests(seen["start"])
        assert "\N{MINUS SIGN}" in seen["up"]["text"]

    def test_coloured_scans_open_in_their_colours(self, seen):
        assert next(iter(seen["colourings"])) == "RGB"
        assert digests(seen["start"]) == digests(seen["colourings"]["RGB"]["pictures"])
        assert seen["scene"]["colouring"] == "rgb"

    def test_the_first_view_fits_the_frame(self, seen):
        for picture in (*seen["start"], *seen["narrow"]["pictures"], *seen["scene"]["start"]):
            left, top, right, bottom = picture["box"]
            assert 0.0 < min(left, top) < max(right, bottom) < 1.0
            assert max(right - left, bottom - top) > 0.85

    def test_the_surface_has_no_pinholes(self, seen):
        closed = [seen["start"][0], *seen["opened"]["pictures"][:2]]  # the others are discs with gaps between them
        assert max(picture["holes"] for picture in closed) < 2e-4

    def test_each_colouring_changes_the_views_and_its_legend(self, seen):
        colourings = seen["colourings"]
        names = ["RGB", "surface variation", "order of choice", "curvature"]
        assert set(names) < set(colourings)
        for name in names[1:]:
            assert all_differ(seen["start"][1:], colourings[name]["pictures"][1:]), name
            assert colourings[name]["legend"] != colourings[names[0]]["legend"]

    def test_distances_are_shown_on_the_original_which_they_are_said_of(self, seen):
        shown = seen["colourings"]["distance of the original to the result"]
        assert "in the unit of the coordinates" in shown["legend"]
        assert [label.splitlines()[:3] for label in shown["labels"]] == [
            [f"{MARKUP}.ply", "20,000 points", f"coloured by the distance to {name}"]
            for name in ("fps.ply", "voxel.ply")
        ]
        one, other = digests(shown["pictures"])
        assert one != other

    def test_the_slider_shows_the_first_points_with_their_figures(self, seen):
        assert all("points\nmean error" in label for label in seen["labels"][1:])
        assert seen["fewest"]["text"] == "100 (10 %)"
        assert [label.splitlines()[1] for label in seen["fewest"]["labels"]] == ["20,000 points", *2 * ["100 points"]]
        name, count, figure = seen["fewer"]["labels"][1].splitlines()
        assert (name, count) == ("fps.ply", "317 points")  # half of the way from a tenth to all, as a ratio
        assert figure.startswith("first 250: mean error")
        assert digests(seen["fewer"]["pictures"])[0] == digests(seen["start"])[0]
        assert all_differ(seen["start"][1:], seen["fewer"]["pictures"][1:])

    def test_a_picked_point_is_the_point_of_the_file(self, seen, scan, kept):
        original, first, other = seen["picked"]
        for found, cloud in ((original, scan), (first, kept.cloud)):
            row = int(found["values"]["row"].replace(",", ""))
            place = [float(found["values"][axis]) for axis in "xyz"]
            np.testing.assert_allclose(place, cloud.points[row], atol=np.ptp(cloud.points) / 65535)
            assert found["values"][MARKUP] == str(cloud.attributes[MARKUP][row])
            assert found["rings"] == 3
        row = int(first["values"]["row"].replace(",", ""))
        assert first["values"]["row in the original"].replace(",", "") == str(kept.indices[row])
        assert first["values"]["chosen"] == f"number {row + 1:,} of 1,000"
        told = re.fullmatch(r"the surface .* here \(deviation (0\.\d+) of the prior one\)", first["values"]["why"])
        assert float(told[1]) == pytest.approx(SCORES["deviation"][row], abs=0.001)
        assert other["values"]["why"] == "a point for each cell"
        assert "why" not in original["values"]
        assert seen["hidden"]

    def test_the_swipe_compares_two_clouds(self, seen):
        assert [label.splitlines()[0] for label in seen["swipe"]["labels"]] == [f"{MARKUP}.ply", "voxel.ply"]
        assert all_differ(seen["swipe"]["middle"], seen["swipe"]["left"])
        assert int(seen["swipe"]["dragged"]["divider"]) == pytest.approx(700, abs=5)
        assert all_differ(seen["swipe"]["left"], seen["swipe"]["dragged"]["pictures"])

    def test_a_disc_is_round_from_above_and_thin_from_the_front_and_the_side(self, seen):
        directions = seen["directions"]
        assert directions["top"][0]["shape"] == pytest.approx(1.0, abs=0.03)
        assert min(directions["front"][0]["shape"], directions["side"][0]["shape"]) > 5.0
        assert all_differ(directions["front"], directions["side"])
        assert digests(directions["reset"]) == digests(seen["start"])
        for name in ("reset", "top", "front", "side"):
            assert digests(directions[f"{name} by key"]) == digests(directions[name])

    def test_the_ends_of_the_colours_can_be_set(self, seen):
        ranges = seen["ranges"]
        assert (ranges["from 1"]["from"], ranges["to 2"]["to"]) == ("1", "2")
        assert "or less" in ranges["from 1"]["legend"]
        assert "or more" in ranges["to 2"]["legend"]
        assert "1.5" in ranges["to 2"]["legend"]  # in the middle
        assert len({digests(ranges[name]["pictures"])[0] for name in ("start", "from 1", "to 2")}) == 3
        assert ranges["from 3"]["refused"] == "expected a number below 2"
        assert digests(ranges["from 3"]["pictures"]) == digests(ranges["to 2"]["pictures"])
        assert ranges["fitted"] == ranges["start"]

    def test_classes_can_be_hidden_in_any_colours(self, seen):
        classes = seen["classes"]
        assert "2 ground" in classes["all"]["legend"]
        shares = {name: shown["pictures"][0]["share"] for name, shown in classes.items()}
        assert 0.0 < shares["some"] < 0.8 * shares["all"]
        assert shares["rgb"] == pytest.approx(shares["some"], rel=0.05)
        assert "Hidden: classification 6 building." in classes["rgb"]["legend"]
        assert shares["none"] == 0.0
        assert classes["again"] == classes["all"]

    def test_the_distance_is_that_of_the_points_that_were_clicked(self, seen):
        distance = seen["distance"]
        assert "two points" in distance["asked"]
        steps = np.subtract(*distance["places"][::-1])
        told = re.fullmatch(r"Distance (\S+)\s+along x (\S+), y (\S+), z (\S+)", distance["text"])
        numbers = [float(number.replace(",", "")) for number in told.groups()]
        assert numbers == pytest.approx([np.linalg.norm(steps), *steps], abs=1e-3)
        np.testing.assert_allclose(distance["line"], distance["clicks"], atol=14)
        assert distance["left"]

    def test_the_clip_box_hides_what_lies_outside(self, seen):
        clip = seen["clip"]
        assert clip["edges"] > 0
        middle, highest = (float(end) for end in clip["text"].split(" to "))
        assert clip["half"][0]["share"] < 0.8 * clip["whole"][0]["share"]
        assert clip["half"][0]["box"][0] > 0.3 > clip["whole"][0]["box"][0]
        assert clip["left"] is None
        assert middle < clip["right"][0] < highest
        assert digests(clip["off"]) == digests(clip["whole"])

    def test_a_picture_is_saved_with_its_legend(self, seen):
        saved = seen["saved"]
        assert saved["name"] == "avenue.ply.png"
        image = pytest.importorskip("matplotlib.image").imread(io.BytesIO(base64.b64decode(saved["png"])), format="png")
        width, height = map(round, saved["canvas"])
        assert image.shape[1] == width
        drawn = np.ptp(image[..., :3], axis=2) > 0.1
        assert drawn[:height].mean() > 0.5 * seen["clip"]["half"][0]["share"]
        legend = image[height:, :, :3]
        assert (legend.min(axis=2) < 0.6).sum() > 100  # letters

    def test_the_views_fill_the_full_screen(self, seen):
        full = seen["full"]
        assert full["within"]["height"] > full["before"] + 40
        assert full["within"]["overflow"] <= 0
        assert full["after"] == full["before"]

    def test_meshes_take_the_place_of_points_where_there_are_some(self, seen):
        *meshes, voxels = seen["meshes"]["labels"]
        assert all(re.fullmatch(r".*\n[\d,]+ points, [\d,]+ triangles(\nmean error .*)?", label) for label in meshes)
        assert voxels == seen["labels"][2]
        assert all_differ(seen["start"][:2], seen["meshes"]["pictures"][:2])
        for points, drawn in zip(seen["start"], seen["meshes"]["pictures"], strict=True):
            assert drawn["box"] == pytest.approx(points["box"], abs=0.06)
        assert digests(seen["meshes"]["pictures"])[2] == digests(seen["start"])[2]
        assert digests(seen["points"]) == digests(seen["start"])
        assert all_differ(seen["meshes"]["pictures"], seen["meshes"]["coloured"])  # as the points are

    def test_a_page_opens_with_its_meshes(self, seen):
        for shown in (seen["opened"], seen["meshes"], seen["meshes"]["again"]):
            assert shown["pressed"] == "true"
            assert digests(shown["pictures"])[:2] == digests(seen["opened"]["pictures"])[:2]

    def test_a_mesh_of_all_points_does_not_stand_for_the_first_ones(self, seen):
        fewer = seen["meshes"]["fewer"]
        assert fewer["labels"][1:] == seen["fewer"]["labels"][1:]
        assert digests(fewer["pictures"])[1:] == digests(seen["fewer"]["pictures"])[1:]
        assert "triangles" in fewer["labels"][0]

    def test_figures_and_plot_are_there_below_a_verdict(self, seen, scan, kept):
        relative = gppcs.evaluate(scan, kept.cloud).figures(relative=True)
        for name in ("surface_max", "surface_p95"):
            assert f"{float(f'{100 * relative[name]:.3g}')} % of the diagonal" in seen["verdicts"][0]
        first, everything = seen["figures"]["first"], seen["figures"]["all"]
        assert "covering radius\n" in first["text"]
        assert first["rows"] == 8 < everything["rows"]
        assert "chamfer" in everything["text"]
        assert seen["plotted"] == 8

    def test_the_controls_take_one_row_and_the_keys_stand_behind_a_mark(self, seen):
        assert seen["toolRows"] == 1
        assert seen["keys"]["width"] > 300
        assert not seen["keys"]["left"]

    def test_it_can_be_read_by_everybody(self, seen):
        assert seen["accessible"] == seen["narrow"]["accessible"] == seen["scene"]["accessible"] == []
        assert seen["narrow"]["width"] == 400
        light, dark = seen["backgrounds"]
        assert light != dark


@pytest.fixture(scope="module")
def copc(tmp_path_factory):
    """A COPC file of 300,000 points on four levels, of which the page holds three; it says that they are dense."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 100, (2, 300_000))
    las = las_of(np.column_stack([x, y, 5 * np.sin(x / 9) * np.cos(y / 7)]), intensity=rng.integers(0, 1000, 300_000))
    path = tmp_path_factory.mktemp("copc") / "scan.copc.laz"
    write_copc(path, las, depth=4, spacing=0.2)
    return path


@pytest.fixture(scope="module")
def looked(node, browser, copc):
    """What a person sees of a cloud by level."""
    with open(copc, "rb") as file, LevelsServer(Levels(CopcNodes(file), "scan.copc.laz", [])) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        command = [node, VIEWER / "drive_levels.mjs", server.url, browser]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        server.shutdown()
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def drawn(step):
    """The number of points that the page says it draws."""
    found = re.fullmatch(r"([\d,]+) of 300,000 points are drawn\.", step["told"])
    return int(found[1].replace(",", ""))


@pytest.mark.slow
class TestByLevel:
    def test_it_opens_with_the_first_levels(self, looked):
        assert looked["messages"] == []
        assert looked["start"]["arrived"] == []
        assert 20_000 < drawn(looked["start"]) < 60_000

    def test_deeper_nodes_come_where_somebody_looks(self, looked, copc):
        with open(copc, "rb") as file:
            nodes = CopcNodes(file)
        arrived = looked["near"]["arrived"]
        deepest = np.flatnonzero(nodes.entries["level"] == 3)
        assert set(arrived) < set(deepest.tolist())
        assert len(arrived) == len(set(arrived))
        more = drawn(looked["near"]) - drawn(looked["start"])
        assert 0 < more <= nodes.entries["count"][arrived].sum()  # some came and were passed on the way

    def test_they_are_coloured_as_the_others(self, looked):
        assert looked["coloured"]["picture"] != looked["near"]["picture"]
        assert looked["coloured"]["arrived"] == []

    def test_a_picked_point_is_the_point_of_the_file(self, looked, copc):
        whole, picked = gppcs.read(copc), looked["picked"]
        row = int(picked["row"].replace(",", ""))
        half = 100 / 131_000  # of a step, if it is of the first levels
        assert [float(picked[axis]) for axis in "xyz"] == pytest.approx(whole.points[row].tolist(), abs=half)
        assert float(picked["intensity"].replace(",", "")) == whole.attributes["intensity"][row]

    def test_from_afar_only_the_first_levels_are_drawn_again(self, looked):
        assert drawn(looked["back"]) == drawn(looked["start"])
        assert looked["back"]["arrived"] == []

    def test_nodes_that_nobody_looks_at_any_more_are_cancelled(self, looked):
        assert looked["cancelled"] > 0
        assert drawn(looked["away"]) == drawn(looked["start"])
        assert looked["away"]["picture"] == looked["back"]["picture"]
