"""Reads and writes OFF and OBJ files, and by trimesh STL and binary glTF files: vertices, and faces as triangles.

OFF and OBJ files are read here, because trimesh has no colours and normals of OFF, and repeats the vertices of an OBJ
file along the seams of its texture.
"""

import json
import logging
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from io import BufferedReader, BytesIO
from itertools import islice, starmap
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.colours import eight_bits, fit_eight_bits, from_linear, full_scale, linear
from gppcs.clouds.columns import COLOUR, Column
from gppcs.clouds.mesh import Texture
from gppcs.errors import FileFormatError, number, shown
from gppcs.io.columns import coordinate_type, default_names, with_digits
from gppcs.io.format import Format, Reader, begins, keeping
from gppcs.io.rows import as_count, ends_early, is_row, lines_of, read_table, reported, shortened, write_rows

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints tracebacks for damaged files

GENERATOR = "gppcs"  # of glTF files whose node turns y up
METRES = "metresPerUnit"  # of the axes of the file from which it was made
BYTES = 5121  # type of colours of glTF that count as sRGB, as many programs write them; others are linear, as specified
LIGHT = "_LIGHT0"  # replaces COLOR_0, of which trimesh reads and writes but bytes
Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
NO_FACES = np.empty((0, 3), dtype=np.int64)
Faces = NDArray[np.int64]
_TRIANGLES = (4, 5)  # modes of glTF: triangles, and strips of these
# Extensions of glTF that do not change where vertices are, and one that only allows whole numbers as coordinates.
_WITHOUT_GEOMETRY = re.compile("KHR_(materials|texture|lights)_|EXT_texture_|KHR_mesh_quantization")


def _reader(cloud: PointCloud, n_faces: int, triangles: Callable[[], Faces], skipped: list[str]) -> Reader:
    """Return a reader of vertices that are in memory."""
    return Reader(lambda n: iter([cloud]), len(cloud), True, n_faces, skipped, triangles=triangles)


def open_off(file: BufferedReader) -> Reader:
    """Open an OFF file, of normals and colours (NOFF, COFF, CNOFF) too."""
    lines = (text for line in lines_of(file) if (text := line.partition("#")[0].strip()))
    first = next(lines, "")
    header = re.match(r"(C)?(N)?OFF(?![A-Za-z])(.*)", first)
    if header is None or "BINARY" in first:
        raise FileFormatError(f"expected a text file that begins with OFF, COFF or NOFF, found {shortened(first)}")
    text = header[3].strip() or next(lines, "")
    counts = [as_count(word) for word in text.split()]
    if None in counts or len(counts) < 2:
        raise FileFormatError(f"expected numbers of vertices, faces, edges, found {shortened(text)}")
    n_vertices, n_faces = (count or 0 for count in counts[:2])
    names = [*default_names(3), *(NORMALS if header[2] else ()), *((*COLOUR, "alpha") if header[1] else ())]
    cloud = _cloud(read_table((f"{line}\n" for line in lines), count=n_vertices, what="vertex"), names)
    face_lines = list(islice(lines, n_faces))
    if len(face_lines) < n_faces:
        raise ends_early("face", len(face_lines), n_faces)

    def triangles() -> Faces:
        table = map(str.split, face_lines)
        return _triangles([int(fields[i]) for i in range(1, 1 + int(fields[0]))] for fields in table)

    return _reader(cloud, n_faces, triangles, [])


