"""A box and a resolution of COPC files, and a box of other files."""

import laspy
import numpy as np
import pytest

import gppcs
from copc_file import ENTRY, write_copc
from formats import overwrite
from gppcs.errors import FileFormatError, ParameterError
from gppcs.io.cloud_files import CloudFiles
from las_file import las_of

N, DEPTH, SPACING = 2000, 3, 8.0
CORNERS = ([1000.0, 2000.0, 0.0], [1100.0, 2050.0, 20.0])
BOX = [1020.0, 2010.0, 1060.0, 2030.0]
BOXES = [None, BOX, [*BOX[:2], 5.0, *BOX[2:], 9.0], [0.0, 0.0, 9e5, 9e5], [0.0, 0.0, 1.0, 1.0]]


@pytest.fixture(scope="module")
def las():
    rng = np.random.default_rng(0)
    points, (intensity, red) = rng.uniform(*CORNERS, (N, 3)), rng.integers(0, 2**16, (2, N))
    return las_of(points, 7, offsets=CORNERS[0], gps_time=np.arange(N), intensity=intensity, red=red)


@pytest.fixture(scope="module", params=[False, True])
def copc(las, tmp_path_factory, request):
    """A COPC file with an index of one page or of several."""
    path = tmp_path_factory.mktemp("copc") / "a.copc.laz"
    write_copc(path, las, DEPTH, SPACING, paged=request.param)
    return path


def inside(cloud, box):
    lower, upper = np.reshape(box, (2, -1))
    points = cloud.points[:, : len(lower)]
    return cloud[((points >= lower) & (points <= upper)).all(axis=1)]


@pytest.mark.parametrize("resolution", [None, 100, 8, 7.9, 3, 1e-9])
@pytest.mark.parametrize("box", BOXES)
def test_the_points_are_those_that_laspy_finds(copc, las, box, resolution):
    found, cloud = gppcs.open(copc, inside=box, resolution=resolution).read(), gppcs.read(copc)
    assert sorted(cloud.attributes["gps_time"]) == las.gps_time.tolist()
    bounds = None if box is None else laspy.Bounds(*np.reshape(box, (2, -1)))
    with laspy.CopcReader.open(copc) as reader:
        expected = reader.query(bounds, resolution)
    assert sorted(found.attributes["gps_time"]) == sorted(expected.gps_time)
    indices = np.flatnonzero(np.isin(cloud.attributes["gps_time"], found.attributes["gps_time"]))
    assert found == cloud.take(indices)  # in the order of the file


@pytest.mark.parametrize("suffix", [".las", ".laz", ".ply", ".csv", ".npz", ".xyz.gz"])
def test_every_file_can_be_read_with_a_box_but_without_a_resolution(copc, tmp_path, suffix):
    path = tmp_path / f"b{suffix}"
    gppcs.write(path, gppcs.read(copc), lossy=True)
    cloud = gppcs.read(path)
    for box in BOXES[1:]:
        assert gppcs.open(path, inside=box).read() == inside(cloud, box)
    with pytest.raises(FileFormatError, match=r"b\.\S+: expected a COPC file, .* leave out `resolution`"):
        gppcs.open(path, resolution=1).read()


def test_the_border_belongs_to_the_box_and_nan_to_no_box(tmp_path):
    points = [[0, 0, 0], [1, 1, 1], [2, 2, np.nan], [np.nan, 1, 1], [3, 1, 1]]
    gppcs.write(tmp_path / "a.csv", points)
    assert gppcs.open(tmp_path / "a.csv", inside=[0, 0, 2, 2]).read().points[:, 0].tolist() == [0, 1, 2]
    assert gppcs.open(tmp_path / "a.csv", inside=[0, 0, 0, 2, 2, 2]).read().points[:, 0].tolist() == [0, 1]
    open_sides = [-np.inf, -np.inf, -np.inf, 1, np.inf, np.inf]
    assert gppcs.open(tmp_path / "a.csv", inside=open_sides).read().points[:, 0].tolist() == [0, 1]
    (tmp_path / "b.txt").write_text("".join(f"{a} {b} {c}\n" for a, b, c in points))
    assert gppcs.open(tmp_path / "b.txt", columns=["y", "x", "z"], inside=[1, 3, 1, 3]).read().points.tolist() == [
        [1, 3, 1]
    ]


@pytest.mark.parametrize("suffix", [".laz", ".ply", ".npz"])
def test_chunks_of_several_files_are_in_the_box(copc, tmp_path, suffix):
    gppcs.write(tmp_path / f"b{suffix}", gppcs.read(copc), lossy=True)
    paths = [tmp_path / f"b{suffix}", copc] if suffix == ".laz" else [tmp_path / f"b{suffix}"] * 2
    expected = np.concatenate([inside(gppcs.read(path), BOX).points for path in paths])
    with CloudFiles(paths, inside=BOX) as files:
        assert files.n_points == len(expected)
        assert len(files.preview)
        chunks = list(files.chunks(50))
        assert suffix == ".npz" or max(map(len, chunks)) <= 50
        assert np.concatenate([chunk.points for chunk in chunks]).tobytes() == expected.tobytes()
    with CloudFiles(paths, inside=[0, 0, 1, 1]) as files:
        assert files.n_points == len(files.read()) == 0
        assert not list(files.chunks())


