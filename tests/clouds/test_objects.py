"""Objects of other libraries become clouds with all that they hold, and clouds become such objects again."""

import re
import sys
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas
import pytest

import gppcs
from gppcs import InputError, PointCloud
from gppcs.errors import MissingExtraError
from gppcs.io import to_laspy
from optional import import_or_skip

N = 7


def _drawn(shape, dtype=np.float64, seed=0):
    """Random numbers; whole ones below 256 if the type is an integer type."""
    random = np.random.default_rng([seed, *shape])
    if np.issubdtype(dtype, np.integer):
        return random.integers(0, 256, shape, dtype=dtype)
    return random.standard_normal(shape).astype(dtype)


POINTS = _drawn((N, 3)) + 4e6  # float32 could not hold them
SINGLE = _drawn((N, 3), np.float32, 1)
COLOURS = _drawn((N, 4), np.uint8)
NORMALS = _drawn((N, 3), np.float32, 2)
VALUES = {
    "intensity": np.arange(N, dtype=np.uint16),
    "time": np.linspace(1e9, 1e9 + 1, N),
    "flag": np.arange(N) % 2 == 0,
    "class": np.arange(N, dtype=np.int8),
    "offset": _drawn((N, 2), np.float32),
    "row": 2**63 + np.arange(N, dtype=np.uint64),
}
NAMED = {
    **dict(zip(("nx", "ny", "nz"), NORMALS.T, strict=True)),
    **dict(zip(("red", "green", "blue"), COLOURS[:, :3].T, strict=True)),
}
CLOUD = PointCloud(POINTS, {**VALUES, **NAMED})
METHODS = {"open3d": "to_open3d", "pyvista": "to_pyvista", "trimesh": "to_trimesh", "pandas": "to_pandas"}
FLAT = {name for name in VALUES if name != "offset"}


# There and back


@pytest.mark.parametrize("library", METHODS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_cloud_comes_back_from_each_library(library, dtype):
    import_or_skip(library)
    attributes = {**VALUES, **NAMED, "alpha": COLOURS[:, 3]}
    if library == "pandas":
        attributes.pop("offset")
    kept = np.float64 if library == "trimesh" else dtype
    made = getattr(PointCloud(SINGLE, attributes, dtype), METHODS[library])()
    again, cloud = PointCloud.from_object(made), PointCloud(SINGLE, attributes, kept)
    assert again == cloud
    assert type(made).__module__.split(".")[0] == library
    for name, values in attributes.items():
        assert name == "alpha" or not np.shares_memory(again.attributes[name], values)


@pytest.mark.parametrize("library", METHODS)
def test_a_cloud_without_points_and_another_byte_order_come_back(library):
    import_or_skip(library)
    for count in (0, N):
        cloud = PointCloud(POINTS[:count], {"label": np.arange(count, dtype=">i4")})
        again = PointCloud.from_object(getattr(cloud, METHODS[library])())
        np.testing.assert_array_equal(again.points, cloud.points)
        for values in again.attributes.values():  # of no points, a library may hold none
            assert values.tolist() == list(range(count))
            assert values.dtype.newbyteorder("=") == np.int32


# PyVista


def test_data_sets_of_pyvista_come_in_with_their_arrays_and_types():
    pyvista = pytest.importorskip("pyvista")
    makers = [pyvista.PolyData, pyvista.PointSet, lambda points: pyvista.PolyData(points).cast_to_unstructured_grid()]
    for points in (POINTS, SINGLE):
        for make in makers:
            data = make(points)
            for name, values in {**VALUES, "RGB": COLOURS[:, :3], "Normals": NORMALS}.items():
                data.point_data[name] = values
            assert PointCloud.from_object(data) == PointCloud(points, {**VALUES, **NAMED}, points.dtype)


# trimesh


def test_meshes_of_trimesh_come_in_with_stored_normals_only():
    trimesh = pytest.importorskip("trimesh")
    faces = [[0, 1, 2], [2, 3, 4], [4, 5, 6]]
    mesh = trimesh.Trimesh(POINTS, faces, process=False, vertex_attributes={"label": np.arange(N)})
    assert PointCloud.from_object(mesh).attributes.keys() == {"label"}
    unit = NORMALS.astype(float) / np.linalg.norm(NORMALS.astype(float), axis=1, keepdims=True)
    mesh = trimesh.Trimesh(POINTS, faces, process=False, vertex_normals=unit, vertex_colors=COLOURS)
    cloud = PointCloud.from_object(mesh)
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.normals(), mesh.vertex_normals)
    np.testing.assert_array_equal(cloud.attributes["alpha"], COLOURS[:, 3])
    mesh = trimesh.Trimesh(POINTS, faces[:2], process=False, face_colors=COLOURS[:2])
    assert not PointCloud.from_object(mesh).attributes  # colours of faces are none of vertices


