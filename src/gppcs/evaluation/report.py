"""The figures of a simplification, with the unit and the definition of each, which help and docs print."""

from __future__ import annotations

import dataclasses
import inspect
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from gppcs.errors import ParameterError, shown

if TYPE_CHECKING:
    from gppcs.clouds.mesh import Mesh

Unit = Literal["count", "length", "squared length", "degrees", "share", "ratio"]
Class = TypeVar("Class", bound=type)

BY_AREA = "each original point weighted by the area of the surface that it stands for"


@dataclass(frozen=True)
class Figure:
    """The unit and the definition of one figure.

    Attributes
    ----------
    unit : str
        One of "count", "length", "squared length", "degrees", "share" and "ratio". Lengths are in the unit of the
        coordinates.
    definition : str
        What the figure measures.
    better : "less", "more" or None
        Which values are better; None if neither are.

    Examples
    --------
    >>> from gppcs.evaluation.report import figures_of
    >>> figure = figures_of(gppcs.Report)["covering_radius"]
    >>> figure.unit, figure.better
    ('length', 'less')
    """

    unit: Unit
    definition: str
    better: Literal["less", "more"] | None = None


def figure(unit: Unit, definition: str, better: Literal["less", "more"] | None = "less") -> Any:
    """Return a dataclass field that holds a figure."""
    return dataclasses.field(metadata={"figure": Figure(unit, definition, better)})


def relative(known: Figure, value: float, diagonal: float) -> float | None:
    """Return a length over a diagonal, or a squared length over its square; None for other figures or no diagonal."""
    power = {"length": 1, "squared length": 2}.get(known.unit)
    return None if power is None or not diagonal > 0 else value / diagonal**power


def _told(report: Class) -> Class:
    """Complete the docstring of a report by its fields, before its examples, unless `python -OO` has removed it."""
    if report.__doc__:
        before, title, examples = inspect.cleandoc(report.__doc__).partition("Examples\n--------")
        told = []
        for each in dataclasses.fields(report):
            meaning = each.metadata["figure"].definition if "figure" in each.metadata else each.metadata["meaning"]
            text = textwrap.indent(textwrap.fill(f"{meaning[0].upper()}{meaning[1:]}.", 96), "    ")
            told.append(f"{each.name} : {each.type}\n{text}\n")
        report.__doc__ = f"{before}Attributes\n----------\n{''.join(told)}\n{title}{examples}"
    return report


def figures_of(report: type) -> Mapping[str, Figure]:
    """Return unit and definition of each figure of a report.

    Parameters
    ----------
    report : type
        `gppcs.Report`, `DetailErrors`, `Rebuilt` or `MeshReport`.

    Returns
    -------
    dict of str to Figure
        By the name of the field, in the order of the fields.

    Raises
    ------
    ParameterError
        If `report` is neither of them.

    Examples
    --------
    >>> from gppcs.evaluation.report import figures_of
    >>> figures_of(gppcs.Report)["covering_radius"].definition
    'largest distance from an original point to the nearest kept point'
    """
    if not (isinstance(report, type) and issubclass(report, Report | DetailErrors | Rebuilt | MeshReport)):
        raise ParameterError(f"expected Report, DetailErrors, Rebuilt or MeshReport, found {shown(report)}")
    return {field.name: field.metadata["figure"] for field in dataclasses.fields(report) if "figure" in field.metadata}


@_told
@dataclass(frozen=True)
class DetailErrors:
    """How far an attribute of the original is from that of a simplified cloud.

    The unit is the range of the attribute: of numbers from the 2nd to the 98th percentile, of colours the distance of
    black and white in the space OKLab, of classes the distance of two classes.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> kept = gppcs.simplify(cloud, ratio=0.1, detail="curvature").cloud
    >>> errors = gppcs.evaluate(cloud, kept, detail=["curvature"]).detail["curvature"]
    >>> errors.rms > 0
    True
    """

    error_mean: float = figure(
        "share", "mean error of the attribute, in ranges, if the values of kept points are interpolated linearly"
    )
    error_p95: float = figure("share", "95th percentile of those errors")
    nearest_error_mean: float = figure(
        "share", "mean error of the attribute, in ranges, if each original point gets the value of the nearest kept one"
    )
    nearest_error_p95: float = figure("share", "95th percentile of those errors")