def open_obj(file: BufferedReader) -> Reader:
    """Open an OBJ file to read its `v` lines (x y z, and perhaps red green blue), and its faces."""
    vertices: list[str] = []
    face_lines: list[tuple[int, str]] = []  # with the number of vertices before them
    n_others = {"vn": 0, "vt": 0}
    other = ""
    for line in lines_of(file):
        keyword, _, text = line.partition(" ")
        if keyword not in ("v", "f"):  # few lines begin with blanks, or have tabs
            keyword, _, text = f"{line.strip()} ".replace("\t", " ").partition(" ")
        if keyword == "v":
            vertices.append(text if text.endswith("\n") else f"{text}\n")
        elif keyword == "f":
            face_lines.append((len(vertices), text))
        elif keyword in n_others:
            n_others[keyword] += 1
        elif is_row(line):
            other = other or line.strip()
    if other and not vertices:
        raise FileFormatError(f"expected lines of vertices of an OBJ file, such as 'v 0 0 0', found {shortened(other)}")

    def polygon(n_vertices: int, line: str) -> list[int]:
        indices = [int(field.partition("/")[0]) for field in line.split()]
        return [index - 1 if index > 0 else n_vertices + index for index in indices]

    named = {"normals": n_others["vn"], "texture coordinates": n_others["vt"]}
    skipped = [f"{name} ({n:,})" for name, n in named.items() if n]
    sizes = Counter(len(line.split()) for line in vertices)
    if sizes.keys() == {3, 6}:
        vertices = [f"{' '.join(line.split()[:3])}\n" for line in vertices]
        skipped.append(f"colours, which only some vertices have ({sizes[6]:,} of {sizes.total():,})")
    names = [*default_names(3), *(COLOUR if sizes.keys() == {6} else ())]
    cloud = _cloud(read_table(iter(vertices), what="vertex"), names)
    return _reader(cloud, len(face_lines), lambda: _triangles(starmap(polygon, face_lines)), skipped)


def _cloud(columns: list[Column], names: list[str]) -> PointCloud:
    """Return the cloud of columns, given names of the first ones."""
    names = names + default_names(len(columns))[len(names) :]
    return replace(PointCloud.from_columns(dict(zip(names, columns, strict=False))), coordinate_dtype=np.dtype("f8"))


def _triangles(polygons: Iterable[list[int]]) -> Faces:
    """Return polygons, given by the indices of their corners, as triangles."""
    try:
        parts = list(polygons)
        corners = np.array([corner for part in parts for corner in part], np.int64)
    except (ValueError, IndexError, OverflowError) as error:
        raise FileFormatError(f"expected faces of indices of vertices, but {error}") from error
    return triangles_of(np.array(list(map(len, parts)), np.int64), corners)


def triangles_of(sizes: NDArray[np.int64], corners: NDArray[np.int64]) -> Faces:
    """Return polygons, given by their sizes and all their corners, as triangles that share a polygon's first corner."""
    counts = np.maximum(sizes - 2, 0)
    first = np.repeat(np.cumsum(sizes) - sizes, counts)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    return corners[np.stack([first, second, second + 1], axis=1)]


def open_stl(file: BufferedReader) -> Reader:
    """Open an STL file to read the distinct corners of its facets, in order of first appearance, as vertices."""
    import pandas
    from trimesh.exchange import stl

    with reported("trimesh", "a whole STL file"), warnings.catch_warnings():
        warnings.simplefilter("error")  # of text that is no number
        loaded = stl.load_stl(BytesIO(file.read()))
        solids = [loaded] if "vertices" in loaded else loaded["geometry"].values()
        corners = np.concatenate([solid["vertices"] for solid in solids])
        vertex = pandas.DataFrame(corners).groupby([0, 1, 2], sort=False, dropna=False).ngroup().to_numpy()
    points = corners[np.unique(vertex, return_index=True)[1]]
    faces = vertex.reshape(-1, 3).astype(np.int64)
    return _reader(PointCloud(points, coordinate_dtype=corners.dtype), len(faces), lambda: faces, [])


def _is_stl(start: bytes, size: int) -> bool:
    is_text = start.lstrip().startswith(b"solid") and (b"facet" in start or b"endsolid" in start)
    return is_text or size == 84 + 50 * int.from_bytes(start[80:84], "little")  # a header with the number of facets


