"""Each reader makes of damaged files a cloud or one of our errors, whatever bytes are damaged, and soon."""

import time
from functools import partial

import numpy as np
import pytest
import trimesh

import gppcs
from copc_file import write_copc
from formats import compressed_pcd
from gppcs.errors import GppcsError
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.joining import joined
from las_file import las_of, random_las, save

N = 60
AT_MOST = 5.0  # seconds for one read, on a busy machine: a header that lies must not cost time or memory
NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, *b"09-+.e \n,n")  # bytes at which counts and texts change their meaning


def cloud():
    rng = np.random.default_rng(0)
    attributes = {name: rng.integers(0, 256, N).astype(np.uint8) for name in ("red", "green", "blue")}
    points = np.float32(rng.uniform(-9, 9, (N, 3)))
    attributes |= {"intensity": rng.integers(0, 999, N).astype("u2"), "pair": np.float32(rng.random((N, 2)))}
    attributes["kind"] = np.array(["tree", "low plant"] * (N // 2))
    return gppcs.PointCloud(points, attributes)


def written(path, **options):
    gppcs.write(path, cloud(), lossy=True, **options)


def as_ptx(path):
    rows = [f"{x:.4f} {y:.4f} {z:.4f} 0.5 1 2 3\n" for x, y, z in cloud().points]
    missing = "0 0 0 0.5 0 0 0\n" * 6
    head = f"6\n{N // 12 + 1}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    poses = ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n")
    halves = rows[: N // 2], rows[N // 2 :]
    path.write_text("".join(head + pose + missing + "".join(half) for pose, half in zip(poses, halves, strict=True)))


def as_rich_las(path):
    """Points with waveforms, random bytes in every dimension, extra bytes and records before and after them."""
    las = random_las("1.4", 10, N, ["3u2"])
    las.evlrs[0].record_data = bytes(999)
    save(las, path)


def as_copc(path):
    write_copc(path, las_of(cloud().points, 7), 2, 1.0)


FACES = np.arange(N).reshape(-1, 3)


def as_mesh(path):
    gppcs.write_mesh(path, gppcs.Mesh(cloud().points, FACES), lossy=True)


def as_text_stl(path):
    trimesh.Trimesh(cloud().points, FACES, process=False).export(path, file_type="stl_ascii")


FILES = {
    "ply": (".ply", written),
    "ply ascii": (".ply", partial(written, ascii=True)),
    "las": (".las", written),
    "laz": (".laz", written),
    "rich las": (".las", as_rich_las),
    "rich laz": (".laz", as_rich_las),
    "copc": (".copc.laz", as_copc),
    "copc by index": (".copc.laz", as_copc),
    "pcd ascii": (".pcd", partial(written, ascii=True)),
    "pcd binary": (".pcd", written),
    "pcd compressed": (".pcd", lambda path: path.write_bytes(compressed_pcd(cloud().points))),
    "ptx": (".ptx", as_ptx),
    "e57": (".e57", written),
    "parquet": (".parquet", written),
    "feather": (".feather", written),
    "xyz": (".xyz", written),
    "csv": (".csv", written),
    "pts": (".pts", written),
    "npy": (".npy", written),
    "npz": (".npz", written),
    "obj": (".obj", as_mesh),
    "off": (".off", as_mesh),
    "stl": (".stl", as_mesh),
    "stl ascii": (".stl", as_text_stl),
    "ply mesh": (".ply", as_mesh),
    "glb": (".glb", as_mesh),
    "colmap": (".points3D.bin", written),
    "colmap text": (".points3D.txt", written),
    "gz": (".csv.gz", written),
}
PACKAGES = {".e57": "pye57", ".parquet": "pyarrow", ".feather": "pyarrow"}
QUERIES = {"copc by index": {"inside": [-9, -9, 9, 5], "resolution": 0.01}}


def damaged(content, rng):
    """Return a file with some bytes changed, left out, repeated or cut off, more often near its start or end."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        size = len(data)
        at = int(
            rng.choice([rng.integers(size), rng.integers(min(size, 400)), size - 1 - rng.integers(min(size, 100))])
        )
        length = int(rng.integers(1, 9))
        kind = rng.integers(6)
        if kind == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[at] = int(rng.choice(NUMBERS))
        elif kind == 2:
            data[at : at + length] = rng.bytes(length)
        elif kind == 3:
            del data[at : at + length]
        elif kind == 4:
            data[at:at] = data[at : at + length]
        elif at:
            del data[at:]
    return bytes(data)


def outcome(read):
    """Return coordinates and attributes as bytes, or that the file is refused."""
    try:
        found = read()
    except GppcsError:
        return "refused"
    columns = {name: (str(values.dtype), values.tolist()) for name, values in found.attributes.items()}
    return repr((found.points.tolist(), sorted(columns.items())))


def in_chunks(files):
    """Read files in chunks of seven points, as the work beyond memory does."""
    with files:
        chunks = list(files.chunks(7))
        return joined(chunks) if chunks else files.read()


def in_spans(files):
    """Read the parts of files that are read by different workers."""
    return joined(in_chunks(part) for part in files.parts(20))


def agree(path, seed):
    """Check that a file gives the same cloud, or is refused, as a whole, in chunks and in spans."""
    with CloudFiles([path]) as files, np.errstate(all="ignore"):
        whole = outcome(lambda: gppcs.read(path))
        assert outcome(lambda: in_chunks(files)) == whole, seed
        assert outcome(lambda: in_spans(files)) == whole, seed


@pytest.mark.parametrize("seeds", [range(25), pytest.param(range(1000, 1300), marks=pytest.mark.slow)], ids=str)
@pytest.mark.parametrize("name", FILES)
@pytest.mark.filterwarnings("ignore:Reading .* created on Python 2")
def test_damaged_files_give_a_cloud_or_our_error(name, tmp_path, seeds):
    suffix, make = FILES[name]
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])
    path = tmp_path / f"whole{suffix}"
    make(path)
    content = path.read_bytes()
    assert len(gppcs.read(path)) == N
    path = tmp_path / f"damaged{suffix}"
    refused = 0
    for seed in seeds:
        path.write_bytes(damaged(content, np.random.default_rng(seed)))
        start = time.monotonic()
        try:
            found = gppcs.open(path, **QUERIES.get(name, {})).read()
        except GppcsError as error:
            refused += 1
            assert str(path) in str(error), seed  # noqa: PT017 - either outcome is right
            assert "\n" not in str(error), seed  # noqa: PT017
            assert len(str(error)) < len(str(path)) + 500, seed  # noqa: PT017
        except BaseException as error:
            raise AssertionError(f"the damage of seed {seed} raised {error!r}") from error
        else:
            assert all(len(values) == len(found) for values in found.attributes.values()), seed
        assert time.monotonic() - start < AT_MOST, seed
        agree(path, seed)
    assert refused > 0
