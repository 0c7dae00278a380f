"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs import __version__
from gppcs.app import options, panels
from gppcs.app.large_files import executor_of, plan_record, print_plan, titled
from gppcs.app.levels import NAME as LEVEL
from gppcs.app.levels import Levels, level_of_each
from gppcs.app.outputs import Outputs, outputs_of, sources_of
from gppcs.app.pages import different_names, how_made
from gppcs.app.printing import (
    BAD_INPUT,
    FAILURES,
    note_left_out,
    number_in_words,
    numbers_of,
    print_error,
    print_json,
    progress,
    say,
    say_aside,
    tell,
    time_in_words,
)
from gppcs.clouds.quantities import METRES, metres_of, option, unit_of
from gppcs.engine.memory import peak_memory
from gppcs.engine.threads import set_threads
from gppcs.engine.timer import COMPILATION
from gppcs.errors import InputError, OutputError, ParameterError, file_path, shown
from gppcs.methods import DEFAULT, METHODS, Method, method_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gppcs.clouds.cloud import PointCloud
    from gppcs.drawing.web.contents import Page
    from gppcs.io.query import Query
    from gppcs.simplification import Request, Result
    from gppcs.streaming.beyond_memory import Run
    from gppcs.streaming.files import Work
    from gppcs.streaming.plan import Plan

KINDS = ("invalid", "outliers")  # of points that --drop leaves out
ADDED = ("normals", "scores", "index")  # what --add adds
INDEX = "index"  # the attribute of the row in the input

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.03\n\n"
    "gppcs simplify scan.ply -o small.ply --points 5000 --method fps\n\n"
    "gppcs simplify scan.ply -o small.ply --tolerance 0.02%\n\n"
    "gppcs simplify scan.laz -o small.laz --spacing 50cm --only 'classification != 7'\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --set feature_weight=0.8\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --add normals\n\n"
    "gppcs simplify scan.ply -o 'scan_{level}.ply' --levels 10%,3%,1%\n\n"
    "gppcs simplify a.ply b.ply -o folder/ --ratio 10% --json\n\n"
    "gppcs simplify tile1.laz tile2.laz --merge -o small.laz --ratio 0.2% --memory 4GB\n\n"
    "gppcs simplify scans -o '{parent}/{stem}_small.ply' --points 5k\n\n"
    "[bold]Output of --json[/bold]\n\n"
    "Besides input, output and method: [cyan]seconds[/cyan], the time of each stage; "
    "[cyan]seconds_compiling[/cyan], the part of it that only a first run takes; and [cyan]peak_memory[/cyan], the "
    "most bytes that the process has held so far, or null if the system does not report it. With --merge, input is a "
    "list. With --dry-run, the plan stands in place of the result.\n\n"
    "[bold]Methods[/bold] (their parameters: gppcs methods NAME)\n\n"
    + "\n\n".join(
        f"[cyan]{method.name}[/cyan]: {method.summary} [dim]({method.source})[/dim]" for method in METHODS.values()
    )
)