def open_gltf(file: BufferedReader) -> Reader:
    """Open a binary glTF file to read all triangles as one mesh, and the colours of its vertices."""
    import trimesh

    data = file.read()
    if (version := int.from_bytes(data[4:8], "little")) != 2:
        raise FileFormatError(f"expected version 2 of glTF, found {version}; export the file in that version")
    # It checks little of a damaged file, and infinite coordinates are found later.
    with reported("trimesh", "a whole glTF file"), np.errstate(all="ignore"):
        end = 20 + int.from_bytes(data[12:16], "little")  # of the first chunk
        description = json.loads(data[20:end])
        accessors = description.get("accessors", [])
        counts = [accessor["count"] for accessor in accessors]
        if max(counts, default=0) > len(data):
            raise FileFormatError(f"expected at most {len(data):,} numbers in a file of so many bytes, found more")
        primitives = [item for part in description.get("meshes", []) for item in part["primitives"]]
        _check_gltf(description, primitives)
        if not description.get("scenes"):
            raise FileFormatError("expected a scene in the glTF file, found none; export one with its objects")
        triangles = [item["attributes"] for item in primitives if item.get("mode", 4) in _TRIANGLES]
        coloured = [accessors[item["COLOR_0"]] for item in triangles if "COLOR_0" in item]
        kinds = {(colours["componentType"], colours["type"]) for colours in coloured}
        if len(coloured) == len(triangles) and len(kinds) == 1 and min(kinds)[0] != BYTES:
            data = data[:20] + data[20:end].replace(b'"COLOR_0"', f'"{LIGHT}"'.encode()) + data[end:]
        # Without a resolver, no other file is read.
        scene = trimesh.load_scene(BytesIO(data), file_type="glb", process=False, skip_materials=True)
        repeated = sum(len(scene.geometry[scene.graph[node][1]].vertices) for node in scene.graph.nodes_geometry)
        if repeated > max(10**7, len(data)):  # each node of a scene can repeat a mesh
            raise FileFormatError(f"expected a scene of fewer vertices in {len(data):,} bytes, found {repeated:,}")
        mesh = scene.to_mesh()
        points = np.asarray(mesh.vertices, np.float64)
        if description.get("asset", {}).get("generator") == GENERATOR:  # which turned z up to y up
            points = points[:, [0, 2, 1]] * (1.0, -1.0, 1.0) / _metres_of(description["asset"].get("extras"))
        faces = np.asarray(mesh.faces, np.int64)
        if not len(faces) or faces.min() < 0 or faces.max() >= len(points):
            raise FileFormatError(f"expected triangles of {len(points):,} vertices, found none or others")
        colours = _colours_in(mesh)
        names = (*COLOUR, "alpha") if (colours[3:] != 255).any() else COLOUR  # trimesh adds alpha where there is none
        attributes = dict(zip(names, map(np.ascontiguousarray, colours), strict=False))
        stored = {name for item in primitives for name in item["attributes"]}
        used = {"POSITION", "COLOR_0"} if attributes else {"POSITION"}
        skipped = [f"attribute {name}" for name in sorted(stored - used)]
        n_others = sum(item.get("mode", 4) not in _TRIANGLES for item in primitives)
        skipped += [f"points, lines or fans ({n_others:,})"] if n_others else []
        skipped += [f"textures ({len(textures):,})"] if (textures := description.get("textures")) else []
        is_single = np.array_equal(points, points.astype(np.float32))  # unless the scene moves them
    cloud = PointCloud(points, attributes, np.dtype(np.float32 if is_single else np.float64))
    return _reader(cloud, len(faces), lambda: faces, skipped)


def _colours_in(mesh: Any) -> NDArray[np.uint8]:
    """Return the colours of a mesh of trimesh as bytes of sRGB, (3 or 4, V), or nothing."""
    light = mesh.vertex_attributes.get(LIGHT)
    if light is None:
        return mesh.visual.vertex_colors.T if mesh.visual.kind == "vertex" else np.empty((0, 0), np.uint8)
    light = np.clip(light / (1.0 if light.dtype.kind == "f" else np.iinfo(light.dtype).max), 0.0, 1.0)
    return eight_bits(np.hstack([from_linear(light[:, :3]), light[:, 3:]]), 1.0).T


def _metres_of(extras: Any) -> NDArray[np.float64]:
    """Return the length in metres of the unit of all axes, (1,), or of each, (3,), from what gppcs adds to a file."""
    value = extras.get(METRES, 1.0) if isinstance(extras, dict) else 1.0
    metres = np.array([number(length) for length in (value if isinstance(value, list) else [value])])
    if len(metres) not in (1, 3) or not (np.isfinite(metres) & (metres > 0)).all():
        raise FileFormatError(f"expected one or three numbers above 0 as {METRES}, found {shown(value)}")
    return metres


