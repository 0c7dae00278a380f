"""Files in chunks, and several files as one cloud."""

import gzip
from dataclasses import replace
from functools import partial

import laspy
import numpy as np
import pytest

import gppcs
from copc_file import write_copc
from gppcs.amounts.options import Options
from gppcs.engine.timer import Timer
from gppcs.errors import FileFormatError
from gppcs.io import cloud_files, files
from gppcs.io.cloud_files import CloudFiles, open_clouds
from gppcs.io.format import Reader
from gppcs.io.query import Query
from gppcs.simplification import simplify_files
from gppcs.streaming.plan import make_plan

N = 1000


def cloud(n=N, seed=0):
    rng = np.random.default_rng(seed)
    attributes = {
        "label": rng.integers(-9, 9, n),
        "weight": rng.random(n),
        "red": rng.integers(0, 255, n).astype(np.uint8),
    }
    return gppcs.PointCloud(rng.random((n, 3)).astype(np.float32), attributes, np.dtype(np.float32))


def split(original, folder, cuts, suffix):
    paths = []
    for i, rows in enumerate(np.split(np.arange(len(original)), cuts)):
        paths.append(folder / f"{i}{suffix}")
        gppcs.write(paths[-1], original.take(rows))
    return paths


def same(a, b):
    assert a.points.tobytes() == b.points.tobytes()
    assert list(a.attributes) == list(b.attributes)
    for name, values in a.attributes.items():
        assert values.dtype == b.attributes[name].dtype
        np.testing.assert_array_equal(values, b.attributes[name])
    assert a.coordinate_dtype == b.coordinate_dtype
    assert a.header == b.header


IN_CHUNKS = [
    ".csv",
    ".feather",
    ".las",
    ".laz",
    ".copc.laz",
    ".npy",
    ".parquet",
    ".pcd",
    ".ply",
    ".pts",
    ".xyz",
    ".e57",
]


@pytest.mark.parametrize("suffix", IN_CHUNKS)
@pytest.mark.parametrize("rows", [1, 7, 999, 1000, 1001, 10**7])
def test_the_chunks_of_a_file_are_what_read_returns(tmp_path, suffix, rows):
    if suffix == ".pts":
        original = gppcs.PointCloud(cloud().points, {"intensity": cloud().attributes["label"]})
    else:
        original = cloud()
    gppcs.write(tmp_path / f"a{suffix}", original, lossy=True)  # LAS rounds
    whole = gppcs.read(tmp_path / f"a{suffix}")
    with CloudFiles([tmp_path / f"a{suffix}"]) as files:
        for _ in range(2):
            chunks = list(files.chunks(True, rows))
            assert [len(each) for each in chunks] == [min(rows, N - start) for start in range(0, N, rows)]
            joined = {name: np.concatenate([each.attributes[name] for each in chunks]) for name in whole.attributes}
            points = np.concatenate([each.points for each in chunks])
            same(gppcs.PointCloud(points, joined, chunks[0].coordinate_dtype, chunks[0].header), whole)
        bare = list(files.chunks(False, rows))
        assert not any(each.attributes for each in bare)
        np.testing.assert_array_equal(np.concatenate([each.points for each in bare]), whole.points)
        same(files.read(), whole)
        assert files.n_points == pytest.approx(N, rel=0.02)


@pytest.mark.parametrize(("kind", "mark", "sizes"), [("int", "", [100] * 3), ("list uchar int", "1 ", [300])])
def test_text_of_ply_comes_in_chunks_and_lists_as_a_whole(tmp_path, kind, mark, sizes):
    header = "ply\nformat ascii 1.0\ncomment x\nelement vertex 300\n" + "".join(f"property float {a}\n" for a in "xyz")
    rows = "".join(f"{i} 0 0 {mark}{i}\n" for i in range(300))
    (tmp_path / "a.ply").write_text(f"{header}property {kind} k\nend_header\n{rows}")
    with CloudFiles([tmp_path / "a.ply"]) as files:
        assert [len(each) for each in files.chunks(True, 100)] == sizes
        assert {each.header.remarks for each in files.chunks(True, 100)} == {("comment x",)}


@pytest.mark.parametrize("suffix", [".ply", ".csv", ".npy", ".npz"])
@pytest.mark.parametrize("cuts", [[], [400], [0, 0, 1, 500, 999, 1000]])
def test_files_of_one_cloud_are_that_cloud(tmp_path, suffix, cuts):
    gppcs.write(tmp_path / f"whole{suffix}", cloud())
    whole = gppcs.read(tmp_path / f"whole{suffix}")
    paths = split(whole, tmp_path, cuts, suffix)
    if suffix == ".csv":  # an empty table has columns of another type
        paths = [path for path in paths if len(gppcs.read(path))]
    with CloudFiles(paths) as files:
        same(files.read(), whole)
        points = np.concatenate([each.points for each in files.chunks(False, 300)])
        np.testing.assert_array_equal(points, whole.points)


