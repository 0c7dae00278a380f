"""What `gppcs simplify` does with each input, and what it tells of that."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gppcs import io
from gppcs.amounts.options import Options
from gppcs.app.levels import NAME as LEVEL
from gppcs.app.levels import Levels
from gppcs.app.outputs import Output
from gppcs.app.printing import note_left_out, print_error, record_of_run, text_of, time_in_words
from gppcs.clouds.cloud import NORMALS, PointCloud
from gppcs.clouds.quantities import metres_of, name_of_unit, unit_of
from gppcs.engine.memory import size_of
from gppcs.engine.timer import Timer
from gppcs.errors import InputError
from gppcs.io.cloud_files import CloudFiles
from gppcs.methods.method import SCORES
from gppcs.simplification import Result, simplify_cloud, simplify_files
from gppcs.streaming.plan import Plan, make_plan

Values = np.ndarray[Any, Any]  # of an attribute

INDEX = "index"  # the attribute of the row in the input
NOISES = (
    (0.04, "little: it does not change the choice"),
    (0.25, "some: points near the fitted surface are preferred"),
    (math.inf, "much: --denoise moves the points out of it"),
)  # up to which share of the spacing of the kept points, what noise means for the result


@dataclass(frozen=True)
class Told:
    """What is told of a run: as JSON, in one line behind the names of its files, or as a table below them."""

    output: Output
    record: dict[str, Any]
    line: str
    rows: dict[str, str]

    @property
    def title(self) -> str:
        """The names of the files."""
        first, *others = self.output.sources
        more = f" and {len(others)} more" if others else ""
        return f"{first}{more} → {', '.join(map(str, self.output.targets))}"


@dataclass(frozen=True)
class Job:
    """What to do with each cloud."""

    options: Options
    levels: Levels | None
    timer: Timer
    with_index: bool
    mark: str | None
    dry_run: bool
    force: bool
    lossy: bool

    def run(self, output: Output) -> Told:
        """Simplify one cloud."""
        sources = output.sources
        for each in sources:
            if not io.is_standard(each):
                each.stat()  # a missing input is told before its name is taken for that of the output
        output.check(self.force)
        timer = Timer(self.timer.on_progress)
        with CloudFiles(sources, self.options.format, query=self.options.query) as files:
            planned = make_plan(files, self.options, None if self.mark is None else "add kept")
            if self.dry_run:
                return told_of_plan(output, planned)
            head = files.preview
            self._note_other_unit(sources[0], head)
            self._check_storable(output, head)
            if self.mark is None:
                whole, result = None, simplify_files(files, self.options, planned, timer)
            else:
                with timer("reading"):
                    whole = files.read()
                result = simplify_cloud(whole, self.options, timer)
            unread = files.skipped()
        with timer("writing"):
            clouds = self._clouds(result, whole, output)
            lost = self._store(output, clouds, result.ranked and self.mark is None)
        note_left_out(output.targets[-1], [*unread, *lost])
        self._note_size(sources[0], len(result.indices), result.points_in)
        if result.diagnostics.get("moved_largest") == 0.0:
            print_error(
                f"note: {sources[0]}: --denoise moved no point: no noise was found, or none that differs from detail"
            )
        unit = unit_of(head.header, self.options.unit)
        return self._told(output, list(map(len, clouds)), result, planned.readings, unit)

    def _check_storable(self, output: Output, cloud: PointCloud) -> None:
        """Check that the output can hold points of a cloud with the attributes that the options add."""
        if self.mark is None:
            cloud = cloud.take(cloud.finite_rows())  # only these are kept
        zeros = np.zeros(len(cloud), np.float32)
        names: tuple[str, ...] = NORMALS if self.options.normals else ()
        names += SCORES if self.options.scores else ()
        cloud = replace(cloud, attributes={**cloud.attributes, **dict.fromkeys(names, zeros)})
        small = zeros.astype(np.uint8)
        cloud = self._with_attributes(cloud, output, zeros.astype(np.int64), small, small)
        io.check_storable(output.targets[-1], cloud, output.format, self.lossy)

    def _with_attributes(
        self, cloud: PointCloud, output: Output, row: Values, kept: Values, level: Values
    ) -> PointCloud:
        """Return a cloud with those of these attributes that the options add."""
        added = {INDEX: row} if self.with_index else {}
        if self.mark is not None:
            added[self.mark] = kept
        elif self.levels and len(output.targets) == 1:
            added[LEVEL] = level
        for name in added:
            if name in cloud.attributes:
                raise InputError(
                    f"expected the name of a new attribute, found {name!r}, which the cloud has; choose another"
                )
        return replace(cloud, attributes={**cloud.attributes, **added})

    def _clouds(self, result: Result, whole: PointCloud | None, output: Output) -> list[PointCloud]:
        """Return what goes to each file of an output."""
        if whole is not None:
            kept = np.zeros(len(whole), np.uint8)
            kept[result.indices] = 1
            return [self._with_attributes(whole, output, kept, kept, kept)]
        counts = self._counts(result, result.points_in) if self.levels else [len(result.indices)]
        level = np.repeat(np.arange(len(counts), dtype=np.uint8), np.diff([0, *counts]))
        cloud = self._with_attributes(result.cloud, output, result.indices, level, level)
        return [cloud] if len(output.targets) == 1 else [cloud.take(np.arange(count)) for count in counts]

    def _counts(self, result: Result, points: int) -> list[int]:
        """Return the number of points of each level, after checking that the result has a ranking to cut."""
        assert self.levels is not None
        if not result.ranked:
            raise InputError(
                f"expected a finest level of less than all {points:,} points, found all of them, or all without repeats"
            )
        counts = self.levels.counts(len(result.indices))
        if counts[0] < (to_keep := result.diagnostics.get("points_to_keep", 0)):
            raise InputError(
                f"{to_keep:,.0f} points are to be kept whatever happens, but the coarsest level has only "
                f"{counts[0]:,} points; make that level larger, or mark fewer points to keep"
            )
        return counts

    def _store(self, output: Output, clouds: list[PointCloud], ranked: bool) -> list[str]:
        """Write all files of an output, or none; return what is left out."""
        written, lost = [], []
        try:
            for target, cloud in zip(output.targets, clouds, strict=True):
                if output.makes_folders:
                    target.parent.mkdir(parents=True, exist_ok=True)
                levels = (
                    "order" if ranked and "levels_by" in io.format_to_write(target, output.format).options else None
                )
                lost = io.store(target, cloud, output.format, self.force, self.lossy, None, levels)
                written.append(target)
        except BaseException:
            for target in written:
                target.unlink(missing_ok=True)
            raise
        return lost

    def _told(self, output: Output, counts: list[int], result: Result, readings: int, unit: str | None) -> Told:
        """Return what is told of a run that is done, with so many points in each file."""
        kept = len(result.indices)
        levels = list(zip(output.targets, counts, strict=True)) if len(counts) > 1 else []
        listed = {"levels": [{"output": str(file), "points_out": count} for file, count in levels]}
        record = {
            **_named(output),
            **(listed if levels else {}),
            "points_in": result.points_in,
            "points_out": kept,
            "method": result.method.name,
            "parameters": dataclasses.asdict(result.method),
            "readings": readings,
            **record_of_run(result.diagnostics, result.seconds),
        }
        rows = {
            "points": f"{result.points_in:,} in, {kept:,} out ({100 * kept / result.points_in:.3g} %)",
            **{f"level {n}": f"{file}: {count:,} points" for n, (file, count) in enumerate(levels)},
            **({"points on disk": f"files read {readings} times"} if readings > 1 else {}),
            "method": str(result.method),
            **dict(self._in_words(name, value, unit) for name, value in result.diagnostics.items() if value),
            "time": time_in_words(result.seconds),
        }
        line = f"{result.points_in:,} points in, {kept:,} out, {sum(result.seconds.values()):.2f} s"
        return Told(output, record, line, rows)

    def _in_words(self, name: str, value: float, unit: str | None) -> tuple[str, str]:
        """Return a diagnostic as a row of the table, with what was asked of it."""
        if name == "noise_in_spacings":
            meaning = next(words for most, words in NOISES if value <= most)
            meaning = "after --denoise" if self.options.denoise else meaning
            return "noise", f"{100 * value:.2g} % of the spacing of the kept points ({meaning})"
        amount, text = self.options.amount, text_of(value)
        asked = {"largest_gap": amount.max_gap}
        if amount.tolerance is not None:
            measure = amount.tolerance.measure
            asked["largest_error" if measure is None else f"surface_{measure}"] = amount.tolerance.length
        if unit and name.startswith(("surface_", "largest_", "moved_")):
            text += f" {unit}"
        if length := asked.get(name):
            text += f"  (asked: {length.given})"
        return name.replace("_", " "), text

    def _note_size(self, source: Path, kept: int, points: int) -> None:
        """Print a note if fewer points are kept than were asked for, or if a tolerance is too small for the points."""
        amount = self.options.amount
        if amount.n_points is not None and kept < amount.n_points and self.options.group is None:
            usable = " with finite coordinates" if self.options.invalid == "drop" else ""
            asked = f"fewer than the {amount.n_points:,} asked for"
            print_error(f"note: {source}: all of its {kept:,} points{usable} were kept, {asked}")
        if amount.tolerance is not None and kept > 0.5 * points:
            share = f"{kept / points:.0%} of the points"
            print_error(
                f"note: {source}: this tolerance takes {share}; it is below what their spacing and noise resolve"
            )

    def _note_other_unit(self, source: Path, cloud: PointCloud) -> None:
        """Print a note if the unit that is given is not that of the input."""
        unit = self.options.unit
        own, given = metres_of(None, cloud.header), metres_of(unit, cloud.header)
        if own is not None and given is not None and not math.isclose(own, given, rel_tol=1e-9):
            known = name_of_unit(own)
            print_error(f"note: {source}: its coordinate system says that the unit is {known}; --unit {unit} is used")


def told_of_plan(output: Output, plan: Plan) -> Told:
    """Return what is told of a run that is only planned."""
    strategy = "in memory" if plan.in_memory else "with the points on disk"
    record = {
        **_named(output),
        "points_in": plan.points_in,
        "points_out": plan.points_out,
        "way": strategy,
        "in_memory": plan.in_memory,
        "readings": plan.readings,
        "memory": plan.memory,
        "memory_limit": plan.memory_limit,
        "disk": plan.disk,
    }
    limit = "unknown" if plan.memory_limit is None else size_of(plan.memory_limit)
    rows = {
        "plan": "nothing is done",
        "points": f"{'' if plan.is_counted else 'about '}{plan.points_in:,} in, {plan.points_out:,} out",
        "way": strategy,
        "memory": f"about {size_of(plan.memory)}, of {limit} allowed",
        **({"temporary files": f"about {size_of(plan.disk)}"} if plan.disk else {}),
    }
    return Told(
        output,
        record,
        f"{('in memory' if plan.in_memory else 'with the points on disk')}, about {size_of(plan.memory)}",
        rows,
    )


def _named(output: Output) -> dict[str, Any]:
    """Return how the record of `--json` names the files."""
    names = [str(source) for source in output.sources]
    return {"input": names if len(names) > 1 else names[0], "output": str(output.targets[-1])}
