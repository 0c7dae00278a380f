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

`help(gppcs.simplify)` explains one name. The command `gppcs` does the same work on files; see `gppcs --help`.

Clouds and meshes
    read, write              point cloud files: PLY, LAS, LAZ, XYZ, CSV, PCD, E57, Parquet and others
    open, CloudFiles         one or several files as a cloud, or a part of it: by a box, polygons or a condition
    read_mesh, write_mesh    mesh files: PLY, OBJ, STL, OFF or glTF
    sample                   make a synthetic scan of a surface that is known exactly
    PointCloud, Header       N points, each with the same attributes, and what files say of the whole cloud
    CloudLike                the type of all that functions take for a cloud
    Mesh                     triangles between vertices
    show                     show a cloud or a result in the browser or in a notebook

Simplify, make a mesh
    simplify, Result         choose exactly M points of a cloud, or of files that may be larger than memory
    simplify_batch           the same of many small clouds, such as the (B, N, 3) of a training step: a BatchResult
    simplify_tiles           the same of several files, with a file of kept points for each
    mesh, MeshResult         make a light mesh straight from a dense cloud
    bake_texture, Texture    the colours of all points as a picture on a mesh

Measure
    info, Summary            bounding box, spacing, attributes, repeats and invalid points
    estimate_features        surface variation and normal of each point, as Features
    estimate_normals         normals with consistent signs, at the points or elsewhere on the surface
    find_outliers            which points neither their neighbours nor the surface explain
    evaluate, Report         compare a simplified cloud with the original: distances, errors and angles
    evaluate_mesh            compare a simplified mesh with the original, as a MeshReport
    compare, Entry           run several methods on one cloud and evaluate each result

Methods of simplification, by name in METHODS
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
    Method, parameter        the base class of methods, and how a parameter of one is declared
    Task, Selection          what a method gets, and what it returns
    Feature                  what else a method may be able to do

Runs and errors
    Timer                    the stages of a run and the time that each took
    set_threads              set the number of threads
    GppcsError               the base class of all errors, which are in gppcs.errors
    InputError               the cloud or mesh cannot be used
    ParameterError           a parameter, method or name is wrong

Each name is imported when it is first used. All else is reached by its module, such as gppcs.estimator.Simplifier.
The version is a string:

>>> version = gppcs.__version__
"""

from importlib import import_module
from typing import Any

from gppcs import errors as errors

__version__ = "0.1.0"

# The public names by their modules; type checkers read those of `__init__.pyi`.
_NAMES = {
    "clouds.cloud": "CloudLike PointCloud",
    "clouds.header": "Header",
    "clouds.mesh": "Mesh Texture",
    "drawing.show": "show",
    "drawing.textures": "bake_texture",
    "engine.threads": "set_threads",
    "engine.timer": "Timer",
    "errors": "GppcsError InputError ParameterError",
    "evaluation.comparison": "Entry compare",
    "evaluation.judge": "evaluate evaluate_mesh",
    "evaluation.report": "MeshReport Report",
    "evaluation.summary": "Summary info",
    "io": "CloudFiles read write",
    "io.cloud_files": "open",
    "io.mesh_files": "read_mesh write_mesh",
    "meshing.pipeline": "mesh",
    "meshing.result": "MeshResult",
    "methods": "AIVS METHODS QEM WLOP FarthestPoint FarthestPointVariation HierarchicalClustering LocalGP Method "
    "Feature PCSimp Random SampleElimination Selection SpectralGP Task TopVariation Voxel parameter",
    "result": "BatchResult Result",
    "scans": "sample",
    "simplification": "simplify simplify_batch simplify_tiles",
    "surface.normals": "estimate_normals",
    "surface.outliers": "find_outliers",
    "surface.surface_variation": "Features estimate_features",
}
_MODULE_OF = {name: f"gppcs.{module}" for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted([*_MODULE_OF, "__version__", "errors"])


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'gppcs' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__
