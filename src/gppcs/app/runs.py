"""What `gppcs simplify` does with each cloud, and what it reports of that."""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gppcs.amounts.options import Options
from gppcs.app.outputs import Output, note_unused
from gppcs.app.printing import note_left_out, note_units, print_error, record_of_run, text_of, time_in_words
from gppcs.clouds.quantities import unit_of
from gppcs.engine.memory import size_of
from gppcs.engine.timer import Timer
from gppcs.simplification import simplify_each, simplify_files
from gppcs.steps import simplify_cloud
from gppcs.streaming.folder import Target
from gppcs.streaming.plan import Plan, make_plan


def plan_job(options: Options, output: Output) -> tuple[dict[str, Any], dict[str, str]]:
    """Plan the work on one cloud; return a record and the rows of a table that describe it."""
    output.check()
    with output.source as files:
        plan = make_plan(files, options, options.mark and "`mark`", to_files=output.by_input)
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


def run_job(options: Options, output: Output, timer: Timer) -> tuple[dict[str, Any], dict[str, str]]:
    """Simplify one cloud and write it; return its record, as `--json` prints it, and the rows of a table."""
    output.check()
    with output.source as files:
        plan = make_plan(files, options, options.mark and "`mark`", to_files=output.by_input)
        output.check_storable(options)
        work = _to_files_by_input if output.by_input else _to_files_of_levels
        counts, points_in, points_out, diagnostics = work(options, output, plan, timer)
        note_unused(output.input_title, files)  # before they are closed, as standard input is read once
    note_units(output.input_title, files.preview, options.unit)
    for note in _notes(points_out, points_in, diagnostics, options):
        print_error(f"note: {output.input_title}: {note}")
    named = [{"output": str(target), "points_out": n} for target, n in counts.items()]
    record = {
        "input": output.input,
        "output": named if output.by_input else str(output.targets[-1]),
        "levels": [] if output.by_input or len(named) == 1 else named,
        "points_in": points_in,
        "points_out": points_out,
        "method": options.algorithm.name,
        "parameters": dataclasses.asdict(options.algorithm),
        "readings": plan.readings,
        **record_of_run(diagnostics, timer.seconds),
    }
    return record, _rows(record, options, unit_of(files.preview.header, options.unit))


# The number of points in each file, those among which was chosen, those kept, and diagnostics.
Done = tuple[dict[Path, int], int, int, Mapping[str, float]]


def _to_files_of_levels(options: Options, output: Output, plan: Plan, timer: Timer) -> Done:
    """Simplify one cloud, and write the result, or the input with a mark, or each level."""
    if options.mark is not None:
        with timer("reading"):
            cloud = output.source.read()
        result = simplify_cloud(cloud, options, timer)
        clouds = [result.marked(cloud, options.mark)]
    else:
        options = replace(options, order=output.orders[-1])
        result = simplify_files(output.source, options, plan, timer)
        by_level = len(output.targets) > 1
        levels = None if by_level else options.levels
        result = result.with_attributes(index=options.index, rank=options.rank, levels=levels)
        clouds = [level.cloud for level in (result.levels(options.sizes) if by_level else [result])]
    with timer("writing"):
        dropped = output.write(clouds, result.ranked and options.mark is None)
    note_left_out(output.targets[-1], dropped)
    counts = dict(zip(output.targets, map(len, clouds), strict=True))
    return counts, result.points_in, len(result), result.diagnostics


def _to_files_by_input(options: Options, output: Output, plan: Plan, timer: Timer) -> Done:
    """Simplify several files as one cloud, and write the kept points of each."""
    ordered = zip(output.targets, output.orders, strict=True)
    targets = [Target(target, output.suffix, order, output.lossy) for target, order in ordered]
    written, points_in, diagnostics = simplify_each(output.source, targets, options, plan, timer, output.force)
    counts = {file.target: file.n_points for file in written}
    return counts, points_in, sum(counts.values()), diagnostics


def _rows(record: Mapping[str, Any], options: Options, unit: str | None) -> dict[str, str]:
    """Return the rows of the table of a run."""
    percent = 100 * record["points_out"] / record["points_in"]
    rows = {"points": f"{record['points_in']:,} in, {record['points_out']:,} out ({percent:.3g} %)"}
    for number, file in enumerate(record["levels"]):
        rows[f"level {number}"] = f"{file['output']}: {file['points_out']:,} points"
    if isinstance(record["output"], list):
        rows["files"] = f"{len(record['output']):,}, and index.vpc, which lists them"
    elif record["readings"] > 1 and options.memory is not None:
        rows["files"] = f"read {record['readings']} times"
    rows["method"] = str(options.algorithm)
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
