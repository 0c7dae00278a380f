"""What the commands refuse: one line that says what is wrong, the exit code 2, and all files as they were."""

import shlex

import numpy as np
import pytest

import gppcs

SIMPLIFY = "simplify scan.ply -o out.ply"
POINTS = f"{SIMPLIFY} --points 5"
COMPARE = "compare scan.ply --no-picture"
MESH = "mesh ball.ply -o out.ply -q"
MESHES = "compare ball.ply --points 100 --meshes -o side --no-picture"
BEFORE = "simplify --points 40"  # before the work
THERE = "expected a new file"
SAME = "expected a file other than the input"
NO_FOLDER = "expected a folder"

REFUSED = {
    "": [
        ("simplfy", "'simplify'"),
        ("simplify", "Missing argument"),
        ("simplify scan.ply", "Missing option '--output'"),
        ("info missing.ply", "missing.ply: No such file"),
        ("info none.vpc", "none.vpc: No such file"),
        ("info scan.ply --inside 0,0,x,1", "expected --inside with the numbers of a box, such as 0,0,100,50"),
        ("methods fps hc", "unexpected extra argument"),
        ("methods fpss", "did you mean 'fps'?"),
        ("sample brackt -o a.ply", "did you mean 'bracket'?"),
        ("sample fan -o -", "expected the format of standard output"),
        ("sample bracket -o none/a.ply", NO_FOLDER),
        ("simplify tiles -o small/ --ratio 0.1", "gppcs: tiles: No such file or directory"),
        ("simplify mm -o small/ --tolerance 1", "mm: No such file", "write no space before it: 1mm"),
        ("simplify missing.ply -o new/ --points 5 --method fps", "missing.ply: No such"),
        ("simplify empty.ply -o out.ply --ratio 0.1", "empty.ply: the cloud is empty"),
        ("simplify zero.ply -o out.ply --ratio 0.1", "zero.ply: expected"),
        ("simplify bytes.ply -o out.ply --ratio 0.1", "bytes.ply: expected 'ply'"),
        ("simplify cut.ply -o out.ply --ratio 0.1", "cut.ply: the file ends in vertex 400 of 400"),
        ("simplify u.ply -o out.ply --ratio 0.1", "u.ply: expected x, y and z", "'u', 'y', 'z'"),
        ("simplify broken.ply -o out.ply --ratio 0.1", "broken.ply: 2 of 400 points", "invalid"),
        ("simplify other -o out.ply --ratio 0.1", "other: expected a folder with files of formats", "found none"),
    ],
    "sample bracket -o a.ply": [
        ("--points 0", "whole number from 1 on, found 0"),
        ("--points 1000000000000000", "Unable to allocate"),
        ("--points few", "such as 5000, 5,000, 5k or 1.5M, found 'few'"),
        ("--noise nan", "found nan"),
    ],
    SIMPLIFY: [
        ("", "either a ratio or a number of points, found neither"),
        ("--ratio 3", "expected a ratio", "found 3.0"),
        ("--ratio abc", "ratio", "found 'abc'"),
        ("--points 0", "whole number from 1 on, found 0"),
        ("--points abc", "n_points", "found 'abc'"),
        ("--tolerance 1% --points 5", "found n_points and tolerance"),
        ("--tolerance 0", "tolerance", "found '0'"),
        ("--tolerance '5 parsec'", "tolerance", "found 'parsec'"),
        ("--tolerance 0.5mm", "scan.ply: the cloud does not say in which unit", "give unit"),
        ("--tolerance 1:p99", "tolerance", "found '1:p99'"),
        ("--tolerance 1% --dry-run", "--ratio or --points with --dry-run"),
        ("--tolerance 1% --memory 1MB", "tolerance takes all points at once", "raise memory"),
        ("--max-gap -1", "max_gap"),
        ("--spacing 5 --keep 'z > 60'", "a tolerance or a largest gap with points to keep", "found a spacing"),
        ("--levels 5,390 --keep 'z > 60'", "whatever happens, but the coarsest level has only 5 points"),
        ("--levels 5,10%", "with shares or with numbers, found both"),
        ("--levels 5,5", "different sizes"),
        ("--levels 5,10 --points 3", "levels without n_points"),
        ("--levels 5,10 --add kept", "levels without add kept"),
        ("--levels 10%,1% --group red", "levels without group"),
        ("--levels 5,10 --method voxel", "a method that ranks its points, found 'voxel'; use 'gp'"),
        (f"--levels {','.join(map(str, range(1, 258)))}", "at most 256 sizes, found 257"),
        ("--levels 5,1000 --method fps", "scan.ply: expected a finest level of less than all 400 points"),
    ],
    POINTS: [
        ("--rato 1", "--rato", "--ratio"),
        ("--set neighbours=0", "neighbours to be from 1 to 64, found 0"),
        ("--set neighbours=few", "neighbours to be int, found 'few'"),
        ("--set neighbours", "--set KEY=VALUE, found 'neighbours'"),
        ("--drop invalid,odd", "--drop with invalid or outliers, found 'odd'"),
        ("--add index:row", "--add with normals or scores or index or kept, found 'index:row'"),
        ("--add kept,index", "expected --add kept alone"),
        ("--workers 0", "--workers as a number from 1 on", "found '0'"),
        ("--memory lots", "expected an amount of memory such as 4GB or 512MB, found 'lots'"),
        ("--memory 0.8", "expected an amount of memory such as 4GB or 512MB, found '0.8'"),
        ("--weight red --memory 1MB", "MB of memory to choose 5 of"),
        ("--keep 'z > 60' --memory 1MB", "to choose 5 of 400 points, found"),
        ("--denoise --keep 'z > 0'", "denoise without keep"),
        ("--denoise --add kept", "--add kept with a method that moves no points"),
        ("--set denoise=true --add kept", "--add kept with a method that moves no points"),
        ("--method wlop --set snap=false --add kept", "--add kept with a method that moves no points"),
        ("-o none/out.ply", f"none/out.ply: {NO_FOLDER}"),
        ("-o scan.ply", f"scan.ply: {SAME} scan.ply, found the same"),
        ("-o out.foo", "out.foo: expected one of the formats .ply", "found '.foo'"),
        ("in/scan.ply -o .", "inputs with different names"),
        ("--keep 'nz > 9'", "scan.ply: expected points with nz > 9 to keep, found none"),
        ("--only 'z > 999'", "scan.ply: expected points with z > 999, found none"),
        ("--only 'zz > 9'", "scan.ply: 'zz > 9', at character 1", "no attribute 'zz'"),
        ("--inside scan.ply", "scan.ply: expected polygons in GeoJSON"),
        ("--inside none.json", "none.json: No such file"),
        ("--inside 900,900,901,901 --memory 300MB", "in the box, found none"),
        ("--weight rad", "scan.ply: the cloud has no attribute 'rad'", "did you mean 'red'?"),
        ("--quota 'nz > 0'", "expected --quota 'CONDITION: NUMBER'"),
        ("--quota 'nz > 0: many'", "quota"),
    ],
    BEFORE: [
        ("scan.ply -o out.ply --add kept:", "expected --add kept:NAME, found no name"),
        ("scan.ply -o out.csv --add kept:x", "expected columns of different names, found 'x' twice"),
        ("scan.ply -o out.npz --add kept:points", "expected columns of different names, found 'points' twice"),
        (f"scan.ply -o out.las --add kept:{'long' * 9}", "expected a name of at most 32 bytes"),
        ("scan.ply -o out.ply --add kept:red", "scan.ply: expected the name of a new attribute, found 'red'"),
        ("scan.ply -o out.pts --add kept:row", "PTS cannot hold: "),
        ("bare.npy -o out.obj --add normals", "OBJ cannot hold: attribute nx (float32)"),
        ("bare.npy -o out.obj --add scores", "OBJ cannot hold: attribute score (float32)"),
    ],
    "convert": [
        ("scan.ply out.ply --inside=", "found nothing"),
        ("scan.ply out.ply --inside 0,0,1,1 --inside 0,0,2,2", "expected --inside with at most one box and one file"),
        ("scan.ply out.ply --resolution 1", "scan.ply: expected a COPC file"),
        ("scan.ply other.obj", "OBJ cannot hold: attribute nx (float32)", "lossy"),
        ("scan.ply scan.ply", SAME),
        ("scan.ply scan.ply --force", SAME),
        ("scan.ply there.html --to ply", THERE),
        ("scan.ply a.laz --memory 1GB", "ends in .copc.laz"),
        ("scan.ply d.las --ascii", "d.las: expected PLY or PCD with a choice"),
        ("table.txt out.ply --columns x,y,z", "table.txt: line 1 has 4 columns, but 3 names are given (x, y, z)"),
        ("table.txt out.ply --columns x,y,w,a", "expected names of columns with x, y and z"),
        ("table.txt out.ply --columns x,y,z,x", "expected different names of columns"),
        ("table.txt out.ply --columns ''", "expected names of columns with x, y and z"),
        (
            "scan.ply out.ply --columns x,y,z,a",
            "scan.ply: expected a text table, whose columns can be named, found PLY",
        ),
    ],
    "render": [
        ("scan.ply -o a.jpg", "a.jpg: expected a name that ends in .png"),
        ("scan.ply -o there.png", f"there.png: {THERE}"),
        ("scan.ply -o none/a.png", f"none/a.png: {NO_FOLDER}"),
        ("scan.png -o scan.png --force", f"{SAME} scan.png"),
        ("scan.ply -o a.png --size big", "expected --size WIDTHxHEIGHT", "found 'big'"),
        ("scan.ply -o a.png --size 9x9", "whole number from 64 on, found 9"),
        ("scan.ply -o a.png --size 9000x90", "at most 4096 x 4096 pixels, found 9000 x 90"),
        ("scan.ply -o a.png --colour curvatur", "found 'curvatur'; did you mean 'curvature'?"),
        ("bare.npy -o a.png --colour rgb", "found 'rgb'; expected one of variation"),
        ("bare.npy -o a.png --view 30", "expected --view AZIMUTH,ELEVATION"),
        ("nan.npy -o a.png", "nan.npy: expected points with finite coordinates to draw, found none"),
        ("missing.ply -o a.png", "missing.ply: No such file"),
        ("notes.md -o a.png", "notes.md: expected one of the formats"),
        ("scan.ply small.ply scan.ply -o a.png", "expected one cloud, or two to draw beside each other, found 3"),
    ],
    "report": [
        ("scan.ply small.ply -o small.ply --force", SAME),
        ("scan.ply small.ply -o there.html", THERE),
        ("scan.ply small.ply -o r.txt", "r.txt: expected a name that ends in .html"),
        ("scan.ply -o r.html", "Missing argument 'SIMPLIFIED...'"),
        ("scan.ply none.ply -o r.html", "none.ply: No such file"),
        ("scan.ply empty.xyz -o r.html", "empty.xyz: "),
        ("nan.npy small.ply -o r.html --meshes", "nan.npy: expected points with finite"),
        ("scan.ply small.ply -o r.html --from xyz", "expected a file of the format xyz, found PLY"),
        ("scan.ply small.ply -o r.html --columns x,y,z", "a text table, whose columns can be named, found PLY"),
        ("scan.ply small.ply -o r.html --detail paint", "the cloud has no attribute 'paint'"),
    ],
    "view": [
        ("scan.ply -o scan.ply --force", SAME),
        ("scan.ply -o there.html", THERE),
        ("scan.ply -o v", "v: expected a name that ends in .html"),
        ("notes.md", "notes.md: expected one of the formats"),
        ("scan.ply --view north", "expected --view AZIMUTH,ELEVATION"),
        ("scan.ply small.ply -o v.html --from xyz", "expected a file of the format xyz, found PLY"),
    ],
    "evaluate scan.ply": [
        ("", "expected either SIMPLIFIED or --simplified-mesh, found neither\n"),
        ("scan.ply --simplified-mesh mesh.ply", "expected either SIMPLIFIED or --simplified-mesh, found both\n"),
        ("missing.ply", "missing.ply", "No such file"),
        ("far.ply", "does not lie on the original", "same unit"),
        ("scan.ply --mesh scan.ply", "scan.ply", "400 points and no triangle"),
        ("empty.ply", "simplified cloud is empty"),
        ("small.ply --from xyz", "expected a file of the format xyz, found PLY"),
        ("small.ply --columns x,y,z", "a text table, whose columns can be named, found PLY"),
    ],
    MESH: [
        ("", "exactly one of n_points", "found none"),
        ("--points 9 --faces 9", "found n_points and n_faces"),
        ("--faces many", "n_faces"),
        ("--tolerance 0", "tolerance"),
        ("--points 9 --fill-holes -1", "fill_holes"),
        ("--keep-points ball.ply --effort 1", "effort"),
        ("--keep-points small.ply", "small.ply: expected points of the cloud, found 50", "the first at index 0"),
        ("--keep-points nothing.ply", "nothing.ply: No such file"),
        ("--points 9 -o out.las", "formats of meshes"),
        ("--points 9 -o ball.ply", "ball.ply"),
    ],
    "mesh": [
        ("nan.npy -o out.ply --points 9", "3 of 3 points have coordinates that are NaN or infinite, the first at"),
        ("empty.ply -o m.ply --points 100", "empty.ply: the cloud is empty: expected at least one point\n"),
        ("empty.ply -o m.ply --keep-points ball.ply", "empty.ply: the cloud is empty: expected at least one point\n"),
    ],
    COMPARE: [
        ("--points 9 -o side --colour rgb", "leave out --no-picture"),
        ("--points 9 -o side --up y", "a picture or --report to turn"),
        ("--ratio 0.1 -o side --methods ''", "no method ''"),
        ("--ratio 0.1 -o scan.ply", "expected a folder, found a file"),
        ("--ratio 0.1 -o no/side", "make it first"),
        ("--ratio 0.1 -o -", "-: expected a folder, found the name of standard output"),
    ],
    "compare --no-picture": [
        ("broken.ply --ratio 0.1 -o side --methods fps", "2 of 400 points"),
        ("missing.ply --ratio 5 -o side --methods fps", "at most 1, found 5"),
        ("missing.ply --ratio 0.1 -o side", "missing.ply"),
        ("missing.ply --ratio 0.1 -o old", "old: expected a new or empty folder, found one with files"),
        ("missing.ply --ratio 0.1 -o other", "other: expected a new or empty folder"),
        ("in/table.csv --ratio 0.1 -o in --force", SAME),
    ],
    MESHES: [
        ("--methods gp", "no way to a mesh 'gp'; expected one of mesh, mesh-moved, "),
        ("--ratio 0.1", "found both"),
        ("--seed 3", "expected --seed without --meshes"),
        ("--detail red", "expected --detail without --meshes"),
    ],
}
EXTRAS = {"--mesh": "pymeshlab", "--meshes": "pymeshlab", "render": "matplotlib", "--plot": "matplotlib"}


