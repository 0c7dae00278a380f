"""Vertices of OFF, OBJ and STL files."""

import json
import struct

import numpy as np
import pytest
import trimesh

import gppcs
from formats import glb, load
from gppcs.errors import FileFormatError
from gppcs.io import read

TRIANGLES = np.array([[[0, 0, 1], [1, 0, 0], [0, 2, 0]], [[1, 0, 0], [0, 2, 0], [-0.0, 0, 1]], [[5, 5, 5]] * 3])
CORNERS = [[0, 0, 1], [1, 0, 0], [0, 2, 0], [5, 5, 5]]


OBJ = "# made by hand\nmtllib a.mtl\nv 1 2 3{0}\nvn 0 0 1\nvt 0 0\n v\t4 5 6{0}\nf 1 2 1\n"


@pytest.mark.parametrize(
    ("suffix", "text", "names"),
    [
        (".off", "OFF\n2 1 0\n1 2 3\n4 5 6\n3 0 1 0\n", []),
        (".off", "OFF 2 1 0\n1 2 3\n4 5 6\n3 0 1 0\n", []),
        (".off", "OFF2 1 0\r\n1 2 3\r\n4 5 6\r\n3 0 1 0\r\n", []),
        (".off", "# made by hand\nOFF # so\n\n# counts\n2 0 0 # these\n1 2 3 # first\n\n# next\n4 5 6\n", []),
        (".off", "COFF\n2 0 0\n1 2 3 10 20 30\n4 5 6 11 21 31\n", ["red", "green", "blue"]),
        (".off", "COFF\n2 0 0\n1 2 3 1 2 3 255\n4 5 6 1 2 3 255\n", ["red", "green", "blue", "alpha"]),
        (".off", "NOFF\n2 0 0\n1 2 3 0 0 1\n4 5 6 0 1 0\n", ["nx", "ny", "nz"]),
        (".off", "CNOFF\n2 0 0\n1 2 3 0 0 1 9 9 9\n4 5 6 0 0 1 9 9 9\n", ["nx", "ny", "nz", "red", "green", "blue"]),
        (".off", "OFF\n2 0 0\n1 2 3 9\n4 5 6 9\n", ["column_4"]),
        (".obj", OBJ.format(""), []),
        (".obj", OBJ.format(" .1 .2 .3"), ["red", "green", "blue"]),
        (".obj", OBJ.format(" 1"), ["column_4"]),
    ],
)
def test_vertices_have_names_by_the_kind_of_the_file(file_of, suffix, text, names):
    cloud = read(file_of(suffix, text))
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.coordinate_dtype == np.float64
    assert list(cloud.attributes) == names
    if "red" in names and suffix == ".off":
        assert cloud.attributes["red"].dtype == np.int64


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        (".off", "COFF\n2 0 0\n1.0 2.0 3.0 10 20 30 255\n4.0 5.0 6.0 11 21 31 128\n"),
        (".off", "COFF\n2 0 0\n1.0 2.0 3.0 0.1 0.2 0.3 1.0\n4.0 5.0 6.0 0.0 0.0 1.0 0.5\n"),
        (".obj", "v 1.0 2.0 3.0 0.039216 0.078431 0.117647\nv 4.0 5.0 6.0 0.2 1.0 0.0\n"),
        (".obj", "v 1.0 2.0 3.0 0.12345 0.5 0.1\nv 4.0 5.0 6.0 0.2 1.0 0.0\n"),
    ],
)
def test_colours_and_alpha_are_written_back(file_of, tmp_path, suffix, text):
    cloud = read(file_of(suffix, text))
    gppcs.write(tmp_path / f"again{suffix}", cloud)
    assert (tmp_path / f"again{suffix}").read_text() == text


def text_stl():
    lines = ["solid part of something"]
    for triangle in TRIANGLES:
        lines += [" facet normal 0 0 1", "  outer loop"]
        lines += [f"   vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid part of something", ""])


def binary_stl(start=b"solid, though binary"):
    facets = b"".join(struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 0) for triangle in TRIANGLES)
    return start.ljust(80, b" ") + struct.pack("<I", len(TRIANGLES)) + facets


@pytest.mark.parametrize(("content", "dtype"), [(text_stl(), "f8"), (binary_stl(), "f4"), (binary_stl(b"a"), "f4")])
@pytest.mark.parametrize("suffix", [".stl", ".unknown"])
def test_stl_corners_come_once_in_order(file_of, content, dtype, suffix):
    cloud = read(file_of(suffix, content))
    assert cloud.points.tolist() == CORNERS
    assert cloud.coordinate_dtype == np.dtype(dtype)


