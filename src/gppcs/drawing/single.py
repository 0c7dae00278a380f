"""Draws one cloud or mesh."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gppcs.clouds.cloud import PointCloud
from gppcs.clouds.mesh import Mesh
from gppcs.drawing.attributes import RGB, VARIATION, Colourable
from gppcs.drawing.camera import SUPERSAMPLING, Camera
from gppcs.drawing.cloud_images import MAX_SURFACE_RADIUS, ColouredCloud, Original, View
from gppcs.drawing.mesh_images import mesh_images
from gppcs.drawing.paint import SURFACE_VARIATION, Legend, Paint
from gppcs.drawing.viewpoint import GUESSED, Viewpoint
from gppcs.engine.extras import require_matplotlib, require_pyvista
from gppcs.errors import InputError, ParameterError, whole_number
from gppcs.spatial.cells import first_occurrences
from gppcs.spatial.kdtree import KdTree
from gppcs.spatial.scaling import Frame, bounds

Array = NDArray[np.float64]

SIZE = (1280, 960)  # pixels
SMALLEST, LARGEST = 64, 4096  # pixels; larger pictures would take many gigabytes of memory
DPI = 64  # a power of two, so that matplotlib does not round sizes in pixels
BELOW = 74  # pixels for the colour bar
TEXT = 16.0  # pixels


class Drawn(NamedTuple):
    """What a picture shows.

    Attributes
    ----------
    colour : str
        What the colours show, in words; empty for a white mesh.
    left_out : int
        Number of points whose coordinates are NaN or infinite.
    outside : int
        Number of points that lie so far from all others that the picture does not show them.
    """

    colour: str
    left_out: int
    outside: int


def draw_single(
    file: BinaryIO,
    cloud: PointCloud,
    mesh: Mesh | None = None,
    colour: str | None = None,
    viewpoint: Viewpoint = GUESSED,
    size: tuple[int, int] = SIZE,
    bar: bool = True,
) -> Drawn:
    """Write a PNG of a mesh, or of a cloud, drawn as a surface without gaps between its points."""
    require_matplotlib()
    if mesh is not None:
        require_pyvista()
    width, height = checked_size(size)
    rows = cloud.finite_rows()
    if len(rows) == 0:
        raise InputError(f"expected points with finite coordinates to draw, found none among {len(cloud)}")
    finite = cloud.take(rows)
    subject = _Subject.of(finite, mesh)
    paint = _paint(Colourable.of(finite), subject, colour)
    below = BELOW if bar and paint.legend.scale and height - BELOW >= SMALLEST else 0
    direction = viewpoint.completed(finite.points if mesh is None else mesh.vertices[np.unique(mesh.faces)])
    radius = MAX_SURFACE_RADIUS / SUPERSAMPLING
    camera = Camera.towards(subject.places, width, (height - below, height - below), direction, radius)
    _write(file, subject.image(camera, paint.colours), (width, height), below, paint.legend)
    place, _ = camera.pixels(subject.places)
    outside = int(((place < 0) | (place >= np.array(camera.shape))).any(axis=1).sum())
    return Drawn(paint.legend.title, len(cloud) - len(rows), outside)


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Check the size of a picture."""
    width, height = (whole_number("the size of a picture", each, SMALLEST) for each in size)
    if max(width, height) > LARGEST:
        raise ParameterError(f"expected a picture of at most {LARGEST} x {LARGEST} pixels, found {width} x {height}")
    return width, height


@dataclass(frozen=True)
class _Subject:
    """What is drawn, shifted and scaled to about unit size."""

    points: Array
    mesh: Mesh | None
    carried: Array | None  # normals of the points, of any length

    @classmethod
    def of(cls, cloud: PointCloud, mesh: Mesh | None) -> _Subject:
        if mesh is None:
            return cls(Frame.around(*bounds(cloud.points)).local(cloud.points), None, cloud.normals())
        frame = Frame.around(*bounds(np.vstack([cloud.points, mesh.vertices])))
        return cls(frame.local(cloud.points), Mesh(frame.local(mesh.vertices), mesh.faces), None)

    @cached_property
    def places(self) -> Array:
        """What the picture has to show: the points, or the vertices that triangles use."""
        return self.points if self.mesh is None else self.mesh.vertices[np.unique(self.mesh.faces)]

    @cached_property
    def cloud(self) -> ColouredCloud:
        """The cloud with its surface variation, and its own normals as far as it has some."""
        cloud = ColouredCloud.by_surface_variation(self.points)
        if self.carried is None or cloud.normals is None:
            return cloud
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            units = self.carried / np.linalg.norm(self.carried, axis=1, keepdims=True)
        known = np.isfinite(units).all(axis=1, keepdims=True)
        return replace(cloud, normals=np.where(known, units, cloud.normals))

    def image(self, camera: Camera, colours: Array | None) -> Array:
        """Return the picture, given the colour of each point of the cloud."""
        if self.mesh is None:
            assert colours is not None
            return View(Original(self.cloud), camera).surface(colours)
        if colours is None:
            return mesh_images(self.mesh, [camera])[0]
        distinct = np.flatnonzero(first_occurrences(self.points))
        nearest, _ = KdTree.build(self.points[distinct]).nearest_of(self.mesh.vertices, 1)
        return mesh_images(self.mesh, [camera], colours[distinct[nearest[:, 0]]])[0]


def _paint(attributes: Colourable, subject: _Subject, colour: str | None) -> Paint:
    """Return the colours of the cloud, or none for a mesh without RGB."""
    if colour is None and attributes.rgb is None and subject.mesh is not None:
        return Paint(Legend(""), None)
    colour = colour or (VARIATION if attributes.rgb is None else RGB)
    if attributes.means_variation(colour):
        return Paint.by_amounts(SURFACE_VARIATION, subject.cloud.values, root=True)
    return Paint.of(attributes, colour)


def _write(file: BinaryIO, image: Array, size: tuple[int, int], below: int, legend: Legend) -> None:
    """Write a picture with its colour bar, for which `below` pixels are left."""
    from matplotlib.figure import Figure

    width, height = size
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    figure.figimage(image, 0, below, origin="upper")
    if below:
        broad = min(0.8, 512 / width)
        place = (0.5 - broad / 2.0, 48 / height, broad, 12 / height)
        legend.add_bar(figure, place, TEXT * 72 / DPI)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the name of an attribute may have letters that the font lacks
        figure.savefig(file, format="png", dpi=DPI)