def _check_gltf(description: dict[str, Any], primitives: list[dict[str, Any]]) -> None:
    """Check that trimesh can decode the geometry of a glTF file: of what it does not know it makes zeros."""
    required = description.get("extensionsRequired", [])
    if unknown := [name for name in required if not _WITHOUT_GEOMETRY.match(name)]:
        raise FileFormatError(f"expected a glTF file without {', '.join(unknown)}; export it without compression")
    if primitives and all(item.get("mode", 4) not in _TRIANGLES for item in primitives):
        raise FileFormatError("expected triangles, found points, lines or fans alone; export the file as PLY")
    accessors = description.get("accessors", [])
    for item in primitives:
        for accessor in (accessors[i] for i in (item["attributes"]["POSITION"], item.get("indices")) if i is not None):
            if "bufferView" not in accessor or "sparse" in accessor or accessor.get("normalized"):
                raise FileFormatError(
                    "expected vertices and faces that are stored one by one, found sparse or normalized ones; "
                    "export the file without compression"
                )


def write_off(file: BinaryIO, cloud: PointCloud, faces: Faces = NO_FACES) -> None:
    """Write points with their normals and colours, as far as they have these, and triangles, as an OFF file."""
    normals = [cloud.attributes[name] for name in NORMALS if name in cloud.attributes]
    colours = _colours_as_text(cloud, 255)
    file.write(f"{'C' if colours else ''}{'N' if normals else ''}OFF\n{len(cloud)} {len(faces)} 0\n".encode())
    write_rows(file, [*_coordinates(cloud), *normals, *colours])
    write_rows(file, list(faces.T), prefix="3 ")


def write_obj(file: BinaryIO, cloud: PointCloud, faces: Faces = NO_FACES) -> None:
    """Write points with colours from 0 to 1, normals, and triangles, as an OBJ file."""
    normals = [cloud.attributes[name] for name in NORMALS if name in cloud.attributes]
    write_rows(file, _coordinates(cloud) + _colours_as_text(cloud, 1), prefix="v ")
    numbers = list((faces + 1).T)
    if not normals:
        write_rows(file, numbers, prefix="f ")
        return
    write_rows(file, normals, prefix="vn ")
    file.writelines(b"f %d//%d %d//%d %d//%d\n" % (a, a, b, b, c, c) for a, b, c in zip(*numbers, strict=True))


def write_stl(file: BinaryIO, cloud: PointCloud, faces: Faces) -> None:
    """Write a mesh as binary STL."""
    import trimesh

    content: Any = trimesh.Trimesh(cloud.points, faces, process=False).export(file_type="stl")
    file.write(content)


def write_gltf(
    file: BinaryIO, cloud: PointCloud, faces: Faces, metres: Column | None = None, texture: Texture | None = None
) -> None:
    """Write a mesh as binary glTF: a node turns y up, moves single coordinates to their place and makes them metres."""
    import trimesh

    origin, scales = origin_of(cloud.points), np.ones(3) if metres is None else metres
    visual: Any = trimesh.visual  # of which not all is typed
    is_open = not trimesh.Trimesh(cloud.points, faces).is_watertight  # seams joined
    # Without a material, viewers draw metal of one side.
    material = visual.material.PBRMaterial(metallicFactor=0.0, roughnessFactor=0.8, doubleSided=is_open)
    shown, light = visual.TextureVisuals(material=material), dict[str, Any]()
    if texture is not None:
        from PIL import Image

        material.baseColorTexture = Image.fromarray(texture.image)
        shown.uv = texture.uv * (1.0, -1.0) + (0.0, 1.0)
    elif (colours := colours_of(cloud)) is not None:
        light[LIGHT] = np.hstack([linear(colours[:, :3] / 255), colours[:, 3:] / 255])

    def complete(tree: dict[str, Any]) -> None:
        tree["asset"]["generator"] = GENERATOR
        if metres is not None:
            tree["asset"]["extras"] = {METRES: scales.tolist()}
        (primitive,) = tree["meshes"][0]["primitives"]
        if light:
            primitive["attributes"]["COLOR_0"] = primitive["attributes"].pop(LIGHT)
        targets = dict.fromkeys(primitive["attributes"].values(), 34962) | {primitive["indices"]: 34963}
        for accessor, target in targets.items():
            tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] = target

    normals, scene = cloud.normals(), trimesh.Scene()
    to_place = np.block([[np.diag(scales), (scales * origin)[:, None]], [0.0, 0.0, 0.0, 1.0]])
    local = cloud.points - origin
    mesh = trimesh.Trimesh(local, faces, vertex_normals=normals, visual=shown, vertex_attributes=light, process=False)
    scene.add_geometry(mesh, transform=Y_UP @ to_place)
    content: Any = scene.export(file_type="glb", include_normals=normals is not None, tree_postprocessor=complete)
    file.write(content)