@pytest.fixture(scope="module")
def things(tmp_path_factory):
    """A folder of files, which no test changes."""
    folder = tmp_path_factory.mktemp("things")
    scan, ball = gppcs.sample("bracket", 400), gppcs.sample("sphere", 1000)
    for name in ("in", "old", "other"):
        (folder / name).mkdir()
    broken = scan.take(range(400))
    broken.points[[7, 9], [1, 0]] = np.nan, np.inf
    clouds = {"scan": scan, "in/scan": scan, "small": scan[:50], "broken": broken, "ball": ball}
    clouds |= {"empty": np.empty((0, 3)), "far": scan.points[:9] + 1e5}
    for name, cloud in clouds.items():
        gppcs.write(folder / f"{name}.ply", cloud)
    gppcs.write(folder / "in/table.csv", scan)
    gppcs.write(folder / "scan.png", scan, format="ply")  # read by its content
    np.save(folder / "bare.npy", scan.points)
    np.save(folder / "nan.npy", np.full((3, 3), np.nan))
    content = (folder / "scan.ply").read_bytes()
    for name, wrong in {
        "zero.ply": b"", "bytes.ply": bytes(range(256)), "cut.ply": content[:-10], "empty.xyz": b"",
        "notes.md": b"notes", "u.ply": content.replace(b"float x", b"float u"), "table.txt": b"1 2 3 4\n",
        "there.html": b"precious", "there.png": b"precious", "old/table.md": b"mine", "other/notes.md": b"",
    }.items():  # fmt: skip
        (folder / name).write_bytes(wrong)
    return folder


@pytest.mark.parametrize(
    ("prefix", "words", "parts"),
    [
        pytest.param(prefix, words, parts, id=f"{prefix} {words}"[:90])
        for prefix, rows in REFUSED.items()
        for words, *parts in rows
    ],
)
def test_what_is_refused(refused, things, monkeypatch, prefix, words, parts):
    arguments = shlex.split(f"{prefix} {words}")
    for word in set(arguments) & set(EXTRAS):
        pytest.importorskip(EXTRAS[word])
    if prefix == BEFORE:
        monkeypatch.setattr(gppcs.LocalGP, "__call__", lambda *_: pytest.fail("the method has begun"))
    monkeypatch.chdir(things)
    refused(arguments, *parts)
