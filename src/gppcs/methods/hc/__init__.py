"""The method `hc`: hierarchical clustering."""

from dataclasses import dataclass

from gppcs.methods.method import Method, Selection, Task


@dataclass(frozen=True)
class HierarchicalClustering(Method):
    """Hierarchical clustering."""

    name = "hc"
    summary = "hierarchical clustering: the central point of each cluster of low surface variation"
    description = (
        "Splits the cloud into as many clusters as points asked for, and keeps the most central point of each. The "
        "cluster with the largest product of surface variation and number of points is split next, so clusters are "
        "large where the surface is flat and small where it bends. The form of the publication has limits for size "
        "and variation, and does not fix the number of points; it is "
        "gppcs.methods.hc.clustering.hierarchical_clusters."
    )
    source = "Pauly, Gross and Kobbelt 2002"
    _bytes_per_point = 110

    def __call__(self, task: Task) -> Selection:
        from gppcs.methods.hc.clustering import hierarchical_clusters

        with task.timer("clusters"):
            return Selection(hierarchical_clusters(task.points, maximum=task.n_points))
