"""Files in chunks and in parts, several files as one cloud, and each opened once."""

import gzip
import os
import zipfile
from dataclasses import replace
from functools import partial

import laspy
import lazrs
import numpy as np
import pytest

import gppcs
from copc_file import write_copc
from formats import compressed_pcd
from gppcs.amounts.options import Options
from gppcs.engine.timer import Timer
from gppcs.errors import FileFormatError
from gppcs.io import CloudFiles, cloud_files, files
from gppcs.io.format import Reader
from gppcs.io.joining import joined
from gppcs.simplification import simplify_files
from gppcs.streaming.plan import make_plan
from las_file import las_of

N = 1000
IN_CHUNKS = [".csv", ".feather", ".las", ".laz", ".copc.laz", ".npy", ".parquet", ".pcd", ".ply", ".pts"]
LARGE = 120_000  # more than two chunks of a LAZ file


def cloud(seed=0):
    rng = np.random.default_rng(seed)
    attributes = {"intensity": rng.integers(-9, 9, N), "red": rng.integers(0, 255, N).astype(np.uint8)}
    return gppcs.PointCloud(rng.random((N, 3)).astype(np.float32), attributes, np.dtype(np.float32))


def all_of(part):
    with part:
        return joined(part.chunks(n=40_000))


@pytest.fixture(scope="module")
def divisible(tmp_path_factory):
    """Files that can be read from the middle, by their names."""
    folder = tmp_path_factory.mktemp("divisible")
    las = las_of(np.random.default_rng(0).uniform(0, 99, (LARGE, 3)), gps_time=np.arange(LARGE))
    las.write(folder / "a.las")
    las.write(folder / "a.laz")
    write_copc(folder / "a.copc.laz", las[:3000], 4, 8.0)
    for name in ("a.ply", "a.npy", "a.pcd"):
        gppcs.write(folder / name, cloud())
    return folder