MALFORMED = [
    (".off", "", "begins with OFF, COFF or NOFF, found ''"),
    (".off", "OFF\n3 0 0\n1 2 3\n4 5 6\n", "ends in vertex 3 of 3"),
    (".off", "OFF\n# so\n3 0 0\n1 2 3\n4 5\n7 8 9\n", "vertex 2: expected 3 columns, found '4 5'"),
    (".off", "OFF\n1 2 0\n1 2 3\n3 0 0 0\n", "ends in face 2 of 2"),
    (".off", "OFF\n1 1 0\n1 2 3\n3 0 0 1\n", "indices of vertices 0 to 0 in faces, found 0 to 1"),
    (".obj", "v 1 2 3\nf 1 1 1\nv 1 2\n", "vertex 2: expected 3 columns, found '1 2'"),
    (".obj", "v 1 2 3\nf 1 1 2\n", "indices of vertices 0 to 0 in faces, found 0 to 1"),
    (".obj", "v 1 2 3\nf 1 1 one\n", "faces of indices of vertices, but invalid literal"),
    (".obj", "<!DOCTYPE html>\n<p>404 Not Found</p>\n", "vertices of an OBJ file"),
    (".obj", "P 0.3 0.3 0.4 10 1 2\n -18 -16.85 2.5\n", "vertices of an OBJ file"),
    (".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n".encode("utf-16"), "vertices of an OBJ file"),
    (".stl", binary_stl(b"a")[:-1], "trimesh reports: "),
    (".stl", text_stl()[:200], "trimesh reports: "),
    (".stl", text_stl().replace("vertex 5", "vertex five"), "trimesh reports"),
]


@pytest.mark.parametrize(("suffix", "content", "message"), MALFORMED)
def test_malformed_files_tell_what_and_where(file_of, suffix, content, message):
    with pytest.raises(FileFormatError, match=message):
        gppcs.read_mesh(file_of(suffix, content))


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj", ".stl", ".stl_ascii", ".glb"])
def test_triangles_are_those_that_trimesh_reads(file_of, suffix):
    ball = trimesh.creation.icosphere(2)
    found = gppcs.read_mesh(file_of(suffix.removesuffix("_ascii"), ball.export(file_type=suffix[1:])))
    assert found.vertices[found.faces] == pytest.approx(np.asarray(ball.triangles), abs=1e-6)
    assert len(found.vertices) == len(ball.vertices)


def test_the_vertices_of_obj_files_are_those_of_the_file_whatever_their_faces_say(file_of):
    lines = "v 0 0 0\nv 9 9 9\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nvn 1 0 0\n"
    path = file_of(".obj", f"mtllib /etc/passwd\n{lines}usemtl a\nf 1/1/1 3/1/1 4/2/1\nf -4/2/2 -1/2/2 -2/1/2\n")
    found = gppcs.read_mesh(path)
    assert found.vertices.tolist() == [[0, 0, 0], [9, 9, 9], [1, 0, 0], [0, 1, 0]]
    assert found.faces.tolist() == [[0, 2, 3], [0, 3, 2]]


def test_obj_files_with_colours_at_some_vertices_are_read_without_them(file_of):
    path = file_of(".obj", "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0 1 0\nf 1 2 3\n")
    cloud, _, unread = load(path)
    assert cloud == gppcs.PointCloud([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert unread == ["colours, which only some vertices have (2 of 3)"]


@pytest.mark.parametrize("suffix", [".ply", ".stl_ascii", ".obj", ".off"])
def test_lines_may_end_in_carriage_returns_alone(file_of, suffix):
    ball = trimesh.creation.icosphere(1)
    content = ball.export(file_type=suffix[1:], **({"encoding": "ascii"} if suffix == ".ply" else {}))
    content = content if isinstance(content, bytes) else content.encode()
    path = file_of(suffix.removesuffix("_ascii"), content.replace(b"\n", b"\r"))
    assert len(gppcs.read_mesh(path).vertices) == len(ball.vertices)


def test_infinite_vertices_of_gltf_warn_of_nothing_and_a_scene_is_needed(file_of):
    ball = trimesh.creation.icosphere(1)
    ball.vertices *= np.float32(3e38)
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=np.diag([9.0, 9.0, 9.0, 1.0]))
    gppcs.read(file_of(".glb", scene.export(file_type="glb")))
    with pytest.raises(FileFormatError, match="a scene"):
        gppcs.read(file_of(".glb", glb(b'{"asset": {"version": "2.0"}}')))


def test_polygons_of_any_size_become_fans(file_of):
    faces = "2 0 1\n5 0 1 2 3 4\n3 2 1 0 255 0 0\n4 4 3 2 1\n"
    found = gppcs.read_mesh(file_of(".off", "OFF\n5 4 0\n0 0 0\n1 0 0\n2 1 0\n1 2 0\n0 1 0\n" + faces)).faces
    assert found.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [2, 1, 0], [4, 3, 2], [4, 2, 1]]
    with pytest.raises(FileFormatError, match="ends in face 4 of 4"):
        gppcs.read_mesh(file_of(".off", "OFF\n5 4 0\n" + "0 0 0\n" * 5 + faces[:-10]))


