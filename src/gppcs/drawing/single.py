"""Draws one cloud or mesh."""

import warnings
from dataclasses import replace
from typing import BinaryIO

import numpy as np

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import GUESSED, SUPERSAMPLING, Camera, Viewpoint, spread_over
from gppcs.drawing.cloud_images import MAX_SURFACE_RADIUS, ColouredCloud, Original, View, painted
from gppcs.drawing.colours import RGB, Colourable, Legend
from gppcs.drawing.mesh_images import mesh_images
from gppcs.drawing.surfaces import surface_through
from gppcs.drawing.web.layers import Named, in_one_unit
from gppcs.engine.arrays import Floats
from gppcs.engine.extras import require_matplotlib
from gppcs.errors import InputError, ParameterError, whole_number
from gppcs.spatial.scaling import Frame, bounds

SMALLEST = 64  # pixels
PIXELS_PER_POINT = 60  # of a picture; with more, points are so few that discs would hide the shape
DPI = 64  # a power of two, so that matplotlib does not round sizes in pixels


def draw_single(
    file: BinaryIO,
    cloud: PointCloud,
    mesh: Mesh | None = None,
    colour: str | None = None,
    viewpoint: Viewpoint = GUESSED,
    size: tuple[int, int] = (1280, 960),
    bar: bool = True,
) -> tuple[str, int, int]:
    """Write a PNG of a mesh, or of a cloud, drawn as a surface without gaps between its points.

    Of few points, that is the mesh through them; where they are noisy or lie on no surface, single discs.

    Returns what the colours show, empty for a white mesh, the number of points that are not finite, and that of points
    so far from all others that they are outside the picture.
    """
    require_matplotlib()
    (named,) = in_one_unit([Named("", cloud, mesh)])
    cloud, mesh = named.cloud, named.mesh
    width, height = checked_size(size)
    indices = np.flatnonzero(cloud.is_finite())
    if len(indices) == 0:
        raise InputError(f"expected points with finite coordinates to draw, found none among {len(cloud)}")
    finite = cloud.take(indices)
    corners, everything = finite.points, finite.points  # where the camera looks, and what becomes of about unit size
    if mesh is not None:
        corners, everything = mesh.vertices[np.unique(mesh.faces)], np.vstack([finite.points, mesh.vertices])
    frame = Frame.from_bounds(*bounds(everything))
    seen_points, local = frame.local(corners), mesh and Mesh(frame.local(mesh.vertices), mesh.faces)
    seen, legend = _coloured(finite.moved(frame.local(finite.points)), colour, mesh is not None)
    is_sparse = mesh is None and PIXELS_PER_POINT * len(finite) < width * height
    if is_sparse:
        surface = surface_through(PointCloud(seen_points))
        local = None if surface is None or surface.is_noisy else surface.mesh
    below = 74 if bar and legend.scale and height - 74 >= SMALLEST else 0  # pixels for the colour bar
    radius = MAX_SURFACE_RADIUS / SUPERSAMPLING
    looked = Viewpoint(*viewpoint.guessed(finite.points if mesh is None else spread_over(mesh)))
    camera = Camera.towards(seen_points, width, (height - below,) * 2, looked, radius)
    _write(file, _image(seen, local, camera, not is_sparse), (width, height), below, legend)
    drawn, _ = camera.pixels(seen_points)
    outside = int(((drawn < 0) | (drawn >= np.array(camera.shape))).any(axis=1).sum())
    return legend.title, len(cloud) - len(indices), outside


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Check the size of a picture."""
    width, height = (whole_number("the size of a picture", pixels, SMALLEST) for pixels in size)
    largest = 4096  # larger pictures would take many gigabytes of memory
    if max(width, height) > largest:
        raise ParameterError(f"expected a picture of at most {largest} x {largest} pixels, found {width} x {height}")
    return width, height


def _coloured(cloud: PointCloud, colour: str | None, is_mesh: bool) -> tuple[ColouredCloud | None, Legend]:
    """Return a cloud with its colours and, as far as it has some, its own normals; none for a mesh without RGB."""
    rgb = Colourable.from_cloud(cloud).rgb
    if is_mesh and colour is None and rgb is None:
        return None, Legend("")
    seen, legend = painted(cloud, colour or (None if rgb is None else RGB))
    legend, carried = legend or Legend.of_amounts([seen.values]), cloud.normals()
    if carried is not None and seen.normals is not None:
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            units = carried / np.linalg.norm(carried, axis=1, keepdims=True)
        usable = np.isfinite(units).all(axis=1, keepdims=True)
        seen = replace(seen, normals=np.where(usable, units, seen.normals))
    return replace(seen, colours=seen.colours_by(legend)), legend


def _image(seen: ColouredCloud | None, mesh: Mesh | None, camera: Camera, is_closed: bool) -> Floats:
    """Return the picture of a cloud, or of a mesh whose vertices have the colours of the nearest points."""
    if seen is None or seen.colours is None:
        assert mesh is not None
        return mesh_images(mesh, [camera])[0]
    if mesh is None:
        return View(Original(seen), camera, is_closed).surface(seen.colours)
    return mesh_images(mesh, [camera], seen.at(mesh.vertices).colours)[0]


def _write(file: BinaryIO, image: Floats, size: tuple[int, int], below: int, legend: Legend) -> None:
    """Write a picture with its colour bar, for which `below` pixels are left."""
    from matplotlib.figure import Figure

    width, height = size
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    figure.figimage(image, 0, below, origin="upper")
    if below:
        broad = min(0.8, 512 / width)
        legend.add_bar(figure, (0.5 - broad / 2.0, 48 / height, broad, 12 / height), 16.0 * 72 / DPI)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the name of an attribute may have letters that the font lacks
        figure.savefig(file, format="png", dpi=DPI)
