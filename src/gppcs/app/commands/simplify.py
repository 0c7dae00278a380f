"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gppcs.app import options
from gppcs.app.levels import Levels
from gppcs.app.outputs import check_output, outputs_of, sources_of
from gppcs.app.pages import SUFFIXES
from gppcs.app.panels import ATTRIBUTES, CHOICE, LOOK, METHOD
from gppcs.app.printing import for_each, names_of, numbers_of, say, say_aside, show, started
from gppcs.app.runs import INDEX, Job, Told
from gppcs.clouds.quantities import option
from gppcs.errors import ParameterError, shown
from gppcs.methods import DEFAULT, METHODS, Method, method_of

KINDS = ("invalid", "outliers")  # of points that --drop leaves out
ADDED = ("normals", "scores", INDEX)  # what --add adds

EPILOG = (
    "gppcs simplify scan.ply -o small.ply --ratio 0.03\n\n"
    "gppcs simplify scan.ply -o small.ply --points 5000 --method fps\n\n"
    "gppcs simplify scan.ply -o small.ply --tolerance 0.02%\n\n"
    "gppcs simplify scan.laz -o small.laz --spacing 50cm --only 'classification != 7'\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --set feature_weight=0.8\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --add normals\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --detail rgb\n\n"
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
    inputs: Annotated[list[Path], options.file_argument("IN...", options.FILES)],
    output: Annotated[
        str,
        options.option(
            "OUT",
            "The file to write. For several inputs a folder, or a pattern with {stem} (the name of the input "
            "without suffix), {name}, {suffix} or {parent} (its folder). A folder is made if it is missing; end the "
            "name of a new one with a slash.",
            None,
            "--output",
            "-o",
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
    detail: options.Detail = None,
    quota: options.Quota = None,
    group: options.Group = None,
    method: Annotated[
        str,
        options.option(
            "NAME", "Name of the method, from the list below.", METHOD, autocompletion=lambda: list(METHODS)
        ),
    ] = DEFAULT,
    settings: Annotated[
        list[str] | None,
        options.option("KEY=VALUE", "Set a parameter of the method. Can be repeated.", METHOD, "--set"),
    ] = None,
    input_format: options.From = None,
    output_format: options.To = None,
    box: options.Box = None,
    only: options.Only = None,
    polygon: options.Inside = None,
    drop: Annotated[
        str | None,
        options.option(
            "KIND,...",
            "Leave out points before all else: outliers, which neither their neighbours nor the surface explain; "
            "invalid ones, with NaN or infinite coordinates, which are otherwise an error; or invalid,outliers.",
            CHOICE,
        ),
    ] = None,
    add: Annotated[
        str | None,
        options.option(
            "NAME,...",
            "Add attributes to each kept point. normals: estimated from all points of the input, to rebuild a "
            "surface; those of closed pieces point outward, of flat pieces along +z. scores: the score and standard "
            "deviation when the point was chosen (method gp). index: its row among the points that are read, from 0.",
            ATTRIBUTES,
        ),
    ] = None,
    mark: Annotated[
        str | None,
        options.option(
            "NAME",
            "Write all points that are read, with an attribute NAME: 1 for kept points, 0 for others.",
            ATTRIBUTES,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        options.option(
            "HTML", "Write a page that shows the result beside the original in the browser; see gppcs report.", LOOK
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
    from gppcs.amounts.request import Request
    from gppcs.io import check_distinct
    from gppcs.io.query import Query
    from gppcs.streaming.files import Work
    from gppcs.streaming.sizes import bytes_of
    from gppcs.streaming.workers import executor_of

    timer = started(quiet, threads)
    amount: dict[str, Any] = {"ratio": ratio, "n_points": points, "tolerance": tolerance, "spacing": spacing}
    amount["max_gap"] = max_gap
    chosen = method_of(method, settings=_parsed(settings or []))
    excluded = {**amount, "mark": mark, "quota": quota, "group": group}
    wanted = None if levels is None else _checked_levels(levels, excluded, chosen)
    dropped, added = _listed("--drop", drop, KINDS), _listed("--add", add, ADDED)
    request = Request.of(
        **amount | (wanted.finest if wanted else {}), unit=unit, keep=keep, weight=weight,
        detail=options.weights_of(detail),
        quota=None if quota is None else dict(map(_numbered, quota)), group=group, method=chosen,
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
    read = merged[:1] or inputs
    by_level = wanted.outputs(read, output, output_format) if wanted else [outputs_of(read, output, output_format)]
    sources = list(by_level[-1].targets)
    if report and len(sources) > 1:
        raise ParameterError(f"expected one input with --report, found {len(sources)}")
    if report:
        check_output(report, SUFFIXES, [], force)
    written = [target for level in by_level for target in level.targets.values()]
    check_distinct([*written, *filter(None, [report])], [*inputs, *(merged or sources), *filter(None, [polygon])])
    with executor_of(workers) as executor:
        work = Work(limit, None, executor, timer)
        job = Job(
            by_level, wanted, merged, request, work, input_format, query, INDEX in added, mark, report, context.obj,
            dry_run, force, lossy,
        )  # fmt: skip
        for_each(sources, lambda source: _print(job.run(source), dry_run, len(sources) > 1, quiet, as_json))


def _print(told: Told, dry_run: bool, is_one_of_several: bool, quiet: bool, as_json: bool) -> None:
    """Print what is told of a run: beside a cloud on standard output, as one line of several, or in full."""
    from gppcs.io import is_standard

    if is_standard(told.target) and not dry_run:
        if not quiet:
            say_aside(told.line)
    elif is_one_of_several and not (quiet or as_json):
        say(told.line)
    else:
        show(told.record, told.title, told.rows, as_json, quiet)


def _checked_levels(text: str, excluded: dict[str, Any], method: Method) -> Levels:
    """Return the levels, after checking that they fit the other options."""
    from gppcs.amounts.request import require

    given = [option(name) for name, value in excluded.items() if value is not None]
    if given:
        raise ParameterError(f"expected --levels without {given[0]}")
    require(method, "ranking")
    return Levels.of(text)


def _parsed(settings: list[str]) -> dict[str, str]:
    """Return settings of the form KEY=VALUE as a dictionary."""
    for setting in settings:
        if "=" not in setting:
            raise ParameterError(f"expected --set KEY=VALUE, found {setting!r}")
    return {key: value for key, _, value in (setting.partition("=") for setting in settings)}


def _numbered(quota: str) -> tuple[str, str]:
    """Return condition and number of a quota, given as CONDITION: NUMBER."""
    condition, colon, number = quota.rpartition(":")
    if not colon or not condition.strip() or not number.strip():
        raise ParameterError(
            f"expected --quota 'CONDITION: NUMBER', such as 'classification == 6: 10%', found {shown(quota)}"
        )
    return condition.strip(), number.strip()


def _listed(name: str, given: str | None, known: tuple[str, ...]) -> list[str]:
    """Return the words in a list, after checking that they are known."""
    words = names_of(given) or []
    for word in words:
        if word not in known:
            raise ParameterError(f"expected {name} with {' or '.join(known)}, found {shown(word)}")
    return words
