"""How `gppcs compare --meshes` shows the meshes: in a picture, and in a page."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud
    from gppcs.clouds.mesh import Mesh
    from gppcs.drawing.viewpoint import Viewpoint
    from gppcs.drawing.web.contents import Named
    from gppcs.evaluation.mesh_comparison import MeshEntry


def drawn_meshes(
    original: PointCloud,
    entries: Sequence[MeshEntry],
    mesh: Mesh | None,
    viewpoint: Viewpoint,
    colour: str | None = None,
) -> bytes:
    """Draw the vertices of meshes, and below them the meshes."""
    from gppcs.drawing.paint import painted
    from gppcs.drawing.side_by_side import Column, draw_comparison
    from gppcs.spatial.kdtree import KdTree

    everything, legend = painted(original.take(original.finite_rows()), colour)
    tree = KdTree.build(everything.points)
    columns = [Column("original", everything, "", mesh)]
    for entry in entries:
        if entry.mesh and entry.report:
            vertices = _vertices(entry.mesh)
            kept = everything.kept(tree.nearest_of(vertices, 1)[0][:, 0], vertices)
            mean = entry.report.figures(relative=True)["mesh_mean"]
            caption = f"mesh mean\n{mean:.2e} diagonals"
            columns.append(Column(entry.way, kept, caption, entry.mesh, "vertices"))
    image = BytesIO()
    draw_comparison(image, columns, viewpoint, legend)
    return image.getvalue()


def named_meshes(entries: Sequence[MeshEntry]) -> list[Named]:
    """Return the vertices of meshes with the names of the ways and the meshes, for a page."""
    from gppcs.clouds.cloud import PointCloud
    from gppcs.drawing.web.contents import Named

    return [
        Named(entry.way, PointCloud(_vertices(entry.mesh)), entry.mesh, f"it is a vertex of the mesh by {entry.way}")
        for entry in entries
        if entry.mesh and entry.report
    ]


def _vertices(mesh: Mesh) -> NDArray[np.float64]:
    """Return the vertices that triangles have, (V, 3)."""
    import numpy as np

    return mesh.vertices[np.unique(mesh.faces)]
