"""The share of the points kept by APES that lie near sharp edges, beside random points.

Run as `python benchmarks/learned/edges.py`. The airplane and the toilet are those of ModelNet, if GPPCS_DATA has their
meshes; the others are shapes of the training set's kinds with numbers that training did not see.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1]))

import gppcs
import report
import training_set
from gppcs_learned import APES, APESGlobal, Potamias

METHODS: tuple[str | gppcs.Method, ...] = (
    "random", APES(), APESGlobal(), Potamias(), "gp", "fps", "top-variation"
)  # fmt: skip
RATIOS = (0.5, 0.25)
ANGLE, REACH = 40.0, 2.0  # degrees between the two sides of a sharp edge; spacings within which a point is near it
POINTS, DENSE = 2048, 200_000  # of a cloud; of a procedural shape, to find its edges
UNSEEN = 10_000  # number of a shape that training did not see
SCANNED = {"airplane, ModelNet": "modelnet_airplane_0001", "toilet, ModelNet": "modelnet_toilet_0001"}
MADE = {"airplane, procedural": "aircraft", "glass, procedural": "glasses", "toilet, procedural": "toilets"}
Array = NDArray[np.float64]
NOTES = (
    f"Near an edge: within {REACH:g} spacings of an edge whose sides meet at more than {ANGLE:g} degrees. The spacing "
    "is that of gppcs.info, the median distance to the nearest other point.",
    "In brackets: times the share of all points. No method can be above the oracle, which knows the edges and keeps "
    "the points nearest to them: 1 / r at ratio r, or 1 over the share of all points if that is less.",
    "Planes of faces have no sign on the ModelNet meshes, which are soups of polygons, partly inside each other. Edges "
    f"of procedural shapes are where normals of near points, of {DENSE:,}, differ by more than the angle.",
    f"Each cloud has {POINTS:,} random points. The weights are ours, trained on procedural shapes, not the authors'.",
)


def edges_of_mesh(mesh: gppcs.Mesh, step: float) -> Array:
    """Return points along the sharp edges of a mesh, (n, 3), at most a step apart."""
    vertices, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = number.reshape(-1)[mesh.faces]
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    lengths = np.linalg.norm(normals, axis=1)
    faces, normals = faces[lengths > 0], normals[lengths > 0] / lengths[lengths > 0, None]
    pairs = np.sort(np.concatenate([faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(pairs.T)
    pairs, owner = pairs[order], owner[order]
    same = (pairs[1:] == pairs[:-1]).all(axis=1)
    cosines = abs((normals[owner[1:]] * normals[owner[:-1]]).sum(axis=1))
    sharp = pairs[1:][same & (cosines < np.cos(np.radians(ANGLE)))]
    starts, ends = vertices[sharp[:, 0]], vertices[sharp[:, 1]]
    counts = np.ceil(np.linalg.norm(ends - starts, axis=1) / step).astype(int) + 1
    return np.concatenate([
        np.linspace(a, b, count) for a, b, count in zip(starts, ends, counts, strict=True)
    ])  # fmt: skip


def edges_of_shape(kind: int, number: int, *, upright: bool = False) -> tuple[Array, Array]:
    """Return a random cloud of a procedural shape, (POINTS, 3), and dense points beside its sharp edges, (n, 3)."""
    points, normals = training_set.draw(kind, number, DENSE, upright=upright)
    near = cKDTree(points).query(points, 9)[1][:, 1:]
    cosines = np.einsum("ic,ikc->ik", normals, normals[near])
    return points[:POINTS], points[(cosines < np.cos(np.radians(ANGLE))).any(axis=1)]


def rows_of(cloud: gppcs.PointCloud, edges: Array) -> list[list[str]]:
    """Return the row of each method: the share near edges at each ratio."""
    tree, reach = cKDTree(edges), REACH * gppcs.info(cloud).spacing

    def share(points: Array) -> float:
        return float((tree.query(points)[0] <= reach).mean())

    of_all = share(cloud.points)
    nearest_first = cloud.points[np.argsort(tree.query(cloud.points)[0], kind="stable")]
    shares = {"oracle": [share(nearest_first[: round(ratio * len(cloud))]) for ratio in RATIOS]}
    for method in METHODS:
        shares[str(method)] = [
            share(gppcs.simplify(cloud, ratio=ratio, method=method).cloud.points) for ratio in RATIOS
        ]
    rows = [[name, *(f"{value:.3f} ({value / of_all:.2f})" for value in values)] for name, values in shares.items()]
    return [["all points", *[f"{of_all:.3f}"] * len(RATIOS)], *rows]


def main() -> None:
    """Print and write the tables."""
    header = ["method", *(f"share near edges, ratio {ratio}" for ratio in RATIOS)]
    sections, data = [], []
    for title, name in SCANNED.items():
        path = report.DATA / f"{name}.ply"
        if not path.exists():
            continue
        cloud, mesh = gppcs.read(report.DATA / f"{name}_2048.ply"), gppcs.read_mesh(path)
        edges = edges_of_mesh(mesh, gppcs.info(cloud).spacing / 2)
        sections.append(report.Section(title, header, rows_of(cloud, edges)))
        data.append(path)
    for title, kind in MADE.items():
        points, edges = edges_of_shape(list(training_set.KINDS).index(kind), UNSEEN)
        sections.append(report.Section(title, header, rows_of(gppcs.PointCloud.from_object(points), edges)))
    report.write_sections("learned_edges", "Points near edges: APES beside random points", sections, data, NOTES)


if __name__ == "__main__":
    main()