@_told
@dataclass(frozen=True)
class Rebuilt:
    """The mesh rebuilt from a simplified cloud by screened Poisson reconstruction, compared with the original mesh.

    Lengths are in the unit of the cloud. `figures_of(Rebuilt)` defines each figure.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.spatial import ConvexHull
    >>> ball = gppcs.sample("sphere", n_points=3000)
    >>> faces = ConvexHull(ball.points).simplices
    >>> inward = np.linalg.det(ball.points[faces]) < 0
    >>> surface = gppcs.Mesh(ball.points, np.where(inward[:, None], faces[:, ::-1], faces))
    >>> kept = gppcs.simplify(ball, ratio=0.2, method="fps").cloud
    >>> rebuilt = gppcs.evaluate(ball, kept, mesh=surface).rebuilt
    >>> rebuilt.pieces
    1
    """

    mesh: Mesh = dataclasses.field(
        repr=False,
        compare=False,
        metadata={"meaning": "the rebuilt mesh, in the unit and frame of the simplified cloud"},
    )
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
        "of the diagonal, such as stray pieces and membranes over open borders",
    )


@_told
@dataclass(frozen=True)
class MeshReport:
    """The figures of a simplified mesh.

    Lengths are in the unit of the coordinates; `figures(relative=True)` divides them by the diagonal.
    `figures_of(MeshReport)` defines each figure.

    Examples
    --------
    >>> cloud = gppcs.sample("sphere", n_points=3000)
    >>> report = gppcs.evaluate_mesh(cloud, gppcs.mesh(cloud, n_points=100).mesh)
    >>> report.triangles, report.borders, report.genus
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
    borders: int = figure("count", "closed curves of edges with one triangle, such as the rims of holes", None)
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
        """Return all figures by name.

        Parameters
        ----------
        relative : bool
            Whether to divide lengths by the diagonal. The diagonal itself stays.

        Returns
        -------
        dict of str to float
        """
        return _values(self, self.diagonal if relative else None)


@_told
@dataclass(frozen=True)
class Report:
    """The figures of a simplification.

    Lengths are in the unit of the coordinates; `figures(relative=True)` divides them by the diagonal.
    `figures_of(gppcs.Report)` defines each figure.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> report = gppcs.evaluate(cloud, gppcs.simplify(cloud, ratio=0.1, method="fps").cloud)
    >>> isinstance(report, gppcs.Report)
    True
    >>> relative = report.figures(relative=True)
    >>> relative["surface_mean"] == report.surface_mean / report.diagonal
    True
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
    detail: Mapping[str, DetailErrors] = dataclasses.field(
        default_factory=dict, metadata={"meaning": "the errors of the attributes that were named"}
    )
    rebuilt: Rebuilt | None = dataclasses.field(
        default=None,
        metadata={"meaning": "the mesh rebuilt with normals estimated on the simplified cloud, if asked for"},
    )
    rebuilt_carried: Rebuilt | None = dataclasses.field(
        default=None,
        metadata={"meaning": "the same with the normals `nx`, `ny` and `nz` of the cloud, if there are, and a surface"},
    )

    def figures(self, relative: bool = False) -> dict[str, float]:
        """Return all figures by name.

        Parameters
        ----------
        relative : bool
            Whether to divide lengths by the diagonal, and squared lengths by its square. The diagonal itself stays.

        Returns
        -------
        dict of str to float
            The figures of this report and of `rebuilt`, those of `rebuilt_carried` with the prefix "carried_", and
            those of `detail` with the names of the attributes as prefixes.
        """
        values = {}
        parts: list[tuple[str, Report | DetailErrors | Rebuilt | None]] = [("", self)]
        parts += [(f"{name}_", errors) for name, errors in self.detail.items()]
        for prefix, part in (*parts, ("", self.rebuilt), ("carried_", self.rebuilt_carried)):
            of_part = _values(part, self.diagonal if relative else None) if part else {}
            values.update({prefix + name: value for name, value in of_part.items()})
        return values


def figure_called(name: str) -> Figure:
    """Return the figure of a name in `Report.figures` or `MeshReport.figures`."""
    known = {**figures_of(Report), **figures_of(Rebuilt), **figures_of(MeshReport)}
    if (bare := name.removeprefix("carried_")) in known:
        return known[bare]
    # The longest name of a figure of an attribute that the name ends in.
    ends = [each for each in figures_of(DetailErrors) if name.endswith(f"_{each}")]
    return figures_of(DetailErrors)[max(ends, key=len)]


def _values(part: Report | DetailErrors | Rebuilt | MeshReport, diagonal: float | None) -> dict[str, float]:
    """Return the figures of a report by name, relative to a diagonal if one is given."""
    values = {}
    for name, known in figures_of(type(part)).items():
        value = getattr(part, name)
        scaled = relative(known, value, diagonal) if diagonal is not None and name != "diagonal" else None
        values[name] = value if scaled is None else scaled
    return values