NO_BOXES = (
    [], [1, 2, 3], [1] * 5, [1, 0, 0, 1], [0, 0, np.nan, 1], "0,0,1,x", "", [0, 0, "1", 1], 7, np.array(0.1),
    [np.inf] * 4, [np.inf, 0, np.inf, 1], [0, -np.inf, 1, -np.inf],
)  # fmt: skip


@pytest.mark.parametrize(
    ("query", "message"),
    [
        *(({"inside": box}, "expected `inside` to be a box xmin, ymin, xmax, ymax or") for box in NO_BOXES),
        *(({"resolution": size}, "expected a resolution above 0, found") for size in (0, -1, np.inf, np.nan, "1")),
    ],
)
def test_what_is_no_box_or_no_resolution_is_refused(query, message):
    with pytest.raises(ParameterError, match=message):
        gppcs.open("a.laz", **query)


INFO = 375 + 54  # where the record with the index begins


@pytest.mark.parametrize(
    ("place", "values", "message"),
    [
        (INFO + 32, np.float64(0).tobytes(), "a COPC index with a spacing and a size above 0, found 0"),
        (INFO + 40, np.uint64(2**60).tobytes(), "a COPC index within the file"),
    ],
)
def test_a_damaged_index_is_refused(copc, tmp_path, place, values, message):
    path = tmp_path / "a.copc.laz"
    path.write_bytes(copc.read_bytes())
    overwrite(path, place, values)
    with pytest.raises(FileFormatError, match=message):
        gppcs.open(path, inside=BOX).read()
    assert len(gppcs.read(path)) == N  # which needs no index


def test_an_index_that_leads_to_itself_or_twice_to_the_same_points_is_refused(las, tmp_path):
    path = tmp_path / "a.copc.laz"
    index = write_copc(path, las, DEPTH, SPACING)
    place, content = path.stat().st_size - index.nbytes, path.read_bytes()
    loop, twice, beyond, many, more, fewer, negative = (index.copy() for _ in range(7))
    loop[0] = (0, (0, 0, 0), place, index.nbytes, -1)
    twice[1] = index[0]
    beyond["size"][-1] = 2**30
    many["count"][-1] = 2**31 - 1
    more["count"][-1] += 1000
    fewer["count"][0] -= 1
    negative["count"][0] = -5
    for entries, message in (
        (loop, "a COPC index within the file"),
        (twice, "found some that overlap"),
        (beyond, "expected all compressed points within the file"),
        (many, "expected chunks of 1 to 10,000,000 points, found one of 2,147,483,647"),
        (more, "expected whole compressed points, but lazrs reports"),
        (fewer, "expected a COPC index of all 2,000 points, found one of 1,999"),
        (negative, "expected a COPC index of all 2,000 points, found one of"),
    ):
        path.write_bytes(content)
        overwrite(path, place, entries.tobytes())
        if entries is many or entries is more:
            overwrite(path, 247, np.uint64(entries["count"].sum()).tobytes())  # the number of points in the header
        with pytest.raises(FileFormatError, match=message):
            gppcs.open(path, resolution=1e-9).read()


def test_a_page_that_leads_to_itself_is_visited_once(las, tmp_path):
    path = tmp_path / "a.copc.laz"
    write_copc(path, las, DEPTH, SPACING)
    place = path.stat().st_size
    overwrite(path, INFO + 40, np.array([place, ENTRY.itemsize], "<u8").tobytes())
    with open(path, "r+b") as file:
        file.seek(place)
        file.write(np.array([(0, (0, 0, 0), place, ENTRY.itemsize, -1)], ENTRY).tobytes())
        file.truncate(10**10)  # which takes no place on the disk, but hours where the page is read for ever
    with pytest.raises(FileFormatError, match="a COPC index within the file"):
        gppcs.open(path, inside=BOX).read()


def test_a_layer_that_would_crash_lazrs_is_refused(las, tmp_path):
    """A layer of times in which the decoder would see a switch of sequences without end."""
    path = tmp_path / "a.copc.laz"
    index = write_copc(path, las[:800], 3, SPACING)
    layers = int(index["offset"][np.argmax(index["count"])]) + las.header.point_format.size + 4
    sizes = np.frombuffer(path.read_bytes(), "<u4", 10, layers)  # 9 of points, the last the times; 1 of colours
    overwrite(path, layers + 40 + int(sizes[:8].sum()), b"\xff" * 8)
    for query in ({"inside": [0, 0, 9e5, 9e5]}, {}):
        with pytest.raises(FileFormatError, match=r"copc\.laz: expected whole compressed points, found damaged ones"):
            gppcs.open(path, **query).read()
