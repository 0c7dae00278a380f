"""Thin a point cloud to exactly the number of points asked for, and keep its features.

>>> import gppcs
>>> cloud = gppcs.sample("bracket", n_points=20_000)  # or gppcs.read("scan.ply"), or any (N, 3) array
>>> result = gppcs.simplify(cloud, ratio=0.05)
>>> result.cloud
PointCloud(1,000 points, each with nx, ny, nz, curvature, red, green, blue)
>>> gppcs.write("small.ply", result.cloud)
>>> gppcs.estimate_normals(cloud, at=result.cloud).shape
(1000, 3)
>>> gppcs.simplify(cloud, n_points=500, method=gppcs.LocalGP(feature_weight=0.8)).cloud.points.shape
(500, 3)
>>> list(gppcs.METHODS)[:3]
['gp', 'gp-spectral', 'fps-variation']

`help(gppcs.simplify)` explains one name. The command `gppcs` does the same work on files; see `gppcs --help`.

Get a cloud
    read                     read a point cloud file: PLY, LAS, LAZ, XYZ, CSV, PCD, E57, Parquet and others
    sample                   make a synthetic scan of a surface that is known exactly
    PointCloud               N points, each with the same attributes
    Header                   what a file says of a whole cloud, such as comments

Simplify it
    simplify                 choose exactly M points of a cloud
    simplify_files           the same for files that may be larger than memory
    Result                   the simplified cloud, the rows chosen, and the time it took
    Simplifier               a transformer of scikit-learn that does it
    write                    write a cloud to a file

Make a mesh of it
    mesh                     make a light mesh straight from a dense cloud
    MeshResult               the mesh, the rows of its vertices, and the time it took
    write_mesh               write a mesh file: PLY, OBJ, STL, OFF or glTF
    Mesh                     triangles between vertices
    read_mesh                read a mesh file

Measure a cloud
    info                     bounding box, spacing, attributes, repeats and invalid points
    Summary                  what `info` returns
    estimate_features        surface variation and normal of each point
    Features                 what `estimate_features` returns
    find_outliers            which points neither their neighbours nor the surface explain
    estimate_normals         normals with consistent signs, at the points or elsewhere on the surface

Judge a simplification
    evaluate                 compare a simplified cloud with the original
    Report                   what `evaluate` returns: distances, errors and angles
    DetailErrors             the part of a report that compares an attribute
    Rebuilt                  the part of a report that compares rebuilt meshes
    evaluate_mesh            compare a simplified mesh with the original
    MeshReport               what `evaluate_mesh` returns: distances, topology and thin triangles
    figures_of               unit and definition of each figure of a report
    Figure                   unit and definition of one figure
    compare                  run several methods on one cloud and evaluate each result
    Entry                    what `compare` returns for one method
    compare_meshes           make a light mesh in several ways and evaluate each
    MeshEntry                what `compare_meshes` returns for one way

Methods of simplification
    METHODS                  every method by the name that `simplify` takes, such as "gp"
    LocalGP                  "gp", the default: a local Gaussian process of the surface variation
    SpectralGP               "gp-spectral": Algorithm 1 of the GP-PCS paper
    FarthestPointVariation   "fps-variation": farthest points, then the largest surface variation
    TopVariation             "top-variation": the points of largest surface variation
    FarthestPoint            "fps": farthest point sampling
    Random                   "random": a random choice
    HierarchicalClustering   "hc": hierarchical clustering
    WLOP                     "wlop": weighted locally optimal projection
    SampleElimination        "sample-elimination": blue noise by removing the most crowded points
    Voxel                    "voxel": one point for each cell of a grid
    AIVS                     "aivs": farthest points in each voxel
    PCSimp                   "pc-simp": a graph filter
    QEM                      "qem": quadric error metrics

Write a method, follow a run
    Method                   the base class of all methods
    Parameter                type, default and meaning of one parameter of a method
    parameter                declare a parameter of a method of your own
    Task                   what is wanted of a method
    Selection                what a method returns
    Timer                   the stages of a run and the time that each took
    ProgressBar              draws a progress bar, in a terminal or a notebook
    Listener                 hears of each stage, for instance to draw a progress bar of your own
    set_threads              set the number of threads

Errors
    GppcsError               the base class of all errors of gppcs
    InputError               the cloud or mesh cannot be used
    NoSurfaceError           no surface could be rebuilt from the points
    ParameterError           a parameter, method or name is wrong
    FileFormatError          the content of a file is not what its format promises
    OutputError              a file cannot be written
    MissingExtraError        an optional package is not installed
    ClusterError             the workers of a cluster cannot be used

Each name is imported when it is first used. The version is a string:

>>> version = gppcs.__version__
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from gppcs.clouds import above

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud as PointCloud
    from gppcs.clouds.header import Header as Header
    from gppcs.clouds.mesh import Mesh as Mesh
    from gppcs.clouds.summary import Summary as Summary
    from gppcs.clouds.summary import info as info
    from gppcs.engine.progress import ProgressBar as ProgressBar
    from gppcs.engine.threads import set_threads as set_threads
    from gppcs.engine.timer import Listener as Listener
    from gppcs.engine.timer import Timer as Timer
    from gppcs.errors import ClusterError as ClusterError
    from gppcs.errors import FileFormatError as FileFormatError
    from gppcs.errors import GppcsError as GppcsError
    from gppcs.errors import InputError as InputError
    from gppcs.errors import MissingExtraError as MissingExtraError
    from gppcs.errors import NoSurfaceError as NoSurfaceError
    from gppcs.errors import OutputError as OutputError
    from gppcs.errors import ParameterError as ParameterError
    from gppcs.estimator import Simplifier as Simplifier
    from gppcs.evaluation.comparison import Entry as Entry
    from gppcs.evaluation.comparison import compare as compare
    from gppcs.evaluation.judge import evaluate as evaluate
    from gppcs.evaluation.judge import evaluate_mesh as evaluate_mesh
    from gppcs.evaluation.mesh_comparison import MeshEntry as MeshEntry
    from gppcs.evaluation.mesh_comparison import compare_meshes as compare_meshes
    from gppcs.evaluation.report import DetailErrors as DetailErrors
    from gppcs.evaluation.report import Figure as Figure
    from gppcs.evaluation.report import MeshReport as MeshReport
    from gppcs.evaluation.report import Rebuilt as Rebuilt
    from gppcs.evaluation.report import Report as Report
    from gppcs.evaluation.report import figures_of as figures_of
    from gppcs.io import read as read
    from gppcs.io import write as write
    from gppcs.io.mesh_files import read_mesh as read_mesh
    from gppcs.io.mesh_files import write_mesh as write_mesh
    from gppcs.meshing.pipeline import MeshResult as MeshResult
    from gppcs.meshing.pipeline import mesh as mesh
    from gppcs.methods import AIVS as AIVS
    from gppcs.methods import METHODS as METHODS
    from gppcs.methods import QEM as QEM
    from gppcs.methods import WLOP as WLOP
    from gppcs.methods import FarthestPoint as FarthestPoint
    from gppcs.methods import FarthestPointVariation as FarthestPointVariation
    from gppcs.methods import HierarchicalClustering as HierarchicalClustering
    from gppcs.methods import LocalGP as LocalGP
    from gppcs.methods import Method as Method
    from gppcs.methods import PCSimp as PCSimp
    from gppcs.methods import Random as Random
    from gppcs.methods import SampleElimination as SampleElimination
    from gppcs.methods import Selection as Selection
    from gppcs.methods import SpectralGP as SpectralGP
    from gppcs.methods import Task as Task
    from gppcs.methods import TopVariation as TopVariation
    from gppcs.methods import Voxel as Voxel
    from gppcs.methods.parameters import Parameter as Parameter
    from gppcs.methods.parameters import parameter as parameter
    from gppcs.scans import sample as sample
    from gppcs.simplification import Result as Result
    from gppcs.simplification import simplify as simplify
    from gppcs.streaming.files import simplify_files as simplify_files
    from gppcs.surface.normals import estimate_normals as estimate_normals
    from gppcs.surface.outliers import find_outliers as find_outliers
    from gppcs.surface.surface_variation import Features as Features
    from gppcs.surface.surface_variation import estimate_features as estimate_features

__version__ = "0.1.0"

_HOMES = {  # the module that defines each public name
    "clouds.cloud": ("PointCloud",),
    "clouds.header": ("Header",),
    "clouds.mesh": ("Mesh",),
    "clouds.summary": ("Summary", "info"),
    "engine.progress": ("ProgressBar",),
    "engine.timer": ("Listener", "Timer"),
    "engine.threads": ("set_threads",),
    "errors": (
        "ClusterError",
        "FileFormatError",
        "GppcsError",
        "InputError",
        "MissingExtraError",
        "NoSurfaceError",
        "OutputError",
        "ParameterError",
    ),
    "estimator": ("Simplifier",),
    "evaluation.comparison": ("Entry", "compare"),
    "evaluation.judge": ("evaluate", "evaluate_mesh"),
    "evaluation.mesh_comparison": ("MeshEntry", "compare_meshes"),
    "evaluation.report": ("DetailErrors", "Figure", "MeshReport", "Rebuilt", "Report", "figures_of"),
    "io": ("read", "write"),
    "io.mesh_files": ("read_mesh", "write_mesh"),
    "meshing.pipeline": ("MeshResult", "mesh"),
    "methods": (
        "AIVS",
        "METHODS",
        "QEM",
        "WLOP",
        "FarthestPoint",
        "FarthestPointVariation",
        "HierarchicalClustering",
        "LocalGP",
        "Method",
        "PCSimp",
        "Random",
        "SampleElimination",
        "Selection",
        "SpectralGP",
        "TopVariation",
        "Voxel",
        "Task",
    ),
    "methods.parameters": ("Parameter", "parameter"),
    "streaming.files": ("simplify_files",),
    "scans": ("sample",),
    "simplification": ("Result", "simplify"),
    "surface.normals": ("estimate_normals",),
    "surface.outliers": ("find_outliers",),
    "surface.surface_variation": ("Features", "estimate_features"),
}

_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
__all__ = sorted([*_HOME_OF, "__version__"])

if not TYPE_CHECKING:  # type checkers would take any name for one that is there

    def __getattr__(name: str) -> Any:
        """Import a public name when it is first used."""
        if name not in _HOME_OF:
            raise AttributeError(f"module 'gppcs' has no attribute {name!r}")
        value = globals()[name] = getattr(importlib.import_module(f"gppcs.{_HOME_OF[name]}"), name)
        return value


def __dir__() -> list[str]:
    return __all__


def _later(home: str, name: str) -> Any:
    """Return a function of a module that is imported when it is called."""
    return lambda *given, **options: getattr(importlib.import_module(f"gppcs.{home}"), name)(*given, **options)


# Clouds are below the files that hold them, the methods that rank them and what draws them.
above.read, above.laspy_of = _later("io", "read"), _later("io.las", "laspy_of")
above.rank = lambda cloud, method, count: (
    _later("simplification", "simplify")(cloud, method=method, n_points=count).indices
)
above.html_of, above.show = _later("drawing.notebook", "html_of"), _later("drawing.notebook", "show")
