"""Draws meshes, by PyVista."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gppcs.clouds.mesh import Mesh
from gppcs.drawing.camera import Camera, averaged
from gppcs.engine.arrays import Floats


def mesh_images(mesh: Mesh, cameras: Sequence[Camera], colours: Floats | None = None) -> list[Floats]:
    """Return the pictures, (height, width, 3) each, of a mesh with the colours (V, 3), seen by several cameras."""
    import pyvista

    first = cameras[0]
    seen = mesh.vertices @ first.axes.T
    # Use pixels of the first camera around its centre, since PyVista stores vertices in single precision.
    seen = (seen - [*first.centre, seen[:, 2].max()]) * first.scale
    surface = pyvista.PolyData.from_regular_faces(seen.astype(np.float32), mesh.faces)
    paint: dict[str, object] = {"color": "#ebebe9"}
    if colours is not None:
        surface.point_data["colours"] = np.round(255.0 * colours).astype(np.uint8)
        paint = {"scalars": "colours", "rgb": True}
    surface = surface.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=40.0, consistent_normals=False
    )

    def photograph(camera: Camera) -> Floats:
        plotter = pyvista.Plotter(off_screen=True, window_size=list(camera.shape), lighting="none")
        plotter.set_background("white")
        # A key light on the upper left, one at the viewer, a fill light on the right.
        lights = (((-0.35, 0.7, 0.62), 0.62), ((0.0, 0.0, 1.0), 0.25), ((0.8, -0.1, 0.6), 0.15))
        for position, intensity in lights:
            plotter.add_light(pyvista.Light(position=position, light_type="camera light", intensity=intensity))
        material = {"ambient": 0.2, "diffuse": 1.0, "specular": 0.05, "specular_power": 15.0}
        plotter.add_mesh(surface, smooth_shading=True, **material, **paint)
        right, up = (camera.centre - first.centre) * first.scale
        plotter.camera_position = [(right, up, 1.0), (right, up, 0.0), (0.0, 1.0, 0.0)]
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 0.5 * camera.shape[1] * first.scale / camera.scale
        plotter.camera.clipping_range = (0.5, 2.0 - surface.bounds.z_min)
        image = plotter.screenshot(return_img=True) / 255.0
        plotter.close()
        return averaged(image)

    with pyvista.vtk_verbosity("off"):  # it would report on stderr that there is no display
        return [photograph(camera) for camera in cameras]
