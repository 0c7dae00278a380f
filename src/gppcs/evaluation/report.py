"""The figures of a simplification: the unit and the definition of each, which the help and the docs print."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from gppcs.clouds.mesh import Mesh

Unit = Literal["count", "length", "squared length", "degrees", "share", "ratio"]


@dataclass(frozen=True)
class Figure:
    """The unit and the definition of a figure.

    Attributes
    ----------
    unit : str
        Lengths are in the unit of the coordinates.
    definition : str
        One sentence.
    better : str, optional
        Whether "less" or "more" is better; of some neither is.
    """

    unit: Unit
    definition: str
    better: Literal["less", "more"] | None = None

    def relative(self, value: float, diagonal: float) -> float | None:
        """Return a length in diagonals, a squared length in squared diagonals; None for what has no length."""
        power = {"length": 1, "squared length": 2}.get(self.unit)
        return None if power is None or not diagonal > 0 else value / diagonal**power


def figure(unit: Unit, definition: str, better: Literal["less", "more"] | None = "less") -> Any:
    """Return the field of a dataclass that holds a figure."""
    return dataclasses.field(metadata={"figure": Figure(unit, definition, better)})


def figures_of(report: type) -> Mapping[str, Figure]:
    """Return the figures of a dataclass by name, in order."""
    return {field.name: field.metadata["figure"] for field in dataclasses.fields(report) if "figure" in field.metadata}


@dataclass(frozen=True)
class Rebuilt:
    """The screened Poisson mesh of a simplified cloud, and its figures beside the original mesh.

    `gppcs.figures_of(Rebuilt)` gives the definition of each figure.

    Attributes
    ----------
    mesh : Mesh
        The rebuilt mesh, where the simplified cloud lies.
    """

    mesh: Mesh = dataclasses.field(repr=False, compare=False)
    hausdorff_mean: float = figure(
        "length", "mean distance from the vertices of the original mesh to the rebuilt mesh (the paper's H mean)"
    )
    hausdorff_max: float = figure("length", "largest of those distances (the paper's H max)")
    back_mean: float = figure("length", "mean distance from the vertices of the rebuilt mesh to the original mesh")
    back_max: float = figure("length", "largest of those distances")
    pieces: int = figure("count", "connected pieces of the rebuilt mesh", None)
    stray_share: float = figure(
        "share",
        "share of the rebuilt mesh's area with a corner farther from the original mesh than a twentieth of the "
        "diagonal: stray pieces, and membranes over open borders",
    )


@dataclass(frozen=True)
class Report:
    """The figures of a simplification; `gppcs.figures_of(Report)` gives the definition of each.

    Lengths are in the unit of the coordinates; `figures` can put them in relation to the diagonal.

    Attributes
    ----------
    rebuilt : Rebuilt, optional
        Where there was a mesh: its figures with normals estimated on the simplified cloud, the paper's way.
    rebuilt_carried : Rebuilt, optional
        Where the simplified cloud carries normals (nx, ny, nz) too: its figures with these.
    """

    points_in: int = figure("count", "points of the original, N", None)
    points_out: int = figure("count", "points of the simplified cloud, M", None)
    diagonal: float = figure("length", "diagonal of the original's bounding box", None)
    covering_radius: float = figure("length", "largest distance from an original point to the nearest kept one")
    mean_distance: float = figure("length", "mean of those distances")
    chamfer: float = figure(
        "squared length", "mean squared distance to the nearest point, both ways, summed (the paper's CD)"
    )
    surface_mean: float = figure(
        "length", "mean distance from the original points to the local surface of the simplified cloud"
    )
    surface_rms: float = figure("length", "root mean square of those distances")
    surface_p95: float = figure("length", "95th percentile of those distances")
    surface_max: float = figure("length", "largest of those distances")
    feature_error: float = figure(
        "length",
        "mean of those distances, each times the angle, in radians, between the normals of the original and of the "
        "local surface there",
    )
    feature_recall: float = figure(
        "share",
        "share of the tenth of the original points with the largest surface variation that have a kept point within "
        "the target spacing, the root of the surface's area over M",
        "more",
    )
    normal_deviation: float = figure(
        "degrees", "mean angle between the normals estimated at an original point and at the nearest kept one"
    )
    mean_surface_variation: float = figure(
        "ratio",
        "mean surface variation of the simplified cloud, measured on it with the paper's radius for 25 neighbours, "
        "which depends on the bounding box and so on how the cloud is turned, or, where that is more than three times "
        "off the radius of a disc of 25 squared target spacings, with the latter",
        "more",
    )
    rebuilt: Rebuilt | None = None
    rebuilt_carried: Rebuilt | None = None

    def figures(self, relative: bool = False) -> dict[str, float]:
        """Return all figures by name, those with carried normals prefixed "carried_".

        Parameters
        ----------
        relative : bool
            Whether lengths are to be in diagonals, and squared lengths in squared diagonals.
        """
        values = {}
        for prefix, part in (("", self), ("", self.rebuilt), ("carried_", self.rebuilt_carried)):
            for name, known in figures_of(type(part)).items() if part else ():
                value = getattr(part, name)
                scaled = known.relative(value, self.diagonal) if relative and name != "diagonal" else None
                values[prefix + name] = value if scaled is None else scaled
        return values
