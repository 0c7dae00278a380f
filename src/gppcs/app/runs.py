"""What `gppcs simplify` does with each cloud, and what it reports of that."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gppcs import io
from gppcs.amounts.options import Options
from gppcs.amounts.order import check_order, in_order
from gppcs.app.inputs import note_unused
from gppcs.app.outputs import LEVEL, Output
from gppcs.app.printing import note_left_out, note_units, print_error, record_of_run, text_of, time_in_words
from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.quantities import unit_of
from gppcs.engine.memory import size_of
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods.method import SCORES
from gppcs.simplification import Result, simplify_cloud, simplify_each, simplify_files
from gppcs.streaming.folder import Target
from gppcs.streaming.plan import Plan, make_plan


@dataclass(frozen=True)
class Job:
    """What to do with each cloud."""

    options: Options
    sizes: tuple[float, ...]  # of the levels, from coarse to fine; none without --levels
    index: bool  # whether to add the index of each kept point
    rank: bool  # and its place in the order of importance
    order: str | None  # of the points; None if the format of the output tells it
    mark: str | None  # the attribute that marks the kept points among all
    force: bool
    lossy: bool


def plan_job(job: Job, output: Output) -> tuple[dict[str, Any], dict[str, str]]:
    """Plan the work on one cloud; return a record and the rows of a table that describe it."""
    output.check(job.force)
    with job.options.open(output.sources) as files:
        plan = make_plan(files, job.options, job.mark and "`mark`")
    record = {"input": output.input, "output": str(output.targets[-1]), **dataclasses.asdict(plan)}
    limit = "unknown" if plan.memory_limit is None else size_of(plan.memory_limit)
    rows = {
        "plan": "nothing is done",
        "points": f"{'' if plan.is_counted else 'about '}{plan.points_in:,} in, {plan.points_out:,} out",
        "points are": "in memory" if plan.in_memory else "in tiles",
        "memory": f"about {size_of(plan.memory)}, of {limit} allowed",
    }
    if plan.disk:
        rows["temporary files"] = f"about {size_of(plan.disk)}"
    return record, rows


def run_job(job: Job, output: Output, timer: Timer) -> tuple[dict[str, Any], dict[str, str]]:
    """Simplify one cloud and write it; return its record, as `--json` prints it, and the rows of a table."""
    output.check(job.force)
    with job.options.open(output.sources) as files:
        plan = make_plan(files, job.options, job.mark and "`mark`")
        preview = files.preview
        _check_storable(job, output, preview)
        result, clouds = _simplified(job, output, files, plan, timer)
        note_unused(output.input_title, files)
    with timer("writing"):
        is_ranked = result.ranked and job.mark is None and _order(job, output) == "importance"
        dropped = _store(job, output, clouds, is_ranked)
    note_left_out(output.targets[-1], dropped)
    note_units(output.input_title, preview, job.options.unit)
    for note in _notes(len(result.indices), result.points_in, result.diagnostics, job.options):
        print_error(f"note: {output.input_title}: {note}")
    named = zip(output.targets, clouds, strict=True) if len(clouds) > 1 else ()
    levels = [{"output": str(target), "points_out": len(cloud)} for target, cloud in named]
    record = {
        "input": output.input,
        "output": str(output.targets[-1]),
        "levels": levels,
        "points_in": result.points_in,
        "points_out": len(result.indices),
        "method": result.method.name,
        "parameters": dataclasses.asdict(result.method),
        "readings": plan.readings,
        **record_of_run(result.diagnostics, timer.seconds),
    }
    return record, _rows(record, result, job.options, unit_of(preview.header, job.options.unit))


def run_folder(job: Job, outputs: Sequence[Output], timer: Timer) -> tuple[dict[str, Any], dict[str, str]]:
    """Simplify several files as one cloud, and write the kept points of each; return record and rows, as `run_job`."""
    sources = [output.sources[0] for output in outputs]
    targets = [Target(output.targets[0], output.format, _order(job, output), job.lossy) for output in outputs]
    with job.options.open(sources) as files:
        plan = make_plan(files, job.options, to_files=True)
        _check_storable(job, outputs[0], files.preview)
        written, diagnostics = simplify_each(files, targets, job.options, plan, timer, job.force)
        points_in = files.n_points
    points_out = sum(file.n_points for file in written)
    for note in _notes(points_out, points_in, diagnostics, job.options):
        print_error(f"note: {len(written)} files: {note}")
    record = {
        "input": list(map(str, sources)),
        "output": [{"output": str(file.target), "points_out": file.n_points} for file in written],
        "points_in": points_in,
        "points_out": points_out,
        "method": job.options.algorithm.name,
        "parameters": dataclasses.asdict(job.options.algorithm),
        **record_of_run(diagnostics, timer.seconds),
    }
    rows = {
        "points": f"{points_in:,} in, {points_out:,} out ({100 * points_out / points_in:.3g} %)",
        "files": f"{len(written):,}, and index.vpc, which lists them",
        "method": str(job.options.algorithm),
        "time": time_in_words(timer.seconds),
    }
    return record, rows


def _simplified(
    job: Job, output: Output, files: CloudFiles, plan: Plan, timer: Timer
) -> tuple[Result, list[PointCloud]]:
    """Return the result, and what goes to each file of an output."""
    if job.mark is not None:
        with timer("reading"):
            cloud = files.read()
        result = simplify_cloud(cloud, job.options, timer)
        is_kept = np.zeros(len(cloud), np.uint8)
        is_kept[result.indices] = 1
        return result, [_with_attributes(cloud, {job.mark: is_kept})]
    result = simplify_files(files, job.options, plan, timer)
    counts = _level_counts(result, job.sizes) if job.sizes else [len(result.indices)]
    attributes: dict[str, Any] = {"index": result.indices} if job.index else {}
    if job.rank:
        attributes["rank"] = np.arange(len(result.indices), dtype=np.uint32)
    if job.sizes and len(output.targets) == 1:
        attributes[LEVEL] = np.repeat(np.arange(len(counts), dtype=np.uint8), np.diff([0, *counts]))
    cloud = _with_attributes(result.cloud, attributes)
    if len(output.targets) == 1:
        counts = [len(cloud)]
    order = _order(job, output)
    if order == "importance":
        return result, [cloud.take(np.arange(count)) if count < len(cloud) else cloud for count in counts]
    positions = in_order(cloud, result.indices, order)
    return result, [cloud.take(positions[positions < count]) for count in counts]


def _order(job: Job, output: Output) -> str:
    """Return the order of the points in the files of an output."""
    is_las = io.format_to_write(output.targets[-1], output.format).name in ("LAS", "LAZ")
    return job.order or ("input" if is_las else "importance")


def _check_storable(job: Job, output: Output, cloud: PointCloud) -> None:
    """Check that the output can hold the first points with the attributes that the options add."""
    if job.mark is None:
        cloud = cloud[cloud.is_finite()]  # only these are kept
    names = (NORMALS if job.options.normals else ()) + (SCORES if job.options.scores else ())
    cloud = replace(cloud, attributes={**cloud.attributes, **dict.fromkeys(names, np.zeros(len(cloud), np.float32))})
    added: dict[str, Any] = {} if job.mark is None else {job.mark: np.uint8}
    check_order(cloud, _order(job, output))
    if job.index:
        added["index"] = np.int64
    if job.rank:
        added["rank"] = np.uint32
    if job.sizes and len(output.targets) == 1:
        added[LEVEL] = np.uint8
    cloud = _with_attributes(cloud, {name: np.zeros(len(cloud), dtype) for name, dtype in added.items()})
    target = output.targets[-1]
    io.check_storable(target, cloud, io.format_to_write(target, output.format), job.lossy)


def _with_attributes(cloud: PointCloud, attributes: Mapping[str, Any]) -> PointCloud:
    """Return a cloud with further attributes."""
    for name in attributes:
        if name in cloud.attributes:
            raise InputError(f"expected a new attribute, found {name!r}, which the cloud has; choose another name")
    return replace(cloud, attributes={**cloud.attributes, **attributes})


def _level_counts(result: Result, sizes: tuple[float, ...]) -> list[int]:
    """Return the number of points of each level, after checking that the result has a ranking to cut."""
    if not result.ranked:
        raise InputError(
            "expected levels to have a largest size below the number of different points, at most "
            f"{result.points_in:,}, found all; ask for fewer"
        )
    kept = len(result.indices)
    scale = kept / sizes[-1] if sizes[-1] < 1 else 1.0
    counts = [min(max(1, round(size * scale)), kept) for size in sizes]
    n_keep = result.diagnostics.get("points_to_keep", 0)
    if counts[0] < n_keep:
        raise InputError(
            f"expected a coarsest level of at least {n_keep:,.0f} points, those to keep, found {counts[0]:,}"
        )
    return counts


def _store(job: Job, output: Output, clouds: list[PointCloud], is_ranked: bool) -> list[str]:
    """Write all files of an output, which replace others only when all are complete; return what they do not hold."""
    dropped: list[str] = []
    with ExitStack() as stack:
        for target, cloud in zip(output.targets, clouds, strict=True):
            if output.makes_folders:
                target.parent.mkdir(parents=True, exist_ok=True)
            file = stack.enter_context(io.whole_output(target, job.force))
            chosen = io.format_to_write(target, output.format, is_ranked=is_ranked)
            dropped = io.store_in(file, target, cloud, chosen, job.lossy)
    return dropped


def _rows(record: Mapping[str, Any], result: Result, options: Options, unit: str | None) -> dict[str, str]:
    """Return the rows of the table of a run."""
    percent = 100 * record["points_out"] / record["points_in"]
    rows = {"points": f"{record['points_in']:,} in, {record['points_out']:,} out ({percent:.3g} %)"}
    for number, file in enumerate(record["levels"]):
        rows[f"level {number}"] = f"{file['output']}: {file['points_out']:,} points"
    if record["readings"] > 1 and options.memory is not None:
        rows["files"] = f"read {record['readings']} times"
    rows["method"] = str(result.method)
    limits = {"largest_gap": options.lengths.get("max_gap")}
    if options.max_error is not None:
        measure = options.max_error.measure
        limits["largest_error" if measure is None else f"surface_{measure}"] = options.max_error.length

    def length(value: float) -> str:
        return f"{text_of(value)} {unit}" if unit else text_of(value)

    for name, value in record["diagnostics"].items():
        if name == "noise_in_spacings":
            if effect := _effect(value, options):
                rows["noise"] = f"{100 * value:.2g} % of the spacing of the kept points ({effect})"
        elif name not in ("tolerance", "max_gap"):
            text = length(value) if name.startswith(("surface_", "largest_", "moved_")) else text_of(value)
            if limit := limits.get(name):
                in_cloud = f" = {length(record['diagnostics'][limit.name])}" if limit.unit else ""
                text += f"  (asked: {limit.text}{in_cloud})"
            rows[name.replace("_", " ")] = text
    rows["time"] = time_in_words(record["seconds"])
    return rows


def _effect(noise: float, options: Options) -> str:
    """Return what noise, relative to the spacing of the kept points, means for the result; nothing if it is little."""
    if noise and options.denoises:
        return "after --denoise"
    if noise <= 0.04:
        return ""
    return "some: points near the fitted surface are preferred" if noise <= 0.25 else "much: --denoise moves points out"


def _notes(kept: int, points_in: int, diagnostics: Mapping[str, float], options: Options) -> Iterator[str]:
    """Yield what somebody may not have expected of a result."""
    fraction = kept / points_in
    if isinstance(options.size, int) and kept < options.size:
        usable = " with finite coordinates" if options.invalid == "drop" else ""
        yield f"all of its {kept:,} points{usable} were kept, fewer than the {options.size:,} asked for"
    if options.tolerance is not None and fraction > 0.5:
        yield f"this tolerance takes {fraction:.0%} of the points; it is below what their spacing and noise resolve"
    if diagnostics.get("moved_largest") == 0.0:
        yield "--denoise moved no point: no noise was found, or none that differs from detail"