def test_what_a_gltf_file_has_beside_vertices_and_faces_is_named(file_of):
    ball = trimesh.creation.icosphere(1)
    ball.visual = trimesh.visual.TextureVisuals(uv=ball.vertices[:, :2])
    cloud, n_faces, unread = load(file_of(".glb", ball.export(file_type="glb", include_normals=True)))
    assert (len(cloud), n_faces) == (len(ball.vertices), len(ball.faces))
    assert unread == ["attribute NORMAL", "attribute TEXCOORD_0", "textures (1)"]


def triangle(**accessor):
    """Return the description of a glTF triangle and its coordinates, float32."""
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"} | accessor],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }, TRIANGLES[0].astype("<f4").tobytes()


def test_vertices_of_gltf_that_trimesh_would_make_up_are_refused(file_of):
    def read_triangle(accessor=(), **more):
        description, numbers = triangle(**dict(accessor))
        return read(file_of(".glb", glb(json.dumps(description | more).encode(), numbers)))

    assert read_triangle().points.tolist() == [[0, 0, 1], [1, 0, 0], [0, 2, 0]]
    assert len(read_triangle(extensionsRequired=["KHR_texture_transform"])) == 3  # which says nothing of vertices
    with pytest.raises(FileFormatError, match="without KHR_draco_mesh_compression"):
        read_triangle(extensionsRequired=["KHR_draco_mesh_compression"])
    for accessor in ({"sparse": {"count": 1}}, {"normalized": True, "componentType": 5122}):
        with pytest.raises(FileFormatError, match="sparse or normalized"):
            read_triangle(accessor)
    with pytest.raises(FileFormatError, match="version 2 of glTF, found 1"):
        read(file_of(".glb", b"glTF" + struct.pack("<5I", 1, 20, 0, 0, 0)))


def test_alpha_of_gltf_is_read_and_points_and_lines_are_named(file_of):
    ball = trimesh.creation.icosphere(1)
    ball.visual.vertex_colors = np.random.default_rng(0).integers(0, 256, (len(ball.vertices), 4))
    scene = trimesh.Scene([ball, trimesh.PointCloud(ball.vertices)])
    cloud, _, unread = load(file_of(".glb", scene.export(file_type="glb")))
    assert unread == ["points, lines or fans (1)"]
    colours = [cloud.attributes[name] for name in ("red", "green", "blue", "alpha")]
    assert np.array_equal(np.transpose(colours), ball.visual.vertex_colors)
    with pytest.raises(FileFormatError, match="found points, lines or fans alone"):
        read(file_of(".glb", trimesh.Scene(trimesh.PointCloud(ball.vertices)).export(file_type="glb")))


@pytest.mark.parametrize("dtype", ["<u2", "<f4"])
def test_linear_colours_of_gltf_are_read_as_srgb(file_of, dtype):
    description, numbers = triangle()
    light = np.array([[0, 0.318547, 1, 1], [0.001518, 0.050876, 0.603827, 0.5], [0.5, 0.5, 0.5, 0]])
    colours = light.astype(dtype) if dtype == "<f4" else np.round(65535 * light).astype(dtype)
    kind = {"componentType": 5126} if dtype == "<f4" else {"componentType": 5123, "normalized": True}
    description["accessors"].append({"bufferView": 1, "count": 3, "type": "VEC4"} | kind)
    description["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 1
    description["bufferViews"].append({"buffer": 0, "byteOffset": 36, "byteLength": colours.nbytes})
    description["buffers"][0]["byteLength"] += colours.nbytes
    found = read(file_of(".glb", glb(json.dumps(description).encode(), numbers + colours.tobytes())))
    srgb = [[0, 0.6, 1, 1], [0.019608, 0.25, 0.8, 0.5], [0.735357, 0.735357, 0.735357, 0]]  # by IEC 61966-2-1
    columns = [found.attributes[name] for name in ("red", "green", "blue", "alpha")]
    assert np.array_equal(np.transpose(columns), np.round(255 * np.array(srgb)))


def test_normals_of_stl_that_are_no_numbers_print_nothing(file_of, capfd):
    read(file_of(".stl", text_stl().replace("normal 0", "normal q")))
    assert capfd.readouterr() == ("", "")