def test_compressed_files_are_read_again_in_each_pass(tmp_path):
    gppcs.write(tmp_path / "a.xyz.gz", cloud())
    gppcs.write(tmp_path / "b.xyz.gz", cloud(seed=1))
    with CloudFiles([tmp_path / "a.xyz.gz", tmp_path / "b.xyz.gz"]) as files:
        for _ in range(3):
            assert sum(len(each) for each in files.chunks(True, 300)) == 2 * N
        assert files.n_points == pytest.approx(2 * N, rel=0.02)


def test_what_the_head_reads_as_a_whole_is_read_once(tmp_path, monkeypatch):
    name = "a.npz"
    gppcs.write(tmp_path / name, cloud())
    whole = gppcs.read(tmp_path / name)
    opened = []

    def counted(*given, read=Reader.read):
        opened.append(name)
        return read(*given)

    monkeypatch.setattr(Reader, "read", counted)
    with CloudFiles([tmp_path / name] * 2) as two:
        assert len(two.preview) == N
        both = two.read()
        assert len(opened) == 2
        same(both.take(np.arange(N)), whole)
        same(both.take(np.arange(N, 2 * N)), whole)
        two.read()
        assert len(opened) == 4  # nothing is held on to


def test_columns_that_are_whole_in_some_parts_only_are_fractions_in_all(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,k,n\n0,0,0,1,18446744073709551615\n")
    (tmp_path / "b.csv").write_text("x,y,z,k,n\n0,0,0.5,1.5,1\n")
    with CloudFiles([tmp_path / "a.csv", tmp_path / "b.csv"]) as files:
        joined = files.read()
    assert joined.attributes["k"].tolist() == [1.0, 1.5]
    assert joined.attributes["n"].tolist() == [2**64 - 1, 1]
    assert joined.attributes["n"].dtype == np.uint64


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.zeros(1), None, "same attributes in all files of a cloud, found k in some only"),
        (np.array([2**53 + 1]), np.array([0.5]), "values of k that int64, uint64 or float64 holds exactly"),
        (np.zeros((1, 2)), np.zeros(1), "values of k of one shape"),
        (np.zeros(1), np.array(["x"]), "values of k of one kind"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path, a, b, message):
    for name, values in (("a", a), ("b", b)):
        attributes = {} if values is None else {"k": values}
        gppcs.write(tmp_path / f"{name}.npy", gppcs.PointCloud(np.zeros((1, 3)), attributes))
    with CloudFiles([tmp_path / "a.npy", tmp_path / "b.npy"]) as files, pytest.raises(FileFormatError, match=message):
        files.read()


def test_values_of_extra_bytes_with_different_scales_become_one_attribute(tmp_path):
    paths = []
    for name, scale in (("one", 0.1), ("other", 0.001)):
        header = laspy.LasHeader(point_format=0, version="1.4")
        header.add_extra_dim(laspy.ExtraBytesParams("height", np.int32, scales=[scale], offsets=[0.0]))
        scan = laspy.LasData(header)
        scan.x = scan.y = scan.z = np.arange(3.0)
        scan["height"] = np.arange(3) * scale
        paths.append(tmp_path / f"{name}.las")
        scan.write(paths[-1])
    kept = gppcs.simplify(paths, n_points=6, method="random").cloud
    np.testing.assert_allclose(kept.attributes["height"], [0, 0.1, 0.2, 0, 0.001, 0.002])


LARGE = 120_000  # more than two chunks of a LAZ file


@pytest.fixture(scope="module")
def divisible(tmp_path_factory):
    """Files that can be read from the middle, by their names."""
    folder = tmp_path_factory.mktemp("divisible")
    rng = np.random.default_rng(0)
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales = [0.01] * 3
    las.x, las.y, las.z = rng.uniform(0, 99, (3, LARGE))
    las.gps_time = np.arange(LARGE)
    las.write(folder / "a.las")
    las.write(folder / "a.laz")
    write_copc(folder / "a.copc.laz", las[:3000], 4, 8.0)
    gppcs.write(folder / "a.ply", cloud())
    gppcs.write(folder / "a.npy", cloud())
    return folder


@pytest.mark.parametrize(
    ("name", "rows", "begins"),
    [
        ("a.las", 50_000, [0, 65_536]),
        ("a.las", LARGE, [0]),
        ("a.laz", 1, [0, 50_000, 100_000]),
        ("a.laz", 50_001, [0, 100_000]),
        ("a.laz", 100_001, [0]),
        ("a.copc.laz", 500, None),  # chunks of COPC files differ in size
        ("a.copc.laz", 1, None),
        ("a.ply", 300, [0, 300, 600]),
        ("a.npy", 300, [0, 300, 600]),
    ],
)
def test_the_parts_of_a_file_are_the_file(divisible, name, rows, begins):
    whole = gppcs.read(divisible / name)
    with CloudFiles([divisible / name]) as files:
        assert (files.n_points, files.is_counted) == (len(whole), True)
        parts = [list(part.chunks(True, 40_000)) for part in files.parts(rows)]
    counts = [sum(map(len, chunks)) for chunks in parts]
    assert min(counts[:-1], default=rows) >= min(rows, len(whole))
    assert begins is None or np.cumsum([0, *counts[:-1]]).tolist() == begins
    assert len(parts) > 1 or begins == [0]
    chunks = [chunk for part in parts for chunk in part]
    joined = {key: np.concatenate([chunk.attributes[key] for chunk in chunks]) for key in whole.attributes}
    points = np.concatenate([chunk.points for chunk in chunks])
    same(gppcs.PointCloud(points, joined, chunks[0].coordinate_dtype, chunks[-1].header), whole)