@pytest.mark.parametrize("suffix", IN_CHUNKS)
def test_the_chunks_of_a_file_are_what_read_returns(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    gppcs.write(path, cloud(), lossy=True)  # LAS rounds
    whole = gppcs.read(path)
    with CloudFiles([path]) as clouds:
        assert clouds.n_points == pytest.approx(N, rel=0.02)
        for n in (7, 999, 1000, 10**7):
            chunks = list(clouds.chunks(n=n))
            assert [len(chunk) for chunk in chunks] == [min(n, N - start) for start in range(0, N, n)]
            assert joined(chunks) == whole
        assert clouds.read() == whole


@pytest.mark.parametrize("suffix", [".ply", ".npz", ".xyz.gz"])
def test_files_of_one_cloud_are_that_cloud(tmp_path, suffix):
    paths = [tmp_path / f"{i}{suffix}" for i in range(3)]
    for path, indices in zip(paths, np.split(np.arange(N), [1, 400]), strict=True):
        gppcs.write(path, cloud().take(indices))
    with CloudFiles(paths) as clouds:
        assert np.array_equal(clouds.read().points.astype(np.float32), cloud().points)
        assert joined(clouds.chunks(n=300)) == clouds.read()


def test_columns_that_are_whole_in_some_parts_only_are_fractions_in_all(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,k\n0,0,0,1\n")
    (tmp_path / "b.csv").write_text("x,y,z,k\n0,0,0.5,1.5\n")
    with CloudFiles([tmp_path / "a.csv", tmp_path / "b.csv"]) as clouds:
        both = clouds.read()
        assert joined(clouds.chunks(n=1)) == both
    assert both.attributes["k"].tolist() == [1.0, 1.5]


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.zeros(1), None, "same attributes in all files of a cloud, found k as .* and nothing"),
        (np.array([2**53 + 1]), np.array([0.5]), "values of k that int64, uint64 or float64 holds exactly"),
        (np.zeros((1, 2)), np.zeros(1), "found k as 2 numbers in the first and numbers in"),
        (np.zeros(1), np.array(["x"]), "found k as .*numbers.* and .*text"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path, a, b, message):
    for name, values in (("a", a), ("b", b)):
        attributes = {} if values is None else {"k": values}
        gppcs.write(tmp_path / f"{name}.npy", gppcs.PointCloud(np.zeros((1, 3)), attributes))
    with CloudFiles([tmp_path / "a.npy", tmp_path / "b.npy"]) as clouds, pytest.raises(FileFormatError, match=message):
        clouds.read()


@pytest.mark.parametrize(
    ("name", "n", "begins"),
    [
        ("a.las", 50_000, [0, 65_536]),
        ("a.las", LARGE, [0]),
        ("a.laz", 1, [0, 50_000, 100_000]),
        ("a.laz", 50_001, [0, 100_000]),
        ("a.laz", 100_001, [0]),
        ("a.copc.laz", 500, None),  # chunks of COPC files differ in size
        ("a.ply", 300, [0, 300, 600]),
        ("a.npy", 300, [0, 300, 600]),
        ("a.pcd", 300, [0, 300, 600]),
    ],
)
def test_the_parts_of_a_file_are_the_file(divisible, name, n, begins):
    whole = gppcs.read(divisible / name)
    with CloudFiles([divisible / name]) as clouds:
        assert (clouds.n_points, clouds.is_counted) == (len(whole), True)
        parts = list(map(all_of, clouds.parts(n)))
    counts = list(map(len, parts))
    assert min(counts[:-1], default=n) >= min(n, len(whole))
    assert begins is None or np.cumsum([0, *counts[:-1]]).tolist() == begins
    assert len(parts) > 1 or begins == [0]
    assert joined(parts) == whole


def test_what_can_only_be_read_from_its_start_is_one_part(divisible, tmp_path):
    (tmp_path / "a.las.gz").write_bytes(gzip.compress((divisible / "a.las").read_bytes(), 1))
    gppcs.write(tmp_path / "a.ply", cloud(), ascii=True)
    for path, inside in ((tmp_path / "a.las.gz", None), (tmp_path / "a.ply", None), (divisible / "a.las", "0,0,9,9")):
        with CloudFiles([path], inside=inside) as clouds:
            [part] = clouds.parts(100)
            assert len(all_of(part)) == len(clouds.read())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.las", r"a\.las: the file ends in point 120001 of 1152921504606846976"),
        ("a.laz", r"a\.laz: expected all compressed points within the file, found fewer"),
        ("a.ply", "the file ends"),
        ("a.npy", "numpy reports: mmap length is greater than file size"),
    ],
)
def test_a_damaged_file_has_no_parts(divisible, tmp_path, name, message):
    content = bytearray((divisible / name).read_bytes())
    if name in ("a.las", "a.laz"):
        content[247:255] = (2**60).to_bytes(8, "little")
    else:
        del content[-1:]
    (tmp_path / name).write_bytes(content)
    with CloudFiles([tmp_path / name]) as clouds, pytest.raises(FileFormatError, match=message):
        all_of(clouds.parts(1_000)[0])


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".feather", ".parquet", ".laz", ".ptx"])
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
    monkeypatch.setattr(Reader, "read", None)
    with pytest.raises(gppcs.InputError, match="of memory"):
        gppcs.simplify(path, ratio=0.01, method="hc", memory="15MB")


