"""Compare surfaces rebuilt with normals of the kept points and with normals of the whole cloud.

The points are kept by `fps`. Normals estimated from the kept points get their signs from the mesh. Normals of the whole
cloud have the signs that `gppcs.estimate_normals` finds without the mesh.
"""

from __future__ import annotations

import numpy as np

import gppcs
import report

CASES = (("dragon", 0.03), ("armadillo_50k", 0.05), ("bunny", 0.05), ("nefertiti", 0.05), ("turbine", 0.1))


def row(name: str, ratio: float) -> tuple[str, ...]:
    """Return the row of one cloud."""
    path = report.DATA / f"{name}.ply"
    mesh, cloud = gppcs.read_mesh(path), gppcs.read(path)
    kept = gppcs.simplify(cloud, ratio=ratio, method="fps", normals=True)
    figures = gppcs.evaluate(cloud, kept.cloud, mesh).figures(relative=True)
    estimated, carried = figures["estimated_hausdorff_mean"], figures["carried_hausdorff_mean"]
    cosines = np.einsum("ij,ij->i", kept.cloud.normals(), mesh.vertex_normals()[kept.indices])
    right = (cosines > 0).sum() / (cosines != 0).sum()  # some vertices belong to no triangle
    seconds = report.least_time(lambda: gppcs.estimate_normals(cloud, kept.cloud))
    return (
        f"{name}, {ratio:g}", f"{len(cloud):,}", f"{estimated:.3e}", f"{carried:.3e}",
        f"{100 * (1 - carried / estimated):.1f} %", f"{100 * right:.2f} %", f"{seconds:.2f}",
    )  # fmt: skip


def main() -> None:
    """Print and write the table."""
    report.write(
        "normals",
        "Surfaces rebuilt with normals of the points kept and of the whole cloud, lengths in diagonals",
        (
            "cloud, ratio", "points", "hausdorff mean, normals of the points kept", "of the whole cloud", "less by",
            "right signs", "seconds for the normals",
        ),
        [row(*case) for case in CASES],
        [report.DATA / f"{name}.ply" for name, _ in CASES],
    )  # fmt: skip


if __name__ == "__main__":
    main()
