"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gppcs.app import options
from gppcs.app.levels import Levels
from gppcs.app.options import option
from gppcs.app.outputs import outputs_of
from gppcs.app.panels import ATTRIBUTES, CHOICE, LARGE, METHOD, SIZE
from gppcs.app.printing import emit, for_each, names_of, say, say_aside, started
from gppcs.errors import ParameterError, shown
from gppcs.methods import DEFAULT, METHODS, Feature, Method

if TYPE_CHECKING:
    from gppcs.app.runs import Told

KINDS = ("invalid", "outliers")  # of points that --drop leaves out
ADDED = ("normals", "scores", "index", "kept")  # what --add adds
SPACING = "Keep as many points as have this spacing: 0.05, 5cm or 1%. In place of --points. " + " ".join(
    f"{name}: {method.supports[Feature.SPACING]}"
    for name, method in METHODS.built_in.items()
    if Feature.SPACING in method.supports
)

EPILOG = (
    "gppcs simplify scan.ply -o small.ply --ratio 0.03\n\n"
    "gppcs simplify scan.ply -o small.ply --points 5000 --method fps\n\n"
    "gppcs simplify scan.ply -o small.ply --tolerance 0.02%\n\n"
    "gppcs simplify scan.laz -o small.laz --spacing 50cm --only 'classification != 7'\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --set feature_weight=0.8\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --add normals\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.05 --denoise\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --detail rgb\n\n"
    "gppcs simplify scan.ply -o 'scan_{level}.ply' --levels 10%,3%,1%\n\n"
    "gppcs simplify a.ply b.ply -o folder/ --ratio 10% --json\n\n"
    "gppcs simplify tile1.laz tile2.laz -o small.laz --ratio 0.2% --memory 4GB\n\n"
    "gppcs simplify scans -o '{parent}/{stem}_small.ply' --points 5k\n\n"
    "[bold]Output of --json[/bold]\n\n"
    "Besides input, output and method: [cyan]seconds[/cyan], the time of each stage; "
    "[cyan]seconds_compiling[/cyan], the part of it that only a first run takes; and [cyan]peak_memory[/cyan], the "
    "most bytes that the process has held so far, or null if the system does not report it. If several inputs "
    "are one cloud, input is a list. With --dry-run, the plan stands in place of the result.\n\n"
    "[bold]Methods[/bold] (their parameters: gppcs methods NAME)\n\n"
    + "\n\n".join(
        f"[cyan]{method.name}[/cyan]: {method.summary} [dim]({method.source})[/dim]"
        for method in METHODS.built_in.values()
    )
)