@pytest.mark.parametrize("suffix", [".npz", ".pcd", ".e57", ".parquet", ".feather"])
def test_what_a_file_unpacks_to_is_compared_with_the_memory_first(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".pcd":
        path.write_bytes(compressed_pcd(np.zeros((50_000, 3))))
    elif suffix == ".npz":
        np.savez_compressed(path, points=np.zeros((10, 3)), other=np.zeros((10, 10_000)))
    else:
        gppcs.write(path, np.zeros((50_000, 3)))
    assert len(gppcs.read(path)) in (10, 50_000)
    monkeypatch.setattr(Reader, "read", None)
    monkeypatch.setattr(cloud_files, "available_memory", lambda: 500_000)
    with pytest.raises(FileFormatError, match=r"a\.\w+: expected .* of free memory"):
        gppcs.read(path)


@pytest.mark.parametrize("suffix", [".xyz.gz", ".npz", ".laz", ".parquet", ".feather"])
def test_small_files_that_unpack_to_far_more_are_refused_at_once(tmp_path, suffix):
    path, n = tmp_path / f"a{suffix}", 16_000_000
    if suffix == ".xyz.gz":
        path.write_bytes(gzip.compress(b"0 0 0\n" * 6_000_000))
    elif suffix == ".npz":
        np.savez_compressed(path, points=np.zeros((n // 64, 3)))
        with zipfile.ZipFile(path, "a") as archive:
            archive.infolist()[0].file_size *= 64
            archive.writestr("other.npy", b"")  # so that the directory of the archive is written anew
    elif suffix == ".laz":
        gppcs.write(path, np.zeros((50_000, 3)))  # one chunk, which is repeated
        with path.open("r+b") as file:
            las = laspy.LasHeader.read_from(file)
            start, laszip = las.offset_to_point_data, lazrs.LazVlr(las.vlrs.get("LasZipVlr")[0].record_data)
            [(_, size)] = lazrs.read_chunk_table(file, laszip)
            file.seek(start + 8)
            chunk = file.read(size)
            file.seek(start)
            file.write((start + 8 + n // 50_000 * size).to_bytes(8, "little") + chunk * (n // 50_000))
            lazrs.write_chunk_table(file, [(50_000, size)] * (n // 50_000), laszip)
            file.seek(107)
            file.write(n.to_bytes(4, "little"))
    else:
        pyarrow = pytest.importorskip("pyarrow")
        parquet, ipc = pytest.importorskip("pyarrow.parquet"), pyarrow.ipc
        table = pyarrow.table(dict.fromkeys("xyz", np.zeros(n // 64)))
        options = ipc.IpcWriteOptions(compression="zstd")
        writer = parquet.ParquetWriter if suffix == ".parquet" else partial(ipc.new_file, options=options)
        with writer(str(path), table.schema) as file:
            for _ in range(64):
                file.write_table(table)
    with pytest.raises(FileFormatError, match=rf"a\{suffix}: .* 100 times"):
        gppcs.read(path)


@pytest.mark.parametrize("query", [{}, {"inside": [0, 0, 50, 50]}, {"only": "intensity > 3"}])
@pytest.mark.parametrize("suffix", [".las", ".ply"])
def test_files_are_read_as_often_as_the_plan_says(tmp_path, monkeypatch, query, suffix):
    """To count the points that a query leaves takes a reading, too."""
    counts = []

    def counting(file_format):
        def opened(file, **options):
            reader = file_format.open(file, **options)

            def chunks(*given, **more):
                for chunk in reader.chunks(*given, **more):
                    counts.append(len(chunk))
                    yield chunk

            return replace(reader, chunks=chunks)

        return replace(file_format, open=opened)

    monkeypatch.setattr(files, "FORMATS", tuple(map(counting, files.FORMATS)))
    points = gppcs.sample("bracket", 20_000).points
    path = tmp_path / f"a{suffix}"
    gppcs.write(path, gppcs.PointCloud(points, {"intensity": np.arange(20_000) % 9}), lossy=True)
    monkeypatch.setattr(gppcs.LocalGP, "memory", lambda self, n, n_points: 10**12)
    monkeypatch.setattr(cloud_files, "BLOCK", 16)
    options = Options(n_points=100, memory=10**9)
    with CloudFiles([path], **query) as clouds:
        plan = make_plan(clouds, options)
        simplify_files(clouds, options, plan, Timer())
    assert plan.readings == (4 if query else 3)
    assert sum(counts) == pytest.approx(plan.readings * 20_000, rel=0.01)


def test_a_part_of_a_compressed_file_reads_the_copy_of_the_whole(tmp_path):
    path = tmp_path / "cloud.ply.gz"
    gppcs.write(path, gppcs.sample("sphere", 100))
    with CloudFiles([path]) as files:
        (part,) = files.parts(10)
        path.unlink()
        for _ in range(2):  # the second reading, too
            with part:
                assert len(part.read()) == 100


def test_a_polygon_of_many_corners_is_told_from_one_that_differs_in_a_corner(tmp_path):
    angles = np.linspace(0, 6.28, 700)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    described = [CloudFiles(tmp_path / "a.ply", inside=polygon).described for polygon in (ring, ring.copy(), 2 * ring)]
    ring[350] *= 1.5
    assert described[0] == described[1] != described[2]
    assert CloudFiles(tmp_path / "a.ply", inside=ring).described not in described


def test_compressed_files_beyond_a_limit_are_closed_and_opened_again(tmp_path):
    resource = pytest.importorskip("resource")
    paths = [tmp_path / f"{number}.xyz.gz" for number in range(100)]
    for number, path in enumerate(paths):
        path.write_bytes(gzip.compress(b"0 0 %d\n" % number))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 80, hard))
    try:
        with CloudFiles(paths) as files:
            parts = list(map(all_of, files.parts(10)))
            whole = files.read()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert whole.points[:, 2].tolist() == list(range(100))
    assert joined(parts) == whole


def test_files_that_are_opened_are_not_opened_again(tmp_path):
    gppcs.write(tmp_path / "a.ply", gppcs.sample("sphere", n_points=100))
    with pytest.raises(gppcs.ParameterError, match="names of files"):
        gppcs.open(gppcs.open(tmp_path / "a.ply"), only="z > 0")