# pandas and structured arrays


@pytest.mark.parametrize("axes", ["xyz", "XYZ", "xyZ"])
def test_tables_of_pandas_come_in_by_the_names_of_their_columns(axes):
    columns = dict(zip(axes, SINGLE.T, strict=True))
    attributes = {name: VALUES[name] for name in FLAT}
    expected = PointCloud(SINGLE, attributes, np.float32)
    assert PointCloud.from_object(pandas.DataFrame({**attributes, **columns})) == expected


TABLE = pandas.DataFrame({axis: [0.0, 1.0] for axis in "xyz"})


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (TABLE.assign(place=[None, object()]), "expected numbers in column 'place', found text or objects"),
        (TABLE.assign(z=["a", "b"]), "expected numbers as coordinates, found <U1 in z"),
        (TABLE.assign(z=[2**60, 1]), r"expected coordinates below 2\^53, found larger ones in z"),
        (TABLE.join(pandas.Series([1, 2], name=7)), "expected attributes by name"),
        (TABLE[["x", "y"]], "expected x, y and z for each point, found 'x', 'y'; rename"),
        (TABLE[["x", "y", "z", "x"]], "columns of different names, found 'x' twice"),
        (TABLE.assign(count=pandas.array([1, None], dtype="Int16")),
         "a number for each point in column 'count', found missing values"),
    ],
)  # fmt: skip
def test_columns_that_cannot_be_used_are_named(table, message):
    with pytest.raises(InputError, match=message):
        PointCloud.from_object(table)


def test_structured_arrays_come_in_as_npy_files_do(tmp_path):
    fields = [("x", ">f4"), ("y", ">f4"), ("z", ">f4"), *((name, v.dtype, v.shape[1:]) for name, v in VALUES.items())]
    table = np.zeros(N, fields)
    for name, values in [*zip("xyz", SINGLE.T, strict=True), *VALUES.items()]:
        table[name] = values
    np.save(tmp_path / "table.npy", table)
    assert PointCloud.from_object(table) == PointCloud(SINGLE, VALUES, np.float32)
    assert PointCloud.from_object(table) == gppcs.read(tmp_path / "table.npy")
    with pytest.raises(InputError, match=r"a structured array of shape \(N,\), found \(7, 1\)"):
        PointCloud.from_object(table[:, None])
    with pytest.raises(InputError, match="expected x, y and z for each point, found 'x', 'row'"):
        PointCloud.from_object(table[["x", "row"]])


# Arrow and tensors


def test_tables_of_arrow_come_in_by_the_names_of_their_columns():
    pyarrow = pytest.importorskip("pyarrow")
    kinds = np.array(["tree", "wire", "tree", "house", "", "wire", "tree"])
    columns = {"z": SINGLE[:, 2], **{name: VALUES[name] for name in FLAT}, "x": SINGLE[:, 0], "y": SINGLE[:, 1]}
    table = pyarrow.table(columns).append_column("kind", pyarrow.array(kinds.tolist()).dictionary_encode())
    expected = PointCloud(SINGLE, {**{name: VALUES[name] for name in FLAT}, "kind": kinds}, np.float32)
    for made in (table, table.to_batches()[0]):
        assert PointCloud.from_object(made) == expected
    with pytest.raises(InputError, match="'offset'"):
        PointCloud.from_object(table.append_column("offset", pyarrow.array([[1, 2]] * N)))


class Exporter:
    """A tensor that other libraries can take by DLPack alone."""

    def __init__(self, values, device=(1, 0)):
        self.values, self.device = values, device

    def __dlpack_device__(self):
        return self.device

    def __dlpack__(self, **options):
        if self.device != (1, 0):
            raise BufferError("the tensor is on a GPU")
        return self.values.__dlpack__(**options)


class Numpy(Exporter):
    """A tensor that NumPy also takes by itself, as those of PyTorch."""

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype)


