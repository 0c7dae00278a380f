"""Measure the time and the memory of `gp` and its rivals, from 36,000 to 14 million points.

This is the page from which README and docs take their seconds. It also has the limits of the machine, and packages that
do the same work as parts of gppcs. It takes about ten minutes on two idle cores. Needs the extras
`evaluate` and `picture`. jakteristics, pgeof, SciPy, CGAL, fpsample and Open3D are measured if they are installed. Runs
on Linux only.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

import numpy as np

import clouds
import gppcs
import machine
import report
import same_work
from clouds import Array, Cloud
from gppcs.engine.memory import STATUS, peak_memory
from gppcs.engine.threads import number_of_threads
from measured import Measured, Run
from speed_plot import draw

GP = "gp"
CANDIDATES = 40_000  # as many as the paper's for its largest cloud
METHODS: dict[str, str | gppcs.Method] = {
    GP: GP,
    "gp-spectral": "gp-spectral",
    f"gp-spectral, {CANDIDATES:,} candidates": gppcs.SpectralGP(candidates=CANDIDATES),
    "fps": "fps",
    "hc": "hc",
    "wlop": "wlop",
}
TOO_LONG, TOO_LARGE = 60.0, 12e9  # seconds and bytes of memory; if more are expected, a method is left out
LARGE = 5_000_000  # points of which one thread keeps no tenth, as that takes too long
LEFT_OUT = "\N{EN DASH}"
LONG = 5.0  # no more repeats after so many seconds
NOTES = (
    "Seconds are wall time from an array in memory to indices in memory, with compiled kernels: the least of up to 5 "
    "runs, of 3 from a million points on, of 2 from ten million on. No run starts after 5 seconds of runs.",
    "Peak memory is that of the first run in its own process, less the memory that the process held before the run.",
    f"{LEFT_OUT}: left out, since the run on the cloud before made more than 60 seconds or 12 GB likely. Where a tenth "
    "of the points is kept, only gp and fps are measured.",
    "The exponent is the slope of the least-squares line of log seconds over log points.",
    "The samples of the mesh are uniform by area, with Gaussian noise of 1e-4 diagonals where their name tells no "
    "other. The flat scene shows ground and buildings as four laser scanners on masts see them. On the ground, the "
    "density around a scanner falls with the squared distance.",
    "Files are binary PLY with float32 coordinates, in the cache of the operating system.",
    "Beside others: both sides have the number of threads that the rival can use, and take turns. The point sets of "
    "CGAL and Open3D are made before. pgeof computes seven more features, in single precision. hc, gp and wlop by CGAL "
    "do not choose the same points.",
)


def repeats(n: int) -> int:
    """Return how often a cloud of n points is simplified."""
    return 5 if n < 1_000_000 else 3 if n < 10_000_000 else 2


def apart(work: Callable[..., Run], *given: object) -> Run:
    """Do some work in its own process."""
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        return process.submit(work, *given).result()


def measure(path: Path, method: str | gppcs.Method, n_points: int, threads: int) -> Run:
    """Simplify the points of an NPY file several times; return the fastest run."""
    gppcs.set_threads(threads)
    gppcs.simplify(gppcs.sample("bracket", n_points=6_000), ratio=0.1, method=method)  # loads the kernels
    points = np.load(path)
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak of memory
    held, peak, runs = resident(), 0, []
    begin = perf_counter()
    while len(runs) < repeats(len(points)) and perf_counter() - begin < LONG:
        start = perf_counter()
        result = gppcs.simplify(points, n_points=n_points, method=method)
        stages = {stage: value for stage, value in result.seconds.items() if stage != "compilation"}
        runs.append((perf_counter() - start, stages))
        peak = peak or peak_memory()
    return Run(*min(runs, key=lambda run: run[0]), (peak - held) / len(points))


def resident() -> int:
    """Return the bytes of memory that this process holds now."""
    return int(STATUS.read_text().split("VmRSS:")[1].split()[0]) * 1024


def file_times(points: Array, folder: Path) -> tuple[float, float]:
    """Return the least seconds of writing and of reading a binary PLY file."""
    cloud = gppcs.PointCloud.from_object(points.astype(np.float32))
    path, most = folder / "cloud.ply", repeats(len(points))
    return (
        report.least_time(lambda: gppcs.write(path, cloud, force=True), most),
        report.least_time(lambda: gppcs.read(path), most),
    )


def measured(cloud: Cloud, before: Sequence[Measured]) -> Measured:
    """Measure all methods on a cloud, but those that took too long on those before."""
    print(f"{cloud.name}, {cloud.size:,} points", file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        points, path = cloud.make(), Path(folder) / "points.npy"
        assert len(points) == cloud.size
        np.save(path, points)
        writing, reading = file_times(points, Path(folder))
        del points
        threads, runs = number_of_threads(), {}
        others = dict.fromkeys(gppcs.METHODS.built_in) if cloud is clouds.DRAGON_SCAN else {}
        for name in METHODS | others:
            if feasible(name, cloud, before):
                runs[name] = apart(measure, path, METHODS.get(name, name), cloud.n_points, threads)
                print(f"  {name}: {runs[name].seconds:.3f} s", file=sys.stderr)
        wanted = threads > 1 and (cloud.amount == clouds.KEPT or (cloud.amount == clouds.TENTH and cloud.size < LARGE))
        single = apart(measure, path, GP, cloud.n_points, 1) if wanted else None
    return Measured(cloud, runs, single, writing, reading)


def feasible(method: str, cloud: Cloud, before: Sequence[Measured]) -> bool:
    """Return whether a method is expected to need neither too much time nor too much memory."""
    if method == GP or cloud.amount == clouds.TENTH:
        return method in (GP, "fps")
    measured_before = [each for each in before if method in each.runs]
    if not measured_before:
        return True
    last = max(measured_before, key=lambda each: each.cloud.size)
    run = last.runs[method]
    return run.seconds * cloud.size / last.cloud.size < TOO_LONG and run.memory * cloud.size < TOO_LARGE


def exponent(series: Sequence[Measured], seconds: Callable[[Run], float]) -> float:
    """Return the slope of log seconds of gp over log points."""
    sizes = [each.cloud.size for each in series]
    return float(np.polyfit(np.log(sizes), np.log([seconds(each.runs[GP]) for each in series]), 1)[0])


def stage_table(all_measured: Sequence[Measured]) -> report.Section:
    """Return the table of the seconds of each stage of gp, with exponents."""
    timer = list(dict.fromkeys(stage for each in all_measured for stage in each.runs[GP].timer))
    rows = [
        [*each.names, f"{run.seconds:.3f}", *(f"{run.timer.get(stage, 0):.3f}" for stage in timer)]
        for each in all_measured
        if (run := each.runs[GP])
    ]
    for members, kept in ((clouds.SERIES, f"{clouds.KEPT:,}"), (clouds.TENTHS, "a tenth")):
        series = series_of(all_measured, members)
        if len(series) > 1:
            common = [stage for stage in timer if all(each.runs[GP].timer.get(stage) for each in series)]
            slopes = {stage: exponent(series, lambda run, stage=stage: run.timer[stage]) for stage in common}
            span = f"{series[0].cloud.size:,} to {series[-1].cloud.size:,}"
            cells = [f"{slopes[stage]:.2f}" if stage in slopes else "" for stage in timer]
            rows.append(
                ["**exponent**, Dragon", span, kept, f"{exponent(series, lambda run: run.seconds):.2f}", *cells]
            )
    return report.Section("gp, seconds of its stages", ["cloud", "points", "kept", "in all", *timer], rows)


def series_of(all_measured: Sequence[Measured], members: Sequence[Cloud]) -> list[Measured]:
    """Return what was measured on the members of a series of clouds: one shape with more and more points."""
    return [each for each in all_measured if each.cloud in members]


def method_tables(all_measured: Sequence[Measured]) -> list[report.Section]:
    """Return the tables of seconds and of memory of all methods."""
    header = ["cloud", "points", "kept", *METHODS]
    seconds, memory = [], []
    for each in all_measured:
        runs = [each.runs.get(method) for method in METHODS]
        files = (f"{each.writing:.4f}", f"{each.reading:.4f}")
        seconds.append([*each.names, *(f"{run.seconds:.3f}" if run else LEFT_OUT for run in runs), *files])
        memory.append([*each.names, *(f"{run.memory:.0f}" if run else LEFT_OUT for run in runs)])
    return [
        report.Section("All methods, seconds", [*header, "write PLY", "read PLY"], seconds),
        report.Section("Peak memory above the input, bytes a point", header, memory),
    ]


def every_method(scan: Measured) -> report.Section:
    """Return the table of all methods on one scan."""
    rows = [[method, f"{run.seconds:.3f}", f"{run.memory:.0f}"] for method, run in scan.runs.items()]
    heading = f"Every method, {scan.names[0]}, {scan.names[1]} points to {scan.names[2]}"
    return report.Section(heading, ["method", "seconds", "peak memory above the input, bytes a point"], rows)


def thread_table(all_measured: Sequence[Measured]) -> report.Section:
    """Return the table of the seconds of gp with one thread and with all."""
    rows = [
        [*each.names, f"{each.single.seconds:.3f}", f"{all_:.3f}", f"{each.single.seconds / all_:.2f}"]
        for each in all_measured
        if each.single and (all_ := each.runs[GP].seconds)
    ]
    header = ["cloud", "points", "kept", "1 thread", f"{number_of_threads()} threads", "times as fast"]
    return report.Section("gp by one thread and by all, seconds", header, rows)


def main() -> None:
    """Print the tables, and write them and the plot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=14_000_000, metavar="N", help="leave out larger clouds")
    parser.add_argument(
        "--to", type=Path, default=report.HERE / "results", metavar="FOLDER", help="folder of the results"
    )
    given = parser.parse_args()
    # as many cores as gppcs uses threads: some packages start a thread for each core
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: number_of_threads()])
    for method in METHODS.values():
        gppcs.simplify(gppcs.sample("bracket", n_points=6_000), ratio=0.1, method=method)  # compiles, in this process
    done: list[Measured] = []
    for cloud in clouds.CLOUDS:
        if cloud.size <= given.largest:
            done.append(measured(cloud, done))
    sections = [stage_table(done), *method_tables(done)]
    if any(each.single for each in done):
        sections.append(thread_table(done))
    sections += [every_method(each) for each in done if each.cloud is clouds.DRAGON_SCAN]
    sections += [same_work.compared(), machine.limits()]
    files = list(dict.fromkeys(path for each in done for path in each.cloud.files))
    page = report.text(
        "Speed and memory from 36,000 to 14 million points", sections, files, [*NOTES, same_work.versions()]
    )
    print(page)
    (given.to / "speed.md").write_text(page)
    draw(given.to / "speed.png", done, *(series_of(done, members) for members in (clouds.SERIES, clouds.TENTHS)))


if __name__ == "__main__":
    main()
