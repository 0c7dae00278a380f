"""What attributes that count beside the shape gain: colours and intensity of painted samples and of real scans.

Rivals are gp without detail, farthest points, and `meshopt_simplifyPoints` with its colours (package meshoptimizer).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from time import process_time
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import lsqr

import gppcs
import report
from gppcs.clouds.ranges import AttributeRange
from gppcs.scans.painted import BARE, MARKED
from gppcs.surface.local_surface import LocalSurface
from scans import sample

RATIO = 0.03
SIZE = 400_000  # points of a sample
REPEATS = 3
NOISE = 0.0002  # of the street, in diagonals: 4 mm
ROUNDS, SMALL = 6, 0.003  # of a fit of values; errors below this, in ranges, have the weight of this one


@dataclass(frozen=True)
class Case:
    """A cloud, the attribute that counts, and its true values where they are known."""

    name: str
    attribute: str
    cloud: gppcs.PointCloud
    truth: gppcs.PointCloud
    scanned: bool = False  # Whether the cloud is a real scan

    @classmethod
    def sample(cls, name: str, attribute: str) -> Case:
        """Return a painted sample. The true intensity is that of its markings."""
        cloud = truth = sample(name, SIZE, noise=NOISE if name == "street" else 0.0)
        if attribute == "intensity":
            clean = np.where(cloud.attributes["marking"] == 1, MARKED, BARE).astype(np.uint16)
            truth = replace(cloud, attributes={**cloud.attributes, attribute: clean})
        return cls(name, attribute, cloud, truth)

    @classmethod
    def scan(cls, file: str, attribute: str) -> Case:
        """Return a real scan; what is noise of its attribute is not known."""
        cloud = gppcs.read(report.DATA / file)
        return cls(file.partition(".")[0], attribute, cloud, cloud, scanned=True)


def kept_by_meshopt(case: Case, count: int) -> gppcs.PointCloud:
    """Return what `meshopt_simplifyPoints` keeps, with colours in OKLab or a number as grey; at most `count` points."""
    import meshoptimizer

    values = AttributeRange.from_cloud(case.cloud, case.attribute).values(case.cloud)
    colours = np.ascontiguousarray(np.repeat(values, 3, axis=1) if values.shape[1] == 1 else values)
    places = case.cloud.points - case.cloud.points.min(axis=0)
    places = np.ascontiguousarray(places / places.max(), dtype=np.float32)
    rows = np.empty(len(places), dtype=np.uint32)
    found = meshoptimizer.simplify_points(rows, places, colours, target_vertex_count=count)
    return case.cloud.take(rows[:found].astype(np.int64))


def kept_by(case: Case, count: int, **arguments: Any) -> gppcs.PointCloud:
    """Return what a method of ours keeps."""
    return gppcs.simplify(case.cloud, n_points=count, **arguments).cloud


def error_of_fitted(case: Case, kept: gppcs.PointCloud) -> float:
    """Return about the least mean error that any values have at the places of kept points, by reweighted squares."""
    middle = case.cloud.points.mean(axis=0)
    surface = LocalSurface.from_points(np.unique(kept.points - middle, axis=0))
    _, corners, (v, w), *_ = (each.T for each in surface.find(case.cloud.points - middle))
    n, shares = len(case.cloud), np.stack([1.0 - v - w, v, w], axis=1)
    matrix = csr_array((shares.ravel(), corners.T.ravel(), np.arange(0, 3 * n + 1, 3)), shape=(n, len(surface.normals)))
    true = AttributeRange.from_cloud(case.cloud, case.attribute).values(case.cloud).astype(np.float64)
    weights, least = np.ones(n), np.inf
    for _ in range(ROUNDS):
        weighted = diags_array(weights) @ matrix
        values = np.stack([lsqr(weighted, weights * column)[0] for column in true.T], axis=1)
        errors = np.linalg.norm(matrix @ values - true, axis=1)
        least, weights = min(least, float(errors.mean())), np.maximum(errors, SMALL) ** -0.5
    return least


def rows_of(case: Case) -> list[list[str]]:
    """Return a row for each way to keep so many points."""
    count = round(RATIO * len(case.cloud))
    ways: dict[str, Callable[[], gppcs.PointCloud]] = {
        "gp": lambda: kept_by(case, count),
        "gp, detail": lambda: kept_by(case, count, detail=case.attribute),
        "gp, detail of weight 2": lambda: kept_by(case, count, detail={case.attribute: 2.0}),
        "fps": lambda: kept_by(case, count, method="fps"),
    }
    if find_spec("meshoptimizer"):
        ways["meshopt_simplifyPoints"] = lambda: kept_by_meshopt(case, count)
    rows, first = [], None
    for way, keep in ways.items():
        kept = keep()
        seconds = report.least_time(keep, REPEATS, process_time)
        errors = gppcs.evaluate(case.truth, kept, detail=[case.attribute])
        known = errors.detail[case.attribute]
        found = [
            known.error_mean, known.error_p95, known.nearest_error_mean, errors.surface_mean, errors.covering_radius,
            seconds,
        ]  # fmt: skip
        first = first or found
        ratios = [f"{value / of_gp:.2f}" if of_gp else "" for value, of_gp in zip(found, first, strict=True)]
        rows.append([case.name, case.attribute, way, f"{len(kept):,}", f"{100 * found[0]:.2f} %", *ratios])
        print(*rows[-1], sep=" | ", flush=True)
        if way == "gp, detail" and case.scanned:
            error = error_of_fitted(case, kept)
            figures = [f"{100 * error:.2f} %", f"{error / first[0]:.2f}", *[""] * 5]
            rows.append([case.name, case.attribute, "best values there", f"{len(kept):,}", *figures])
            print(*rows[-1], sep=" | ", flush=True)
    return rows


def main() -> None:
    """Print the table and write it."""
    gppcs.set_threads(1)
    samples = [Case.sample("painted", "rgb"), Case.sample("fresco", "rgb"), Case.sample("street", "intensity")]
    files = {
        "tum_desk.ply": "rgb", "nyu_basement.ply": "rgb", "redwood_livingroom_frame.ply": "rgb",
        "autzen_airborne.laz": "intensity",
    }  # fmt: skip
    scans = [Case.scan(file, attribute) for file, attribute in files.items()]
    rows = [row for case in (*samples, *scans) for row in rows_of(case)]
    header = [
        "cloud", "attribute", "way", "points", "mean error", "times that of gp", "p95", "nearest", "surface mean",
        "covering radius", "time",
    ]  # fmt: skip
    report.write_sections(
        "detail",
        "Attributes that count beside the shape",
        [report.Section("", header, rows)],
        [report.DATA / file for file in files],
        (
            f"{100 * RATIO:g} % of the points are kept. Errors of the attribute are in its range, from values that are "
            "interpolated linearly over the local surface; the column nearest takes the value of the nearest kept "
            "point. All but the first error are relative to gp without detail.",
            f"Samples have {SIZE:,} points; the street has noise of {NOISE:g} diagonals. Its intensity is judged by "
            "the true value; what is noise of the attributes of scans is not known, so it counts as error.",
            "The row best values there has the places of gp, detail, with the values that have about the least mean "
            "error of all, fitted to the whole scan. Hardly any choice of original points with about these places "
            "falls below that: what is left is noise, and texture finer than the kept points.",
            f"Times are CPU seconds of one thread, the least of {REPEATS} runs.",
        ),
    )


if __name__ == "__main__":
    main()
