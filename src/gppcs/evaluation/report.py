"""The figures of a simplification, each declared once with its unit and definition, which help and docs print."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

if TYPE_CHECKING:
    from gppcs.clouds.mesh import Mesh

BY_AREA = "each original point weighted by the area of the surface that it stands for"


class Figure(NamedTuple):
    """The unit and the definition of a figure; lengths are in the unit of the coordinates."""

    unit: Literal["count", "length", "squared length", "degrees", "share", "ratio"]
    definition: str
    better: Literal["less", "more"] | None  # which values are better, if any

    @property
    def power(self) -> int:
        """The power of the length in the unit."""
        return {"length": 1, "squared length": 2}.get(self.unit, 0)


def figure(unit: str, definition: str, better: str | None = "less") -> Any:
    """Return a dataclass field that holds a figure."""
    return dataclasses.field(metadata={"figure": Figure(unit, definition, better)})  # type: ignore[arg-type]


class Figures:
    """A part of a report: a dataclass whose fields are figures."""

    @classmethod
    def definitions(cls) -> dict[str, Figure]:
        """Return the unit and the definition of each figure by the name of its field."""
        fields = dataclasses.fields(cls)  # type: ignore[arg-type]
        return {field.name: field.metadata["figure"] for field in fields if "figure" in field.metadata}

    def values_in(self, unit: float = 1.0) -> dict[str, float]:
        """Return all figures by name, with lengths in a unit that is given in theirs; 0 leaves them."""
        scaled = {}
        for name, definition in self.definitions().items():
            value = getattr(self, name)
            scaled[name] = value / unit**definition.power if definition.power and unit > 0.0 else value
        return scaled

    def in_unit(self, unit: float) -> Self:
        """Return the same figures with lengths in another unit, which is given in theirs."""
        return dataclasses.replace(self, **self.values_in(unit))  # type: ignore[type-var]


@dataclass(frozen=True)
class DetailErrors(Figures):
    """How far an attribute of the original is from that of a simplified cloud, in ranges of the attribute.

    These are of numbers from the 2nd to the 98th percentile, of colours from black to white in OKLab, of classes 1.
    """

    error_mean: float = figure(
        "share", "mean error of the attribute, in ranges, if the values of kept points are interpolated linearly"
    )
    error_p95: float = figure("share", "95th percentile of those errors")
    nearest_error_mean: float = figure(
        "share", "mean error of the attribute, in ranges, if each original point gets the value of the nearest kept one"
    )
    nearest_error_p95: float = figure("share", "95th percentile of those errors")


@dataclass(frozen=True)
class Rebuilt(Figures):
    """The mesh rebuilt from a simplified cloud by screened Poisson reconstruction, compared with the original mesh."""

    mesh: Mesh = dataclasses.field(repr=False, compare=False)  # in the unit and frame of the simplified cloud
    hausdorff_mean: float = figure(
        "length", "mean distance from the vertices of the original mesh to the rebuilt mesh (the paper's H mean)"
    )
    hausdorff_max: float = figure("length", "largest of those distances (the paper's H max)")
    back_mean: float = figure("length", "mean distance from the vertices of the rebuilt mesh to the original mesh")
    back_max: float = figure("length", "largest of those distances")
    pieces: int = figure("count", "connected pieces of the rebuilt mesh", None)
    stray_share: float = figure(
        "share",
        "share of the rebuilt mesh's area in triangles with a corner farther from the original mesh than a twentieth "
        "of the diagonal, such as stray pieces and membranes over boundary loops",
    )


@dataclass(frozen=True)
class MeshReport(Figures):
    """The figures of a simplified mesh.

    Lengths are in the unit of the coordinates. `MeshReport.definitions()` explains each figure.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=3000)
    >>> report = gppcs.evaluate_mesh(cloud, gppcs.mesh(cloud, n_points=100).mesh)
    >>> report.triangles, report.boundary_loops, report.genus
    (196, 0, 0.0)
    """

    vertices: int = figure("count", "vertices of the mesh", None)
    triangles: int = figure("count", "triangles of the mesh", None)
    diagonal: float = figure("length", "diagonal of the original's bounding box", None)
    mesh_mean: float = figure(
        "length",
        "mean distance from the original points, or with an original mesh from its vertices, to the simplified mesh",
    )
    mesh_max: float = figure("length", "largest of those distances")
    mesh_back_mean: float = figure(
        "length",
        "mean distance from the vertices of the simplified mesh to the local surface of the original points, or to the "
        "original mesh",
    )
    mesh_back_max: float = figure("length", "largest of those distances")
    mesh_pieces: int = figure("count", "connected pieces of the simplified mesh", None)
    boundary_loops: int = figure("count", "closed curves of edges with one triangle, such as the rims of holes", None)
    genus: float = figure("count", "handles of all pieces together; NaN if the mesh is no oriented manifold", None)
    non_manifold_edges: int = figure("count", "edges of more than two triangles, or of two not oriented alike")
    non_manifold_vertices: int = figure("count", "vertices at which several fans of triangles meet")
    self_intersections: int = figure("count", "triangles that cut another triangle, by PyMeshLab")
    slivers: float = figure(
        "share",
        "share of the triangles of a quality below 0.2: 4 sqrt(3) times the area over the sum of the squared edges, "
        "which is 1 if all edges are equal",
    )

    def figures(self, relative: bool = False) -> dict[str, float]:
        """Return all figures by name, as `Report.figures` does."""
        return self.values_in(self.diagonal if relative else 1.0) | {"diagonal": self.diagonal}


@dataclass(frozen=True)
class Report(Figures):
    """The figures of a simplification.

    Lengths are in the unit of the coordinates. `Report.definitions()` explains each figure.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> report = gppcs.evaluate(cloud, gppcs.simplify(cloud, ratio=0.1, method="fps").cloud)
    >>> relative = report.figures(relative=True)
    >>> relative["surface_mean"] == report.surface_mean / report.diagonal
    True
    >>> gppcs.Report.definitions()["covering_radius"].definition
    'largest distance from an original point to the nearest kept point'

    Attributes
    ----------
    detail : mapping of str to DetailErrors
        The errors of the attributes that were named.
    rebuilt : Rebuilt or None
        The mesh rebuilt with the normals of the original mesh, if one was given: what points that carry normals give.
    rebuilt_estimated : Rebuilt or None
        The same with normals estimated on the simplified cloud, as in the paper, if they give a surface.
    rebuilt_carried : Rebuilt or None
        The same with the normals `nx`, `ny` and `nz` of the cloud, if it has some and they give a surface.
    """

    points_in: int = figure("count", "points of the original, N", None)
    points_out: int = figure("count", "points of the simplified cloud, M", None)
    diagonal: float = figure("length", "diagonal of the original's bounding box", None)
    covering_radius: float = figure("length", "largest distance from an original point to the nearest kept point")
    covering_p999: float = figure(
        "length", "99.9th percentile of those distances, which a few outliers in the original do not decide"
    )
    mean_distance: float = figure("length", "mean of those distances")
    mean_distance_by_area: float = figure("length", f"mean of those distances, {BY_AREA}")
    chamfer: float = figure(
        "squared length", "mean squared distance to the nearest point, in both directions, added (the paper's CD)"
    )
    surface_mean: float = figure(
        "length", "mean distance from the original points to the local surface of the simplified cloud"
    )
    surface_mean_by_area: float = figure("length", f"mean of those distances, {BY_AREA}")
    surface_rms: float = figure("length", "root mean square of those distances")
    surface_p95: float = figure("length", "95th percentile of those distances")
    surface_p95_by_area: float = figure("length", f"95th percentile of those distances, {BY_AREA}")
    surface_max: float = figure("length", "largest of those distances")
    feature_error: float = figure(
        "length",
        "mean of those distances, each multiplied by the angle, in radians, between the normals of the original and of "
        "the local surface there",
    )
    feature_error_by_area: float = figure("length", f"mean of those products, {BY_AREA}")
    feature_recall: float = figure(
        "share",
        "take the 10 % of the original points with the largest surface variation: the share of them that have a kept "
        "point within the target spacing, sqrt(area of the surface / M)",
        "more",
    )
    normal_deviation: float = figure(
        "degrees", "mean angle between the normals estimated at an original point and at the nearest kept point"
    )
    mean_surface_variation: float = figure("ratio", "mean surface variation of the simplified cloud", "more")
    detail: Mapping[str, DetailErrors] = dataclasses.field(default_factory=dict)
    rebuilt: Rebuilt | None = None
    rebuilt_estimated: Rebuilt | None = None
    rebuilt_carried: Rebuilt | None = None

    def figures(self, relative: bool = False) -> dict[str, float]:
        """Return all figures by name, with lengths divided by the diagonal if `relative`.

        Figures of `rebuilt_estimated` have the prefix "estimated_", those of `rebuilt_carried` "carried_", those of
        `detail` the names of the attributes.
        """
        unit = self.diagonal if relative else 1.0
        values = self.values_in(unit) | {"diagonal": self.diagonal}
        rebuilt = {"": self.rebuilt, "estimated_": self.rebuilt_estimated, "carried_": self.rebuilt_carried}
        for prefix, part in ({f"{name}_": errors for name, errors in self.detail.items()} | rebuilt).items():
            if part:
                values |= {prefix + name: value for name, value in part.values_in(unit).items()}
        return values


def definition_of(name: str) -> Figure:
    """Return the definition of a figure by its name in `Report.figures` or `MeshReport.figures`."""
    definitions = {
        key: one for part in (Report, Rebuilt, MeshReport, DetailErrors) for key, one in part.definitions().items()
    }
    # Behind the name of an attribute or another prefix: the longest, as "nearest_error_mean" ends in "error_mean", too.
    return definitions[max((key for key in definitions if f"_{name}".endswith(f"_{key}")), key=len)]
