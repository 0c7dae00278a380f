"""The method `aivs`: farthest points voxel by voxel (approximate intrinsic voxel structure)."""

from dataclasses import dataclass

from gppcs.methods.method import Method, Selection, Task


@dataclass(frozen=True)
class AIVS(Method):
    """Farthest points voxel by voxel: the isotropic form of AIVS."""

    name = "aivs"
    summary = "farthest points voxel by voxel, in each voxel as many as its share of the points"
    description = (
        "Divides the bounding box into voxels. In each voxel, farthest point sampling chooses as many points as its "
        "share of the cloud, away from the points chosen in the voxels around it. Distances are Euclidean, as in the "
        "program that the authors published; their forms that follow curvature and sharp edges are not public."
    )
    source = "Lv, Lin and Zhao 2021, the isotropic form"
    _bytes_per_point = 170

    def __call__(self, task: Task) -> Selection:
        from gppcs.methods.aivs.voxels import points_of_voxels

        with task.timer("voxels", 8) as on_progress:
            return Selection(points_of_voxels(task.points, task.n_points, on_progress))
