"""Reads the triangles of binary glTF files, by trimesh."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from io import BufferedReader, BytesIO

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.engine.extras import require_trimesh
from gppcs.io.format import Format, Reader, from_start
from gppcs.io.meshes import COLOURS, FACES
from gppcs.io.rows import reported


def _loaded(file: BufferedReader) -> tuple[Mesh, PointCloud]:
    """Return all triangles of a file as one mesh, and its vertices with their colours."""
    trimesh = require_trimesh()
    with reported("trimesh", "a whole mesh"):  # it checks little of a damaged file
        found = trimesh.load(BytesIO(file.read()), file_type="glb", force="mesh", process=False)
        mesh = Mesh(np.asarray(found.vertices), np.asarray(found.faces))
        coloured = found.visual.kind == "vertex"
        colours = np.asarray(found.visual.vertex_colors)[:, :3].T if coloured else ()
    attributes = dict(zip(COLOURS, map(np.ascontiguousarray, colours), strict=False))
    return mesh, PointCloud(mesh.vertices, attributes, np.dtype(np.float32))


def read_gltf(file: BufferedReader, rows: int, attributes: bool) -> Iterator[PointCloud]:
    """Read the vertices of a glTF file with their colours."""
    yield _loaded(file)[1]


def _triangles(file: BufferedReader) -> NDArray[np.int64]:
    return _loaded(file)[0].faces


def open_gltf(file: BufferedReader) -> Reader:
    """Open a glTF file."""
    triangles = partial(from_start, _triangles, file)
    return Reader(
        partial(from_start, read_gltf, file), at_once=True, n_faces=lambda: len(triangles()), triangles=triangles
    )


FORMAT = Format("glTF", (".glb",), open_gltf, recognises=lambda start, size: start.startswith(b"glTF"), options=FACES)
