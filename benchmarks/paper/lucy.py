"""The paper's Lucy at ratio 0.002 (Table 1), by the methods that take 14 million points.

If lucy.ply is not in GPPCS_DATA (http://graphics.stanford.edu/data/3Dscanrep/lucy.tar.gz), 14,027,872 samples of the
mesh of the Dragon stand in, with noise: as many points, another shape. Figures beside the paper's are of Lucy alone.
"""

from __future__ import annotations

import experiment
import gppcs
import report
from clouds import NOISE, mesh_sample
from experiment import SECONDS, VARIATION, Column, Condition

RATIO = 0.002
POINTS = 14_027_872
CANDIDATES = 40_000
METHODS = {
    "gp": gppcs.LocalGP(),
    f"gp-spectral, {CANDIDATES:,} candidates": gppcs.SpectralGP(candidates=CANDIDATES),
    f"fps-variation, {CANDIDATES:,} candidates": gppcs.FarthestPointVariation(candidates=CANDIDATES),
    "voxel": gppcs.Voxel(),
    "random": gppcs.Random(),
}
COLUMNS = (
    Column("mean distance to the local surface, 1e-4 diagonals", "surface_mean", 1e4),
    Column("covering radius, 1e-3 diagonals", "covering_radius", 1e3),
    VARIATION,
    SECONDS,
)


def main() -> None:
    """Print and write the table."""
    path = report.DATA / "lucy.ply"
    is_lucy = path.is_file()
    cloud = gppcs.read(path) if is_lucy else gppcs.PointCloud(mesh_sample(POINTS, NOISE))
    name = "Lucy" if is_lucy else "samples of the Dragon's mesh in place of Lucy"
    condition = Condition(name, cloud, RATIO)
    made = experiment.runs([condition], METHODS)
    report.write_sections(
        "paper_lucy",
        f"{name}, {len(cloud):,} points, ratio {RATIO} (paper: Table 1)",
        [experiment.section("", [condition], made, COLUMNS)],
        [path if is_lucy else experiment.path_of("dragon")],
        [experiment.SECONDS_NOTE],
    )


if __name__ == "__main__":
    main()