def origin_of(points: Column) -> Column:
    """Return a corner (3,) from which single precision keeps the coordinates; zero if they are single."""
    if not len(points) or np.array_equal(points, points.astype(np.float32)):
        return np.zeros(3)
    return np.floor(points.mean(axis=0))


def _coordinates(cloud: PointCloud) -> list[Column]:
    return list(cloud.points.astype(coordinate_type(cloud), copy=False).T)


def _colours_as_text(cloud: PointCloud, full: int) -> list[Column]:
    """Return colours as columns from 0 to 255 or 1, or as fractions where these are finer than 8 bits."""
    colours = colours_of(cloud)
    if colours is None:
        return []
    exact = _stacked(cloud)
    if not fit_eight_bits(exact):
        return list(exact.T)
    return list((colours if full == 255 else np.round(colours / 255, 6)).T)


def colours_of(cloud: PointCloud) -> NDArray[np.uint8] | None:
    """Return the colours of the points, (N, 3), or (N, 4) with alpha, as bytes; None if there are none."""
    return eight_bits(_stacked(cloud)) if set(COLOUR) <= set(cloud.attributes) else None


def _stacked(cloud: PointCloud) -> Column:
    """Return the colours of the points, (N, 3), or (N, 4) with alpha, in their own type."""
    return np.column_stack([cloud.attributes[name] for name in (*COLOUR, "alpha") if name in cloud.attributes])


def stored_of(
    cloud: PointCloud,
    groups: Sequence[Sequence[str]] = (NORMALS, COLOUR),
    single: bool = False,
    origin_of: Callable[[Column], Column] = lambda points: np.zeros(3),
) -> PointCloud:
    """Return a cloud with those groups of attributes that are complete, with colours of 8 bits or fractions as text.

    With `single`, coordinates from an origin are rounded to float32, and fractions to 8 bits.
    """
    numbers = {name for name, values in cloud.attributes.items() if values.dtype.kind in "biuf" and values.ndim == 1}
    names = {name for group in groups if set(group) <= numbers for name in group}
    stored = keeping(cloud, lambda name, values: name in names)
    colours = colours_of(stored)
    if colours is not None:
        exact = _stacked(stored)
        are_fractions = not single and exact.dtype.kind == "f" and full_scale(exact) == 1
        if not are_fractions and not fit_eight_bits(exact):
            columns = dict(zip((*COLOUR, "alpha"), colours.T, strict=False))
            stored = replace(stored, attributes={**stored.attributes, **columns})
    if not single:
        return with_digits(stored)
    origin = origin_of(stored.points)
    with np.errstate(over="ignore"):
        return replace(stored, points=(stored.points - origin).astype(np.float32).astype(np.float64) + origin)


_MESH = frozenset({"faces"})
OFF, OBJ, STL, GLTF = FORMATS = (
    Format(
        "OFF",
        (".off",),
        open_off,
        write_off,
        begins(rb"\s*C?N?OFF(?![A-Za-z])"),
        partial(stored_of, groups=(NORMALS, COLOUR, (*COLOUR, "alpha"))),
        _MESH,
    ),
    Format(
        "OBJ",
        (".obj",),
        open_obj,
        write_obj,
        stored=partial(stored_of, groups=(COLOUR,)),  # normals would not be read again
        options=_MESH,
    ),
    Format("STL", (".stl",), open_stl, recognises=_is_stl, options=_MESH),
    Format("glTF", (".glb",), open_gltf, recognises=begins(rb"glTF"), options=_MESH),
)