@pytest.mark.parametrize("kind", [Exporter, Numpy])
def test_tensors_come_in_and_go_out_without_a_copy(kind):
    cloud = PointCloud(kind(POINTS), {"label": kind(VALUES["class"])})
    assert PointCloud.from_object(kind(POINTS)) == PointCloud(POINTS)
    assert np.shares_memory(PointCloud.from_object(kind(POINTS)).points, POINTS)
    assert np.shares_memory(cloud.attributes["label"], VALUES["class"])
    assert np.shares_memory(np.from_dlpack(cloud.points), POINTS)
    assert PointCloud.from_object(kind(SINGLE)) == PointCloud(SINGLE, coordinate_dtype=np.float32)
    result = gppcs.simplify(kind(POINTS), n_points=3, method="fps")
    assert np.array_equal(result.points, POINTS[result.indices])
    with pytest.raises(InputError, match="the tensor is on a GPU"):
        PointCloud.from_object(Exporter(POINTS, device=(2, 0)))


# laspy


def test_data_of_laspy_come_in_with_all_dimensions():
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.01, 0.01, 0.001], [4e6, 4e6, 4e6]
    header.add_extra_dim(laspy.ExtraBytesParams("echo", np.float32))
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.intensity, data.classification, data.gps_time = VALUES["intensity"], np.arange(N), VALUES["time"]
    data.red, data.echo = VALUES["intensity"], NORMALS[:, 0]
    data.return_number, data.scan_angle = np.arange(N) % 3, np.arange(N) - 3
    cloud = PointCloud.from_object(data)
    np.testing.assert_array_equal(cloud.points, data.xyz)
    assert set(cloud.attributes) == set(data.point_format.dimension_names) - {"X", "Y", "Z"}
    for name, values in cloud.attributes.items():
        np.testing.assert_array_equal(values, data[name])
        assert type(values) is np.ndarray
    types = {"intensity": "u2", "gps_time": "f8", "red": "u2", "echo": "f4", "return_number": "u1", "scan_angle": "i2"}
    assert {name: cloud.attributes[name].dtype for name in types} == types


def test_a_scan_becomes_data_of_laspy_with_its_header(shared_data):
    laspy = pytest.importorskip("laspy")
    path = shared_data / "autzen_airborne.laz"
    scan, expected = gppcs.read(path), laspy.read(path)
    rows = np.arange(0, len(scan), 7)
    made = to_laspy(scan.take(rows))
    assert type(made) is laspy.LasData
    assert made.points.array.tobytes() == expected.points.array[rows].tobytes()
    kept = [vlr.record_data_bytes() for vlr in expected.header.vlrs if vlr.user_id != "laszip encoded"]
    assert [vlr.record_data_bytes() for vlr in made.header.vlrs] == kept
    assert (made.header.scales == expected.header.scales).all()
    back = PointCloud.from_object(made)
    assert back.points.tobytes() == scan.points[rows].tobytes()
    assert all((back.attributes[name] == values[rows]).all() for name, values in scan.attributes.items())


# Open3D, and something that looks like it


@pytest.fixture(params=["stand-in", "open3d"])
def classes(request):
    """Makers of a legacy point cloud and of one of tensors."""
    if request.param == "stand-in":  # with what gppcs uses of these
        stand_in = type("PointCloud", (SimpleNamespace,), {"__module__": "open3d.geometry"})

        def tensor(values):
            return SimpleNamespace(cpu=lambda: SimpleNamespace(numpy=lambda: values))

        legacy = partial(stand_in, colors=(), normals=(), covariances=())
        return (
            lambda points, **arrays: legacy(points=points, **arrays),
            lambda **arrays: stand_in(point={name: tensor(values) for name, values in arrays.items()}),
        )
    o3d = import_or_skip("open3d")

    def legacy(points, **arrays):
        cloud = o3d.geometry.PointCloud()
        cloud.points = o3d.utility.Vector3dVector(points)
        for name, values in arrays.items():
            holder = o3d.utility.Matrix3dVector if values.ndim == 3 else o3d.utility.Vector3dVector
            setattr(cloud, name, holder(values))
        return cloud

    def tensors(**arrays):
        cloud = o3d.t.geometry.PointCloud()
        for name, values in arrays.items():
            cloud.point[name] = o3d.core.Tensor(np.ascontiguousarray(values))
        return cloud

    return legacy, tensors