def test_what_can_only_be_read_from_its_start_is_one_part(divisible, tmp_path):
    (tmp_path / "a.las.gz").write_bytes(gzip.compress((divisible / "a.las").read_bytes(), 1))
    gppcs.write(tmp_path / "a.ply", cloud(), ascii=True)
    box = Query.from_options([0, 0, 50, 50])
    for path, query in ((tmp_path / "a.las.gz", None), (tmp_path / "a.ply", None), (divisible / "a.las", box)):
        with CloudFiles([path], query=query) as files:
            [part] = files.parts(100)
            with part:
                assert sum(map(len, part.chunks(False))) == len(files.read())


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("a.las", 247, np.uint64(2**60), r"a\.las: the file ends in point 120001 of 1152921504606846976"),
        ("a.laz", 247, np.uint64(2**60), r"a\.laz: expected all compressed points within the file, found fewer"),
        ("a.laz", None, np.uint64(2**60), r"a\.laz: expected a table of the compressed points, found none"),
        ("a.ply", None, None, "the file ends"),
        ("a.npy", None, None, "numpy reports: mmap length is greater than file size"),
    ],
)
def test_a_damaged_file_has_no_parts(divisible, tmp_path, name, place, value, message):
    content = bytearray((divisible / name).read_bytes())
    if value is None:
        del content[-1:]
    else:
        place = place or int.from_bytes(content[96:100], "little")  # where the points begin
        content[place : place + value.nbytes] = value.tobytes()
    (tmp_path / name).write_bytes(content)
    with CloudFiles([tmp_path / name]) as files, pytest.raises(FileFormatError, match=message):
        list(files.parts(1_000)[0].chunks(True))


def test_each_file_tells_its_number_of_points(tmp_path):
    """A first file with long rows says nothing of one with short rows."""
    rng = np.random.default_rng(0)
    (tmp_path / "a.xyz").write_text("\n".join(f"{x:.15f} {x:.15f} {x:.15f}" for x in rng.random(50)))
    (tmp_path / "b.xyz").write_text("\n".join(f"{i % 7} {i % 5} 1" for i in range(20_000)))
    with CloudFiles([tmp_path / "a.xyz", tmp_path / "b.xyz"]) as files:
        assert files.n_points == pytest.approx(20_050, rel=0.01)


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".feather", ".ptx"])
def test_a_file_too_large_for_memory_is_not_read_to_find_out(tmp_path, monkeypatch, suffix):
    """A small file of many points: 1.5 million times the same point."""
    path, points = tmp_path / f"a{suffix}", np.zeros((1_500_000, 3))
    if suffix == ".npz":
        np.savez_compressed(path, points=points)
    elif suffix == ".npy":
        np.save(path, np.asfortranarray(points))  # by columns, so that it cannot be read in chunks
    elif suffix == ".ptx":
        rest = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
        path.write_text(f"1\n1500000\n{rest}" + "1 1 1 0.5\n" * 1_500_000)
    else:
        gppcs.write(path, points)
    monkeypatch.setattr("gppcs.streaming.plan.PROGRAM", 1_000_000)
    whole = []
    monkeypatch.setattr(Reader, "read", lambda *given: whole.append(given))
    with pytest.raises(gppcs.InputError, match="of memory"):
        gppcs.simplify(path, ratio=0.01, method="hc", memory="15MB")
    assert not whole


@pytest.mark.parametrize("query", [{}, {"inside": [0, 0, 50, 50]}, {"only": "intensity > 3"}])
@pytest.mark.parametrize("suffix", [".las", ".laz", ".ply"])
def test_files_are_read_as_often_as_the_plan_says(tmp_path, monkeypatch, query, suffix):
    """To count the points that a query leaves takes a reading, too."""
    points = gppcs.sample("bracket", 20_000).points
    path, read = tmp_path / f"a{suffix}", []
    gppcs.write(path, gppcs.PointCloud(points, {"intensity": np.arange(20_000) % 9}), lossy=True)

    def counting(opened):
        def counted(*given, **named):
            reader = opened(*given, **named)
            return replace(reader, chunks=partial(counted_chunks, reader.chunks))

        return counted

    def counted_chunks(chunks, *given, **named):
        for chunk in chunks(*given, **named):
            read.append(len(chunk))
            yield chunk

    monkeypatch.setattr(files, "FORMATS", tuple(replace(known, open=counting(known.open)) for known in files.FORMATS))
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(cloud_files, "BLOCK", 16)
    options = Options(n_points=100, memory=10**9)
    with open_clouds([path], **query) as both:
        planned = make_plan(both, options)
        simplify_files(both, options, planned, Timer())
    assert planned.readings == (3 if query else 2)
    counted = sum(read)
    assert counted == pytest.approx(planned.readings * 20_000, rel=0.01)
