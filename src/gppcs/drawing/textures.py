"""Textures of meshes: the colours of all points of a cloud, in a picture on which the triangles are laid out."""

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import CloudLike, PointCloud
from gppcs.clouds.mesh import Mesh, Texture
from gppcs.drawing.colours import Colourable
from gppcs.drawing.mesh_images import rasterised
from gppcs.engine.arrays import Floats, Ints
from gppcs.engine.extras import require
from gppcs.errors import InputError, ParameterError, shown, whole_number
from gppcs.io.reading import as_cloud
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import normalised

SIZES = 16, 8192  # of a texture in pixels, at least and at most
PADDING = 4  # pixels between parts of the mesh, so that smaller copies of the texture do not mix their colours
BLENDED = 8  # points around a pixel whose colours are blended
AT_ONCE = 1 << 20  # pixels, to bound the memory


def bake_texture(mesh: Mesh, cloud: CloudLike, size: int = 1024) -> Texture:
    """Return the colours of all points of a cloud as a texture of a mesh.

    A light mesh with it looks as its dense cloud does. The triangles are laid out by xatlas, which the extra `texture`
    installs.

    Parameters
    ----------
    mesh : Mesh
        A mesh of the cloud, such as `gppcs.mesh` makes.
    cloud : PointCloud and so on
        The dense cloud, with red, green and blue, in the coordinates of the mesh.
    size : int
        Width and height of the texture in pixels, from 16 to 8192.

    Returns
    -------
    Texture
        Each of its pixels has the blended colours of the eight points nearest to its place on the mesh.

    Raises
    ------
    InputError
        If the cloud has no colours or no finite points, or `mesh` is no Mesh.
    ParameterError
        If the size is out of range.
    MissingExtraError
        If xatlas or Pillow is not installed.

    Examples
    --------
    >>> cloud = gppcs.sample("fresco", n_points=20_000)
    >>> result = gppcs.mesh(cloud, n_points=200)
    >>> texture = gppcs.bake_texture(result.mesh, cloud, size=256)
    >>> gppcs.write_mesh("wall.glb", result.mesh, result.cloud, texture=texture)
    ['attribute curvature (float32)']
    """
    from scipy.ndimage import distance_transform_edt

    size = checked_texture_size(size)
    if not isinstance(mesh, Mesh):
        raise InputError(f"expected a gppcs.Mesh, found {shown(mesh)}")
    cloud = as_cloud(cloud)
    colours = require_colours(cloud := cloud[cloud.is_finite()])
    points, frame = normalised(cloud.points, cloud.units)
    distinct = first_occurrences(points)
    vertices = frame.near(mesh.vertices)
    indices, faces, uv = _laid_out(vertices, mesh.faces, size)
    nearest, weights = rasterised(size * uv, np.zeros(len(uv)), faces, (size, size))
    covered = nearest >= 0
    seen = np.einsum("kc,kcx->kx", weights[covered], vertices[indices[faces[nearest[covered]]]])
    image = np.zeros((size, size, 3), dtype=np.uint8)
    pixel = Mesh(vertices, mesh.faces).face_areas().sum() / max(1, len(seen))
    image[covered] = _blended(KdTree.build(points[distinct]), colours[distinct], seen, pixel)
    # Empty pixels get the colour of the nearest covered one, as seams would show else.
    rows, columns = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return Texture(image[rows, columns], indices, uv, faces)


def require_colours(cloud: PointCloud) -> NDArray[np.uint8]:
    """Return the colours (N, 3) of a cloud, or raise an error if it has none."""
    colours = Colourable.from_cloud(cloud).rgb
    if colours is None or not len(cloud):
        raise InputError("expected points with red, green and blue for a texture, found none; leave the texture out")
    return colours


def checked_texture_size(size: int) -> int:
    """Check the size of a texture, and for the packages that make it."""
    require("xatlas", "a texture needs xatlas", extra="texture")
    require("PIL.Image", "a texture needs Pillow", "pillow", extra="texture")
    size = whole_number("the size of a texture", size, SIZES[0])
    if size > SIZES[1]:
        raise ParameterError(f"expected a texture of at most {SIZES[1]} pixels, found {size}")
    return size


def _laid_out(vertices: Floats, faces: Ints, size: int) -> tuple[Ints, Ints, Floats]:
    """Return the vertices of the layout of a mesh: their indices (K,), triangles (F, 3) and uv (K, 2)."""
    import xatlas

    atlas, options = xatlas.Atlas(), xatlas.PackOptions()
    options.resolution, options.padding, options.bilinear = size, PADDING, True
    atlas.add_mesh(vertices.astype(np.float32), faces.astype(np.uint32))
    atlas.generate(xatlas.ChartOptions(), options)
    indices, triangles, uv = atlas[0]
    return indices.astype(np.int64), triangles.astype(np.int64), uv.astype(np.float64)


def _blended(tree: KdTree, colours: NDArray[np.uint8], seen: Floats, pixel: float) -> NDArray[np.uint8]:
    """Return colours (K, 3) at points (K, 3) of a mesh, from those of a tree; `pixel` is the area of a pixel."""
    blended = np.empty((len(seen), 3), dtype=np.uint8)
    for first in range(0, len(seen), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        near, squared = tree.nearest_of(seen[part], min(BLENDED, len(colours)))
        weights = 1.0 / (squared + 0.1 * pixel)
        sums = np.einsum("nk,nkc->nc", weights, colours[near].astype(np.float64))
        blended[part] = np.round(sums / weights.sum(axis=1, keepdims=True))
    return blended