def test_legacy_clouds_of_open3d_come_in_with_colours_and_normals(classes):
    legacy, _ = classes
    colours, normals = COLOURS[:, :3] / 255, NORMALS.astype(np.float64)
    names = ("red", "green", "blue", "nx", "ny", "nz")
    expected = dict(zip(names, [*colours.T, *normals.T], strict=True))
    assert PointCloud.from_object(legacy(POINTS)) == PointCloud(POINTS)
    given = legacy(POINTS, colors=colours, normals=normals, covariances=np.stack([np.eye(3)] * N))
    assert PointCloud.from_object(given) == PointCloud(POINTS, {**expected, "covariances": np.stack([np.eye(3)] * N)})


def test_tensors_of_open3d_come_in_with_their_types(classes):
    _, tensors = classes
    arrays = {name: values if values.ndim == 2 else values[:, None] for name, values in VALUES.items()}
    given = tensors(positions=SINGLE, normals=NORMALS, colors=COLOURS[:, :3], **arrays)
    assert PointCloud.from_object(given) == PointCloud(SINGLE, {**VALUES, **NAMED}, np.float32)


# Errors


@pytest.mark.parametrize(
    ("library", "name", "values", "message"),
    [
        *(
            (library, "odd", np.zeros(N, dtype), re.escape(f"found {np.dtype(dtype)} in attribute 'odd'"))
            for library in ("open3d", "pyvista")
            for dtype in ("f2", "M8[s]", "U3")
        ),
        ("open3d", "positions", POINTS, "other names than 'positions'"),
        ("pandas", "x", np.zeros(N), "found 'x' twice; rename the attribute"),
    ],
)
def test_attributes_that_a_library_cannot_hold_are_named(library, name, values, message):
    import_or_skip(library)
    with pytest.raises(InputError, match=message):
        getattr(PointCloud(POINTS, {name: values}), f"to_{library}")()


@pytest.mark.parametrize("library", ["open3d", "pyvista"])
def test_a_missing_library_is_named_with_the_package_to_install(library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=f"which is not installed: pip install {library}$"):
        getattr(CLOUD, METHODS[library])()


class Opaque:
    """An object of no library that gppcs knows."""


class Awkward(Opaque):
    """An object that NumPy takes for a sequence, and that is none."""

    def __len__(self):
        return 3

    def __getitem__(self, row):
        raise KeyError(row)


@pytest.mark.parametrize(("made", "end"), [(Opaque, ""), (Awkward, r".*")])
def test_unknown_objects_are_named_with_what_was_expected(made, end):
    expected = r"^expected a PointCloud, an object of [\w, ]* or laspy, or an \(N, 3\) array of coordinates"
    with pytest.raises(InputError, match=rf"{expected}, found \S*\.{made.__name__}{end}$"):
        gppcs.info(made())


# Everywhere


@pytest.mark.parametrize("kind", ["path", "text", "pandas", "pyvista"])
def test_all_functions_take_objects_and_those_above_io_paths(kind, tmp_path):
    if kind in METHODS:
        pytest.importorskip(kind)
    scan, file = gppcs.sample("bracket", n_points=300), tmp_path / "scan.ply"
    gppcs.write(file, scan)
    given = getattr(scan, METHODS[kind])() if kind in METHODS else {"path": file, "text": str(file)}[kind]
    kept = gppcs.simplify(scan, n_points=50)
    assert gppcs.simplify(given, n_points=50).cloud == kept.cloud
    assert gppcs.evaluate(given, kept) == gppcs.evaluate(scan, kept.cloud)
    assert gppcs.evaluate(scan, given).covering_radius == 0
    assert gppcs.compare(given, ["gp"], n_points=50)[0].result.cloud == kept.cloud
    gppcs.write(tmp_path / "again.ply", given)
    assert gppcs.read(tmp_path / "again.ply") == scan
    assert gppcs.info(given).points == 300
    if kind not in METHODS:
        with pytest.raises(InputError, match=r"found the path .*; read the file with gppcs\.read first"):
            gppcs.estimate_features(given)
        return
    np.testing.assert_array_equal(gppcs.estimate_normals(given, at=given), gppcs.estimate_normals(scan))
    assert gppcs.estimate_features(given) == gppcs.estimate_features(scan)