def simplify(
    inputs: Annotated[list[Path], options.files("IN...", options.FILES)],
    output: Annotated[
        str,
        option(
            "The file to write. Several inputs are then one cloud. For a result of each input, give a folder, or a "
            "pattern with {stem} (the name of the input without suffix), {name}, {suffix} or {parent} (its folder). A "
            "folder is made if it is missing; end the name of a new one with a slash.",
            None,
            "--output",
            "-o",
            metavar="OUT",
        ),
    ],
    ratio: options.Ratio = None,
    points: options.Points = None,
    tolerance: Annotated[
        str | None,
        option(
            "Keep the fewest points whose local surface no original point is farther from than this, outliers aside: "
            "0.5 (in the unit of the coordinates), 0.5mm, or 0.02% of the diagonal. With :p95, :mean or :rms behind "
            "it, it bounds that error instead; with :max, outliers count, too. In place of --points.",
            SIZE,
            metavar="LENGTH[:p95]",
        ),
    ] = None,
    spacing: Annotated[str | None, option(SPACING, SIZE, metavar="LENGTH")] = None,
    max_gap: Annotated[
        str | None,
        option(
            "Add points until each original point has a kept one within this distance. Alone or with --points and so "
            "on.",
            SIZE,
            metavar="LENGTH",
        ),
    ] = None,
    levels: Annotated[
        str | None,
        option(
            "Make several sizes at once, such as 10%,3%,1% or 50k,5k, of which each is the start of the next. With "
            "{level} in the name, each is a file: level 0 is the coarsest. Otherwise OUT is the finest, and its "
            "attribute level tells to which level each point belongs first. In place of --points.",
            SIZE,
            metavar="SIZE,...",
        ),
    ] = None,
    unit: options.Unit = None,
    keep: Annotated[
        str | None,
        option(
            "Keep all points that meet a condition on attributes and x, y, z, such as 'classification == 6'. They "
            "count in --points, and the others are chosen where these are not (method gp).",
            CHOICE,
            metavar="CONDITION",
        ),
    ] = None,
    weight: Annotated[
        str | None,
        option(
            "Multiply the density of the kept points by this attribute, from 0 on (method gp).", CHOICE, metavar="NAME"
        ),
    ] = None,
    detail: Annotated[
        list[str] | None,
        option(
            "Let this attribute count beside the shape: rgb (red, green and blue), a number such as intensity, or "
            "classes. The weight, from 0 to 1000, is 1 if none is given. Can be repeated (method gp).",
            CHOICE,
            metavar="NAME[:WEIGHT]",
        ),
    ] = None,
    quota: Annotated[
        list[str] | None,
        option(
            "Keep exactly this number of points that meet a condition, or this share of the kept points, such as "
            "'classification == 6: 10%'. The other points share the rest. Can be repeated (methods that rank their "
            "points).",
            CHOICE,
            metavar="'CONDITION: NUMBER'",
        ),
    ] = None,
    group: Annotated[
        str | None,
        option(
            "Keep or drop groups whole: points with an equal attribute, such as the pulses of a laser by gps_time. "
            "There are then as near to --points as whole groups allow (methods that rank their points).",
            CHOICE,
            metavar="NAME",
        ),
    ] = None,
    method: Annotated[
        str,
        option(
            "Name of the method, from the list below.", METHOD, metavar="NAME", autocompletion=lambda: list(METHODS)
        ),
    ] = DEFAULT.name,
    settings: Annotated[
        list[str] | None,
        option("Set a parameter of the method. Can be repeated.", METHOD, "--set", metavar="KEY=VALUE"),
    ] = None,
    denoise: Annotated[
        bool,
        option(
            "Move the kept points onto the surface that all points observe with noise. They keep their attributes, "
            "but get normals of that surface if the input has normals (method gp).",
            METHOD,
            "--denoise",
        ),
    ] = False,
    input_format: options.From = None,
    output_format: options.To = None,
    inside: options.Inside = None,
    only: options.Only = None,
    drop: Annotated[
        str | None,
        option(
            "Leave out points before all else: outliers, which neither their neighbours nor the surface explain; "
            "invalid ones, with NaN or infinite coordinates, which are otherwise an error; or invalid,outliers.",
            CHOICE,
            metavar="KIND,...",
        ),
    ] = None,
    add: Annotated[
        str | None,
        option(
            "Add attributes to each kept point. normals: estimated from all points of the input, to rebuild a "
            "surface; those of closed pieces point outward, of flat pieces along +z. scores: the score and standard "
            "deviation when the point was chosen (method gp). index: its row among the points that are read, from 0. "
            "kept, or kept:NAME for another name, alone: write all points that are read, with 1 for kept ones and 0 "
            "for others.",
            ATTRIBUTES,
            metavar="NAME,...",
        ),
    ] = None,
    threads: options.Threads = None,
    memory: options.Memory = None,
    workers: options.Workers = None,
    dry_run: Annotated[
        bool, option("Print what would be done and in how much memory, and do nothing.", LARGE, "--dry-run")
    ] = False,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    If one of several inputs cannot be used, the others are still simplified, and the exit code is 2. The name - stands
    for standard input, or for standard output with --to.
    """
    from gppcs.amounts.options import Options, method_of
    from gppcs.app.runs import Job
    from gppcs.io import check_distinct

    timer = started(quiet, threads)
    amount: dict[str, Any] = {"ratio": ratio, "n_points": points, "tolerance": tolerance, "spacing": spacing}
    amount["max_gap"] = max_gap
    chosen = method_of(method, settings=_parsed(settings or []))
    dropped = _listed("--drop", names_of(drop) or [], KINDS)
    added, mark = _added(add)
    excluded = {**amount, "add kept": mark, "quota": quota, "group": group}
    wanted = None if levels is None else _checked_levels(levels, excluded, chosen)
    request = Options(
        **amount | (wanted.finest if wanted else {}), unit=unit, keep=keep, weight=weight,
        detail=options.weights_of(detail),
        quota=None if quota is None else dict(map(_numbered, quota)), group=group, method=chosen,
        invalid="drop" if "invalid" in dropped else "error", normals="normals" in added, scores="scores" in added,
        drop_outliers="outliers" in dropped, denoise=denoise, format=input_format, inside=inside or None, only=only,
        memory=memory, workers=workers,
    )  # fmt: skip
    if dry_run and request.amount.ratio is None and request.amount.n_points is None:
        raise ParameterError(
            "expected --ratio or --points with --dry-run, as the number of points is known only after the work"
        )
    if mark is not None and request.algorithm.moves_points:
        raise ParameterError(
            "expected --add kept with a method that moves no points, as it writes them where they were"
        )
    _, files = options.query_of(inside, only)
    outputs = outputs_of(inputs, output, output_format, len(wanted.sizes) if wanted else 0)
    written = [target for each in outputs for target in each.targets]
    sources = [source for each in outputs for source in each.sources]
    check_distinct(written, [*inputs, *sources, *files])
    by_source = {each.sources[0]: each for each in outputs}
    job = Job(request, wanted, timer, "index" in added, mark, dry_run, force, lossy)
    several = len(outputs) > 1
    for_each(by_source, lambda source: _print(job.run(by_source[source]), dry_run, several, quiet, as_json))


def _print(told: Told, dry_run: bool, is_one_of_several: bool, quiet: bool, as_json: bool) -> None:
    """Print what is told of a run: beside a cloud on standard output, as one line of several, or in full."""
    from gppcs.io import is_standard

    if is_standard(told.output.targets[-1]) and not dry_run:
        if not quiet:
            say_aside(f"{told.title}: {told.line}")
    elif is_one_of_several and not (quiet or as_json):
        say(f"{told.title}: {told.line}")
    else:
        emit(told.record, as_json, quiet, told.title, told.rows)


def _added(given: str | None) -> tuple[list[str], str | None]:
    """Return what `--add` adds, and the name of the attribute that marks kept points, if any."""
    words = names_of(given) or []
    marks = [word for word in words if word.partition(":")[0] == "kept"]
    others = _listed("--add", [word for word in words if word not in marks], ADDED)
    if marks and len(words) > 1:
        raise ParameterError("expected --add kept alone, as only kept points have the other attributes")
    if "kept:" in marks:
        raise ParameterError("expected --add kept:NAME, found no name")
    return others, marks[0].removeprefix("kept:") if marks else None


def _checked_levels(text: str, excluded: dict[str, Any], method: Method) -> Levels:
    """Return the levels, after checking that they fit the other options."""
    from gppcs.amounts.options import require

    for name, value in excluded.items():
        if value is not None:
            raise ParameterError(f"expected levels without {name}, found both")
    require(method, Feature.RANKING)
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


def _listed(name: str, words: list[str], known: tuple[str, ...]) -> list[str]:
    """Return the words of an option after checking that they are known."""
    for word in words:
        if word not in known:
            raise ParameterError(f"expected {name} with {' or '.join(known)}, found {shown(word)}")
    return words
