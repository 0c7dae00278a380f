"""Simplify files that may be larger than memory."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Literal

from numpy.typing import ArrayLike

from gppcs.amounts.accuracy import Measure
from gppcs.amounts.amount import Amount
from gppcs.amounts.guide import check_guided_amount
from gppcs.engine.stages import Stages
from gppcs.errors import ParameterError, file_path, flag, shown
from gppcs.io.cloud_files import CloudFiles
from gppcs.io.query import Query
from gppcs.methods import DEFAULT, Method
from gppcs.simplification import Result, resolved, simplify
from gppcs.streaming.asked import plan_for
from gppcs.streaming.cluster import Cluster
from gppcs.streaming.outliers import OutlierSearch
from gppcs.streaming.passes import simplify_in_passes
from gppcs.streaming.sizes import bytes_of


def simplify_files(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    ratio: float | None = None,
    n_points: int | None = None,
    tolerance: float | str | None = None,
    measure: Measure | None = None,
    spacing: float | str | None = None,
    max_gap: float | str | None = None,
    unit: str | None = None,
    keep: str | ArrayLike | None = None,
    weight: str | ArrayLike | None = None,
    method: str | Method = DEFAULT,
    seed: int | None = None,
    invalid: Literal["error", "drop"] = "error",
    normals: bool = False,
    scores: bool = False,
    drop_outliers: bool = False,
    format: str | None = None,  # noqa: A002
    columns: Sequence[str] | None = None,
    box: Sequence[float] | None = None,
    resolution: float | None = None,
    only: str | None = None,
    drop: str | None = None,
    polygon: str | os.PathLike[str] | None = None,
    assume_same_crs: bool = False,
    memory: int | str | None = None,
    scratch: str | os.PathLike[str] | None = None,
    client: Any = None,
    resume: bool = False,
    stages: Stages | None = None,
) -> Result:
    """Choose exactly M points of a cloud in files, which may be larger than memory.

    If the cloud fits into the memory allowed, it is read and simplified as by `gppcs.simplify`. Otherwise the method
    `gp` reads the files several times, in chunks, and holds a sample of the points, candidates and the kept points
    alone. It chooses the same points, to the last bit of `indices`. If the candidates do not fit, either, it stores the
    points in temporary files and chooses tile by tile: other points than in memory, but as good ones, and no seam
    shows. `voxel`, too, chooses tile by tile, the same points as in memory. So does `fps`, but other points, and
    `random` draws others. In no case does the result depend on how the points are divided into files and chunks. The
    other methods need all points in memory.

    Parameters
    ----------
    paths : path, or sequence of paths
        One file or several, in any format that `gppcs.read` reads. Several files are one cloud: its points are those of
        the first, then those of the second and so on. They must have the same attributes. A virtual point cloud (.vpc)
        stands for the files that it lists.
    ratio, n_points, method, seed, invalid, normals, scores, drop_outliers, stages
        As for `gppcs.simplify`. Normals need all points in memory. Outliers are the same ones, whatever the memory.
    tolerance, measure, spacing, max_gap, unit, keep, weight
        As for `gppcs.simplify`. All points must be in memory: for methods other than `gp`, if `tolerance`, `spacing`,
        `keep`, `weight` or `max_gap` alone is given; for `keep` that is no condition; for `weight` that is no name.
        `tolerance`, `keep` and `weight` do not work in tiles. If not all points are in memory, `tolerance` keeps its
        promise, but each repeat of a point counts, and the number of points may differ a little.
    format, columns
        As for `gppcs.read`, for all files. A text table whose columns are named so is read as a whole.
    box, resolution, only, drop, polygon
        As for `gppcs.read`: which points of each file to read. Only these are the cloud, and `indices` are rows
        among them.
    assume_same_crs : bool
        Whether all files get the coordinate system of the first one. Otherwise, files with different coordinate
        systems are an error.
    memory : int or str, optional
        How much memory the process may hold: bytes, or a text such as "4GB" or "512 MiB". By default, half of what is
        free.
    scratch : path, optional
        An existing folder for temporary files, on a disk with enough space; by default the system's.
    client : distributed.Client, optional
        Of a Dask cluster, whose workers then make the passes and work on the tiles (docs/cluster.md). They must see the
        files, and `scratch`, at the same paths.
    resume : bool
        Whether to keep, if the work is interrupted, what is done of it in a folder in `scratch`, and to go on from what
        an interrupted call with the same files and parameters has kept. A call that succeeds removes the folder. Work
        in memory begins anew.

    Returns
    -------
    Result
        As of `gppcs.simplify` for the whole cloud.

    Raises
    ------
    ClusterError
        If the workers cannot be reached, have another version of gppcs, or end again and again.
    FileFormatError
        If a file is damaged, its format is unknown, `resolution` is given and the file is not COPC, or the files do
        not fit each other.
    InputError
        As for `gppcs.simplify`, and if the work would take more memory than allowed, or no point is in the box.
    ParameterError
        As for `gppcs.simplify`, and if `memory` is no number of bytes, or `format`, `columns`, `box` or `resolution` is
        not as above.
    OutputError
        If `scratch` does not exist, or its disk has too little space.
    OSError
        If a file does not exist or cannot be read.

    Examples
    --------
    >>> cloud = gppcs.sample("bracket", n_points=20_000)
    >>> gppcs.write("east.ply", cloud.take(range(12_000)))
    >>> gppcs.write("west.ply", cloud.take(range(12_000, 20_000)))
    >>> result = gppcs.simplify_files(["east.ply", "west.ply"], n_points=500, memory="2GB")
    >>> (result.indices == gppcs.simplify(cloud, n_points=500).indices).all()
    np.True_
    """
    if isinstance(paths, str | os.PathLike):
        paths = [paths]
    if not isinstance(paths, Sequence) or not paths:
        raise ParameterError(f"expected a file or a list of files, found {shown(paths)}")
    stages, normals, scores = Stages.of(stages), flag("normals", normals), flag("scores", scores)
    resume, drop_outliers = flag("resume", resume), flag("drop_outliers", drop_outliers)
    query = Query.of(box, resolution, only, drop, polygon)
    Amount.of(ratio, n_points, tolerance, spacing, max_gap, measure)
    check_guided_amount(spacing, keep, weight)
    asked: dict[str, Any] = {"ratio": ratio, "n_points": n_points, "tolerance": tolerance, "spacing": spacing}
    asked |= {"max_gap": max_gap, "keep": keep, "weight": weight, "unit": unit, "invalid": invalid}
    asked["measure"] = measure
    folder = None if scratch is None else file_path(scratch)
    with CloudFiles.of(paths, format, columns, query, assume_same_crs) as files, ExitStack() as stack:
        chosen, limit = resolved(method, seed), None if memory is None else bytes_of(memory)
        cluster = None if client is None else Cluster(client)
        search = OutlierSearch(files, invalid, False, stages, folder, cluster, resume) if drop_outliers else None
        if search:
            stack.enter_context(search)
        whole = "normals" if normals else None
        made, options = plan_for(files, chosen, asked, limit, whole, cluster, stages, search)
        if made.in_memory:
            with stages("reading"):
                cloud = files.read()
            asked |= {"normals": normals, "scores": scores, "drop_outliers": drop_outliers}
            return simplify(cloud, method=chosen, stages=stages, **asked)
        options |= {"invalid": invalid, "scores": scores, "scratch": folder, "cluster": cluster, "resume": resume}
        return simplify_in_passes(files, made, chosen, stages=stages, **options)[0]
