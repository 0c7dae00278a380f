"""What the commands refuse: one line that names the argument or the file, the exit code 2, all files as they were."""

import shlex

import numpy as np
import pytest

import gppcs

STARTS = {
    "SIMPLIFY": "simplify scan.ply -o out.ply",
    "POINTS": "simplify scan.ply -o out.ply --points 5",
    "BEFORE": "simplify --points 40",  # before the work
    "MESH": "mesh ball.ply -o out.ply -q",
    "COMPARE": "compare --no-picture",
}
# A command, and what the line names.
REFUSED = """
simplfy | simplify
simplify | Missing argument
simplify scan.ply | --output
info missing.ply | missing.ply: No such file
info '' | name of a file
methods fpss | 'fps'
sample brackt -o a.ply | 'bracket'
sample fan -o - | standard output
sample bracket -o a.ply --points 1000000000000000 | Unable to allocate

simplify empty.ply -o out.ply --ratio 0.1 | empty.ply
simplify cut.ply -o out.ply --ratio 0.1 | cut.ply
simplify broken.ply -o out.ply --ratio 0.1 | index 7
simplify other -o out.ply --ratio 0.1 | other
SIMPLIFY | expected one of --ratio, --points, --tolerance, --spacing and --max-gap, found none
compare scan.ply -o both | expected one of --ratio and --points, found none
SIMPLIFY --tolerance 1% --points 5 | found --points and --tolerance
SIMPLIFY --tolerance 1% --dry-run | --dry-run
SIMPLIFY --levels 5,10% | levels
SIMPLIFY --levels 5,10 --mark kept | mark
SIMPLIFY --levels 5,1000 --method fps | ask for fewer
POINTS --rato 1 | --rato
POINTS --invalid odd | '--invalid': 'odd'
POINTS --mark kept --index | index
POINTS --mark kept --order input | --mark without --order
POINTS --order gps_time | 'gps_time'
POINTS --workers 2 | --threads
simplify - -o out.ply --points 5 --workers tcp://localhost:1 | standard input
POINTS --keep 'z > 5' | --quota, or read no others with --only
POINTS --quota 'z > 5: 1' --quota 'z > 5: 2' | 'z > 5' twice
POINTS --threads x | '--threads': Input should be a valid integer
POINTS --weight red --memory 1MB | memory
POINTS --denoise --mark kept | mark
POINTS -o none/out.ply | none
POINTS -o scan.ply | scan.ply
POINTS -o out.foo | '.foo'
POINTS in/scan.ply -o . | scan.ply
POINTS --inside scan.ply | GeoJSON
POINTS --inside 900,900,901,901 --memory 300MB | box
BEFORE scan.ply -o out.ply --mark= | mark
BEFORE scan.ply -o out.csv --mark x | 'x'
BEFORE scan.ply -o out.pts --mark row | PTS
BEFORE bare.npy -o out.obj --normals | nx

convert scan.ply out.ply --inside= | box
convert scan.ply other.obj | leave this out with --lossy
convert scan.ply scan.ply --force | scan.ply
convert scan.ply there.html --to ply | force
convert scan.ply a.laz --memory 1GB | .copc.laz
convert table.txt out.ply --columns x,y,z | table.txt

render scan.ply -o a.jpg | .png
render scan.ply -o there.png | force
render scan.png -o scan.png --force | scan.png
render scan.ply -o a.png --size big | --size
render scan.ply -o a.png --colour curvatur | 'curvature'
render nan.npy -o a.png | nan.npy
render scan.ply small.ply scan.ply -o a.png | found 3
report scan.ply small.ply -o small.ply --force | small.ply
report scan.ply small.ply -o r.txt | .html
report scan.ply -o r.html | SIMPLIFIED
report scan.ply small.ply -o r.html --detail paint | 'paint'
view scan.ply -o there.html | force
view scan.ply --view north | --view

evaluate scan.ply | --simplified-mesh
evaluate scan.ply scan.ply --simplified-mesh mesh.ply | --simplified-mesh
evaluate scan.ply far.ply | unit
evaluate scan.ply scan.ply --mesh scan.ply | no triangle
MESH | --points, --ratio, --faces, --tolerance, points to keep
MESH --points 9 --faces 9 | found --points and --faces
MESH --keep-points small.ply | index 0
MESH --keep-points nothing.ply | nothing.ply: No such file
MESH --points 9 -o ball.ply | ball.ply

COMPARE scan.ply --points 9 -o side --colour rgb | --no-picture
COMPARE scan.ply --ratio 0.1 -o side --methods '' | ''
COMPARE scan.ply --ratio 0.1 -o scan.ply | folder
COMPARE broken.ply --ratio 0.1 -o side --methods fps | drop them with --invalid drop
COMPARE missing.ply --ratio 0.1 -o old | old
COMPARE in/table.csv --ratio 0.1 -o in --force | table.csv
"""
EXTRAS = {"--mesh": "pymeshlab", "render": "matplotlib"}


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


@pytest.mark.parametrize("row", [*filter(None, REFUSED.splitlines())])
def test_what_is_refused(refused, things, monkeypatch, row):
    command, part = row.split(" | ")
    start, _, rest = command.partition(" ")
    arguments = shlex.split(f"{STARTS.get(start, start)} {rest}")
    for word in set(arguments) & set(EXTRAS):
        pytest.importorskip(EXTRAS[word])
    if start == "BEFORE":
        monkeypatch.setattr(gppcs.LocalGP, "__call__", lambda *_: pytest.fail("the method has begun"))
    monkeypatch.chdir(things)
    refused(arguments, part)
