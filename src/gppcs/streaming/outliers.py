"""Outliers of a cloud in files: they are looked for once, before the work, and then left out of all passes."""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from gppcs.clouds.cloud import PointCloud
from gppcs.engine.journal import Journal
from gppcs.engine.stages import Stages
from gppcs.io.cloud_files import CloudFiles
from gppcs.simplification import check_usable
from gppcs.spatial.scaling import Frame
from gppcs.streaming.cluster import Cluster
from gppcs.streaming.overview import NO_ROWS, Overview
from gppcs.streaming.partitions import ClusterPasses, LeftOut
from gppcs.streaming.plan import Plan
from gppcs.streaming.reading import FilePasses
from gppcs.streaming.scratch import scratch_folder, work_name
from gppcs.surface.outliers.tiles import ON_DISK, outliers_in_tiles


class Outliers(NamedTuple):
    """The outliers of a cloud in files.

    Attributes
    ----------
    left_out : LeftOut
    cloud : PointCloud or None
        These points with their attributes, if they are wanted.
    """

    left_out: LeftOut
    cloud: PointCloud | None


class OutlierSearch:
    """A search for the outliers of a cloud in files. Use it in a `with` statement around all work on the cloud.

    Parameters
    ----------
    files : CloudFiles
    invalid : str
        As for `simplify_files`.
    listed : bool
        Whether the outliers are wanted with their attributes.
    stages : Stages
        Times "bounds", "sample", "boxes", "outliers" and "listed outliers". A step is a point.
    scratch : path, optional
        As for `simplify_files`.
    cluster : Cluster, optional
        Where to work; by default in this process.
    resume : bool
        As for `simplify_files`. What is found stays until the block ends without an error.
    """

    def __init__(
        self,
        files: CloudFiles,
        invalid: str,
        listed: bool,
        stages: Stages,
        scratch: Path | None = None,
        cluster: Cluster | None = None,
        resume: bool = False,
    ) -> None:
        self._files, self._invalid, self._listed, self._stages = files, invalid, listed, stages
        self._scratch, self._cluster, self._resume = scratch, cluster, resume
        self._found: Outliers | None = None
        self._stack = ExitStack()

    def __enter__(self) -> OutlierSearch:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, traceback)

    def found(self, plan: Plan) -> Outliers:
        """Return the outliers, after looking for them if that has not been done.

        Parameters
        ----------
        plan : Plan
            Made for the files. It tells how large chunks are.

        Returns
        -------
        Outliers

        Raises
        ------
        ClusterError, FileFormatError, InputError, OSError, ParameterError
            As for `simplify_files`.
        """
        if self._found is None:
            asked = ("outliers", self._invalid, self._listed, self._cluster is not None)
            name = work_name(self._files, asked) if self._resume else None
            folder = self._stack.enter_context(scratch_folder(self._scratch, ON_DISK * plan.points, name))
            self._found = Journal(folder).once("outliers", lambda: self._search(plan, folder / "tiles"))
            shutil.rmtree(folder / "tiles", ignore_errors=True)
        return self._found

    def _search(self, plan: Plan, folder: Path) -> Outliers:
        """Look for the outliers with temporary files in a folder."""
        folder.mkdir(exist_ok=True)
        passes = passes_over(self._files, plan, self._cluster)
        seen = Journal(folder).once("bounds", lambda: self._overview(passes, plan))
        check_usable(seen.count, seen.bad, seen.first_bad, self._invalid)
        frame = Frame.around(seen.low, seen.high)
        points, (high,) = passes.points(seen, frame), frame.local(seen.high[None])
        rows = outliers_in_tiles(points, high, folder, self._stages, self._cluster.each if self._cluster else map)
        cloud = None
        if self._listed or seen.bad:
            with self._stages("listed outliers", seen.usable) as advanced:
                rows, clouds = passes.kept(seen, rows, advanced)
            none = self._files.head().cloud.take(NO_ROWS)
            cloud = seen.columns.joined(clouds or [none]) if self._listed else None
        starts = passes.starts(seen) if isinstance(passes, ClusterPasses) else [0]
        return Outliers(LeftOut(rows, starts), cloud)

    def _overview(self, passes: FilePasses | ClusterPasses, plan: Plan) -> Overview:
        with self._stages("bounds", plan.points) as advanced:
            return passes.overview(advanced)


def passes_over(
    files: CloudFiles, plan: Plan, cluster: Cluster | None, left_out: LeftOut | None = None
) -> FilePasses | ClusterPasses:
    """Return passes over files, in this process or on workers.

    Parameters
    ----------
    files : CloudFiles
    plan : Plan
        Made for them.
    cluster : Cluster, optional
    left_out : LeftOut, optional
        Points that are left out.

    Returns
    -------
    FilePasses or ClusterPasses
    """
    if cluster:
        return ClusterPasses(files, plan.rows, cluster, plan.part, left_out)
    return FilePasses(files, plan.rows) if left_out is None else FilePasses(files, plan.rows, left_out.rows)