def simplify(
    context: typer.Context,
    inputs: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...",
            parser=file_path,
            help="Point cloud files. A folder stands for all files in it that gppcs reads, a .vpc file for those that "
            "it lists.",
            show_default=False,
        ),
    ],
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            help="The file to write. For several inputs a folder, or a pattern with {stem} (the name of the input "
            "without suffix), {name}, {suffix} or {parent} (its folder). A folder is made if it is missing; end the "
            "name of a new one with a slash.",
        ),
    ],
    ratio: options.Ratio = None,
    points: options.Points = None,
    tolerance: options.Tolerance = None,
    spacing: options.Spacing = None,
    max_gap: options.MaxGap = None,
    levels: options.Levels = None,
    unit: options.Unit = None,
    keep: options.Keep = None,
    weight: options.Weight = None,
    method: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Name of the method, from the list below.",
            autocompletion=lambda: list(METHODS),
            rich_help_panel=panels.METHOD,
        ),
    ] = DEFAULT,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Set a parameter of the method. Can be repeated.",
            rich_help_panel=panels.METHOD,
        ),
    ] = None,
    input_format: options.From = None,
    output_format: options.To = None,
    box: options.Box = None,
    only: options.Only = None,
    polygon: options.Inside = None,
    drop: Annotated[
        str | None,
        typer.Option(
            metavar="KIND,...",
            help="Leave out points before all else: outliers, which neither their neighbours nor the surface explain; "
            "invalid ones, with NaN or infinite coordinates, which are otherwise an error; or invalid,outliers.",
            rich_help_panel=panels.CHOICE,
        ),
    ] = None,
    add: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Add attributes to each kept point. normals: estimated from all points of the input, to rebuild a "
            "surface; those of closed pieces point outward, of flat pieces along +z. scores: the score and standard "
            "deviation when the point was chosen (method gp). index: its row among the points that are read, from 0.",
            rich_help_panel=panels.ATTRIBUTES,
        ),
    ] = None,
    mark: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Write all points that are read, with an attribute NAME: 1 for kept points, 0 for others.",
            rich_help_panel=panels.ATTRIBUTES,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="HTML",
            help="Write a page that shows the result beside the original in the browser; see gppcs report.",
            rich_help_panel=panels.LOOK,
        ),
    ] = None,
    threads: options.Threads = None,
    merge: options.Merge = False,
    memory: options.Memory = None,
    workers: options.Workers = None,
    dry_run: options.DryRun = False,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    If one of several inputs cannot be used, the others are still simplified, and the exit code is 2. The name - stands
    for standard input, or for standard output with --to.
    """
    from gppcs.engine.timer import Timer
    from gppcs.io import check_distinct
    from gppcs.io.query import Query
    from gppcs.simplification import Request
    from gppcs.streaming.files import Work
    from gppcs.streaming.sizes import bytes_of

    set_threads(threads)
    amount: dict[str, Any] = {
        "ratio": ratio,
        "n_points": points,
        "tolerance": tolerance,
        "spacing": spacing,
        "max_gap": max_gap,
    }
    chosen = method_of(method, settings=_parsed(settings or []))
    wanted = None if levels is None else _checked_levels(levels, amount, chosen, mark)
    dropped, added = _listed("--drop", drop, KINDS), _listed("--add", add, ADDED)
    request = Request.of(
        **amount | (wanted.finest if wanted else {}), unit=unit, keep=keep, weight=weight, method=chosen,
        invalid="drop" if "invalid" in dropped else "error", normals="normals" in added, scores="scores" in added,
        drop_outliers="outliers" in dropped,
    )  # fmt: skip
    if mark is not None and added:
        raise ParameterError("expected --mark without --add, whose attributes only kept points have")
    if dry_run and request.amount.ratio is None and request.amount.n_points is None:
        raise ParameterError(
            "expected --ratio or --points with --dry-run, as the number of points is known only after the work"
        )
    limit = None if memory is None else bytes_of(memory)
    query = Query.of(numbers_of(box), None, only, polygon)
    merged = sources_of(inputs) if merge else []
    naming = outputs_of if wanted is None else wanted.outputs
    named = naming(merged[:1] or inputs, output, output_format)
    by_level = named if isinstance(named, list) else [named]
    outputs = by_level[-1]
    sources = list(outputs.targets)
    if report:
        _check_report(report, sources, force)
    written = [target for level in by_level for target in level.targets.values()]
    read = [*inputs, *(merged or sources), *filter(None, [polygon])]
    check_distinct([*written, *filter(None, [report])], read)
    with executor_of(workers) as executor:
        work = Work(limit, None, executor, Timer(progress(quiet)))
        job = _Job(
            outputs, by_level, wanted, merged, request, work, input_format, query, "index" in added, mark, report,
            context.obj, dry_run, force, lossy, quiet,
        )  # fmt: skip
        succeeded = [_reported(job, source, as_json) for source in sources]
    if not all(succeeded):
        raise typer.Exit(BAD_INPUT)


def _reported(job: _Job, source: Path, as_json: bool) -> bool:
    """Simplify one file, print the run or why it failed, and return whether it succeeded."""
    from gppcs.io import is_standard

    try:
        run = job.run(source)
    except FAILURES as error:
        tell(error, source)
        return False
    if is_standard(run.target) and not job.dry_run:  # there the result goes
        if not job.quiet:
            say_aside(run.line())
    elif as_json:
        print_json(run.record())
    elif job.quiet:
        pass
    elif len(job.outputs.targets) > 1:
        say(run.line())
    else:
        run.print()
    return True


def _checked_levels(text: str, amount: dict[str, Any], method: Method, mark: str | None) -> Levels:
    """Return the levels, after checking that they fit the other options."""
    from gppcs.simplification import require_ranking

    given = [option(name) for name, value in amount.items() if value is not None]
    if given or mark is not None:
        raise ParameterError(f"expected --levels without {(given or ['--mark'])[0]}")
    require_ranking(method)
    return Levels.of(text)


def _parsed(settings: list[str]) -> dict[str, str]:
    """Return settings of the form KEY=VALUE as a dictionary."""
    for setting in settings:
        if "=" not in setting:
            raise ParameterError(f"expected --set KEY=VALUE, found {setting!r}")
    return {key: value for key, _, value in (setting.partition("=") for setting in settings)}


def _listed(name: str, given: str | None, known: tuple[str, ...]) -> list[str]:
    """Return the words in a list, after checking that they are known."""
    words = [] if given is None else [word.strip() for word in given.split(",")]
    for word in words:
        if word not in known:
            raise ParameterError(f"expected {name} with {' or '.join(known)}, found {shown(word)}")
    return words


def _check_report(path: Path, inputs: list[Path], force: bool) -> None:
    """Check that the page of one input can be written."""
    from gppcs.io import check_writable

    if len(inputs) > 1:
        raise ParameterError(f"expected one input with --report, found {len(inputs)}")
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{path}: expected a name that ends in .html for the report")
    check_writable(path, force)


@dataclass(frozen=True)
class _Job:
    """What to do with each input, or with all of `merged`."""

    outputs: Outputs
    by_level: list[Outputs]
    levels: Levels | None
    merged: list[Path]
    request: Request
    work: Work
    input_format: str | None
    query: Query | None
    with_index: bool
    mark: str | None
    report: Path | None
    command: list[str]
    dry_run: bool
    force: bool
    lossy: bool
    quiet: bool

    def run(self, source: Path) -> _Run | _DryRun:
        """Simplify one cloud."""
        from gppcs import io
        from gppcs.io.cloud_files import CloudFiles
        from gppcs.streaming.files import run

        target, sources = self.outputs.targets[source], self.merged or [source]
        for each in sources:
            if not io.is_standard(each):
                each.stat()  # a missing input is told before its name is taken for that of the output
        for level in self.by_level:
            level.check(level.targets[source], self.force)
        work = replace(self.work, timer=self.work.timer.anew())
        with CloudFiles(sources, self.input_format, query=self.query) as files:
            planned = work.planned(files, self.request, self._whole())
            if self.dry_run:
                return _DryRun(sources, target, planned)
            head = files.head().cloud
            self._note_other_unit(source, head)
            self._check_storable(target, head)
            done = run(files, self.request, work, planned)
            _, unread = files.left_out()
        result = done.result
        page = None if self.report is None else self._page(done, target)
        if self.mark is not None:
            result = _marked(done, self.mark)
        elif self.with_index:
            result = replace(result, cloud=_with_attribute(result.cloud, INDEX, result.indices))
        with work.timer("writing"):
            written, lost = self._store(source, result, done.points)
            if self.report is not None and page is not None:
                with io.whole_file(self.report, self.force) as file:
                    page.write(file)
        note_left_out(target, [*unread, *lost])
        self._note_all_kept(source, len(result.indices))
        self._note_fine_tolerance(source, len(result.indices) / done.points)
        unit = unit_of(head.header, self.request.unit)
        return _Run(sources, written, done.points, planned.readings, result, self._asked(), unit)

    def _store(self, source: Path, result: Result, points: int) -> tuple[dict[Path, int], list[str]]:
        """Write the result, or its levels; return the number of points in each file, and what is left out."""
        import numpy as np

        from gppcs import io

        clouds = [result.cloud]
        if self.levels is not None:
            if not result.ranked:
                raise InputError(
                    f"expected a finest level of less than all {points:,} points, found all of them, or all without "
                    "repeats"
                )
            counts = self.levels.counts(len(result.indices))
            if counts[0] < (to_keep := result.diagnostics.get("points_to_keep", 0)):
                raise InputError(
                    f"{to_keep:,.0f} points are to be kept whatever happens, but the coarsest level has only "
                    f"{counts[0]:,} points; make that level larger, or mark fewer points to keep"
                )
            if len(self.by_level) > 1:
                clouds = [result.cloud.take(np.arange(count)) for count in counts]
            else:
                clouds = [_with_attribute(result.cloud, LEVEL, level_of_each(counts))]
        written: dict[Path, int] = {}
        try:
            for to, cloud in zip(self.by_level, clouds, strict=True):
                target = to.targets[source]
                to.make_folder(target)
                lost = io.store(target, cloud, to.format, self.force, self.lossy, to.ascii)
                written[target] = len(cloud)
        except BaseException:  # all levels, or none
            for target in written:
                target.unlink(missing_ok=True)
            raise
        return written, lost

    def _page(self, done: Run, target: Path) -> Page:
        """Return a page of the result beside its original, both without outliers."""
        import numpy as np

        from gppcs.drawing.web.contents import Named, report_page
        from gppcs.io import is_standard

        assert done.cloud is not None
        cloud, result = done.cloud, done.result
        if result.outliers is not None:
            cloud = cloud.take(np.delete(np.arange(len(cloud)), result.outliers))
        sources = self.merged or list(self.outputs.targets)
        shown = Path("result") if is_standard(target) else target
        original, simplified = different_names([Path(titled(sources)), shown])
        named = Named(simplified, result.cloud, reason=result.method.summary)
        return report_page(Named(original, cloud), [named], how_made(self.command, sources))

    def _whole(self) -> str | None:
        """Return the option that takes all points at once, if any, besides those of the request."""
        wanted = {
            **({} if self.request.whole is None else {option(self.request.whole): True}),
            "--mark": self.mark is not None,
            "--report": self.report,
        }
        return next((name for name, value in wanted.items() if value), None)

    def _check_storable(self, target: Path, cloud: PointCloud) -> None:
        """Check that the output can hold points of a cloud with the attributes that the options add."""
        import numpy as np

        from gppcs import io
        from gppcs.clouds.cloud import NORMALS

        if self.mark is None:
            cloud = cloud.take(cloud.finite_rows())  # only these are kept
        names = [
            *(NORMALS if self.request.normals else ()),
            *(self.request.method.attributes if self.request.scores else ()),
        ]
        zeros = dict.fromkeys(names, np.zeros(len(cloud), np.float32))
        cloud = replace(cloud, attributes={**cloud.attributes, **zeros})
        level = LEVEL if self.levels is not None and len(self.by_level) == 1 else None
        for name, dtype in ((INDEX if self.with_index else None, np.int64), (self.mark, np.uint8), (level, np.uint8)):
            if name is not None:
                cloud = _with_attribute(cloud, name, np.zeros(len(cloud), dtype))
        io.check_storable(target, cloud, self.outputs.format, self.lossy, self.outputs.ascii)

    def _asked(self) -> dict[str, str]:
        """Return what was asked of a diagnostic, by its name."""
        amount, asked = self.request.amount, {}
        if amount.tolerance is not None:
            measure = amount.tolerance.measure
            asked["largest_error" if measure is None else f"surface_{measure}"] = amount.tolerance.length
        if amount.max_gap is not None:
            asked["largest_gap"] = amount.max_gap
        return {name: str(length.given) for name, length in asked.items()}

    def _note_all_kept(self, source: Path, kept: int) -> None:
        """Print a note if the input has fewer points than were asked for."""
        asked = self.request.amount.n_points
        if asked is not None and kept < asked:
            usable = " with finite coordinates" if self.request.invalid == "drop" else ""
            print_error(
                f"note: {source}: all of its {kept:,} points{usable} were kept, fewer than the {asked:,} asked for"
            )

    def _note_fine_tolerance(self, source: Path, share: float) -> None:
        """Print a note if the points that are left out, less than half, tell that a tolerance is too small for them."""
        if self.request.amount.tolerance is not None and share > 0.5:
            print_error(
                f"note: {source}: this tolerance takes {share:.0%} of the points; it is below what their spacing and "
                "noise resolve"
            )

    def _note_other_unit(self, source: Path, cloud: PointCloud) -> None:
        """Print a note if the unit that is given is not that of the input."""
        unit = self.request.unit
        own, given = metres_of(None, cloud.header), metres_of(unit, cloud.header)
        if own is not None and given is not None and not math.isclose(own, given, rel_tol=1e-9):
            known = next((name for name, metres in METRES.items() if metres == own), f"{own:g} m")
            print_error(f"note: {source}: its coordinate system says that the unit is {known}; --unit {unit} is used")


def _with_attribute(cloud: PointCloud, name: str, values: NDArray[Any]) -> PointCloud:
    """Return a cloud with one more attribute."""
    if name in cloud.attributes:
        raise InputError(f"expected the name of a new attribute, found {name!r}, which the cloud has; choose another")
    return replace(cloud, attributes={**cloud.attributes, name: values})


def _marked(done: Run, name: str) -> Result:
    """Return a result with all points that were read, and an attribute that tells which are kept."""
    import numpy as np

    assert done.cloud is not None
    kept = np.zeros(len(done.cloud), dtype=np.uint8)
    kept[done.result.indices] = 1
    return replace(done.result, cloud=_with_attribute(done.cloud, name, kept))


@dataclass(frozen=True)
class _DryRun:
    """What would be done with one cloud."""

    sources: list[Path]
    target: Path
    plan: Plan

    def record(self) -> dict[str, Any]:
        """Return the plan as the record that `--json` prints."""
        return {"input": _record_of(self.sources), "output": str(self.target), **plan_record(self.plan)}

    def line(self) -> str:
        """Return the plan as one line."""
        from gppcs.streaming.sizes import size_of

        return f"{titled(self.sources)} → {self.target}: {self.plan.way}, about {size_of(self.plan.memory)}"

    def print(self) -> None:
        """Print the plan as a table."""
        print_plan(self.sources, self.target, self.plan)


def _record_of(sources: list[Path]) -> str | list[str]:
    """Return the inputs as the record of `--json` names them."""
    names = [str(source) for source in sources]
    return names if len(names) > 1 else names[0]


@dataclass(frozen=True)
class _Run:
    """The simplification of one cloud.

    `written` has the number of points in each file, from the coarsest level to the finest; `asked` is what was asked of
    diagnostics, by their names.
    """

    sources: list[Path]
    written: dict[Path, int]
    points: int
    readings: int
    result: Result
    asked: dict[str, str]
    unit: str | None

    @property
    def target(self) -> Path:
        """The file of the whole result."""
        return list(self.written)[-1]

    def record(self) -> dict[str, Any]:
        """Return the run as the record that `--json` prints."""
        return {
            "input": _record_of(self.sources),
            "output": str(self.target),
            **({"levels": self._levels()} if len(self.written) > 1 else {}),
            "points_in": self.points,
            "points_out": len(self.result.indices),
            "method": self.result.method.name,
            "parameters": dataclasses.asdict(self.result.method),
            "diagnostics": dict(self.result.diagnostics),
            "seconds": dict(self.result.seconds),
            "seconds_compiling": self.result.seconds.get(COMPILATION, 0.0),
            "readings": self.readings,
            "peak_memory": peak_memory(),
            "version": __version__,
        }

    def line(self) -> str:
        """Return the run as one line."""
        counts = f"{self.points:,} points in, {len(self.result.indices):,} out"
        targets = ", ".join(map(str, self.written))
        return f"{titled(self.sources)} → {targets}: {counts}, {sum(self.result.seconds.values()):.2f} s"

    def _levels(self) -> list[dict[str, Any]]:
        """Return the files of the levels for the record."""
        return [{"output": str(file), "points_out": count} for file, count in self.written.items()]

    def print(self) -> None:
        """Print the run as a table."""
        from gppcs.app.console import print_table

        kept = len(self.result.indices)
        print_table(
            f"{titled(self.sources)} → {self.target}",
            {
                "points": f"{self.points:,} in, {kept:,} out ({100 * kept / self.points:.3g} %)",
                **({} if len(self.written) == 1 else self._rows_of_levels()),
                **({"points on disk": f"files read {self.readings} times"} if self.readings > 1 else {}),
                "method": str(self.result.method),
                **dict(self._in_words(name, value) for name, value in self.result.diagnostics.items() if value),
                "time": time_in_words(self.result.seconds),
            },
        )

    def _rows_of_levels(self) -> dict[str, str]:
        """Return a row of the table for the file of each level."""
        return {f"level {n}": f"{file}: {count:,} points" for n, (file, count) in enumerate(self.written.items())}

    def _in_words(self, name: str, value: float) -> tuple[str, str]:
        """Return a diagnostic as a row of the table, with what was asked of it."""
        if name == "noise_in_spacings":
            return "noise", _noise_in_words(value)
        is_length = name.startswith(("surface_", "largest_"))
        unit = f" {self.unit}" if self.unit and is_length else ""
        asked = f"  (asked: {self.asked[name]})" if name in self.asked else ""
        return name.replace("_", " "), number_in_words(value) + unit + asked


def _noise_in_words(noise: float) -> str:
    """Return what the noise of the points, as a share of the spacing of the kept ones, means for the result."""
    meaning = next(
        words
        for most, words in (
            (0.04, "little, it changes nothing"),
            (0.25, "some, kept points favour the surface that is fitted through it"),
            (float("inf"), "much; with fewer points it would matter less"),
        )
        if noise <= most
    )
    return f"{100 * noise:.2g} % of the spacing of the kept points: {meaning}"
