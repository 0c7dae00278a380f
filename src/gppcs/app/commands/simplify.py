"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from gppcs.amounts.options import Options
from gppcs.app import options
from gppcs.app.options import ATTRIBUTES, CHOICE, HELP, LARGE, METHOD, SIZE, from_field, option
from gppcs.app.printing import emit, for_each, print_error, say, started
from gppcs.errors import ParameterError, shown
from gppcs.methods import DEFAULT, METHODS, Feature

if TYPE_CHECKING:
    from gppcs.app.runs import Job

EPILOG = (
    "gppcs simplify scan.ply -o small.ply --ratio 3%\n\n"
    "gppcs simplify scan.ply -o small.ply --tolerance 0.5%\n\n"
    "gppcs simplify scan.laz -o small.laz --spacing 50cm --only 'classification != 7'\n\n"
    "gppcs simplify scan.ply -o 'scan_{level}.ply' --levels 10%,3%,1%\n\n"
    "gppcs simplify scans -o small/ --points 5k\n\n"
    f"[bold]Methods[/bold] (gppcs methods NAME explains one): {', '.join(METHODS.built_in)}"
)


def simplify(
    inputs: Annotated[list[Path], options.files("IN...", options.FILES)],
    output: Annotated[
        str,
        option(
            "The file to write; several inputs are then one cloud. For a file of each input: a folder, with a slash "
            "behind a new one.",
            None,
            "--output",
            "-o",
            metavar="OUT",
        ),
    ],
    ratio: options.Ratio = None,
    n_points: options.Points = None,
    tolerance: Annotated[str | None, from_field("tolerance", SIZE, "LENGTH[:p95]")] = None,
    spacing: Annotated[str | None, from_field("spacing", SIZE, "LENGTH")] = None,
    max_gap: Annotated[str | None, from_field("max_gap", SIZE, "LENGTH")] = None,
    levels: Annotated[
        str | None,
        option(
            "Make several sizes at once, such as 10%,3%,1%, each the start of the next. With {level} in the name, each "
            "is a file, 0 the coarsest; otherwise the attribute level says to which each point belongs first.",
            SIZE,
            metavar="SIZE,...",
        ),
    ] = None,
    unit: options.Unit = None,
    keep: Annotated[str | None, from_field("keep", CHOICE, "CONDITION")] = None,
    weight: Annotated[str | None, from_field("weight", CHOICE, "FORMULA")] = None,
    detail: Annotated[list[str] | None, from_field("detail", CHOICE, "NAME[:WEIGHT]")] = None,
    quota: Annotated[list[str] | None, from_field("quota", CHOICE, "'CONDITION: N'")] = None,
    invalid: options.Invalid = "error",
    drop_outliers: Annotated[bool, from_field("drop_outliers", CHOICE, None, "--drop-outliers")] = False,
    method: Annotated[
        str,
        option(
            "Name of the method, from the list below.", METHOD, metavar="NAME", autocompletion=lambda: list(METHODS)
        ),
    ] = DEFAULT.name,
    settings: Annotated[
        list[str] | None,
        option(
            "Set a parameter of the method. Can be repeated.",
            METHOD,
            "--set",
            metavar="KEY=VALUE",
            autocompletion=lambda ctx, incomplete: _completed_settings(ctx.params.get("method"), incomplete),
        ),
    ] = None,
    denoise: Annotated[bool, from_field("denoise", METHOD, None, "--denoise")] = False,
    input_format: options.From = None,
    output_format: options.To = None,
    inside: options.Inside = None,
    only: options.Only = None,
    normals: Annotated[bool, from_field("normals", ATTRIBUTES, None, "--normals")] = False,
    scores: Annotated[bool, from_field("scores", ATTRIBUTES, None, "--scores")] = False,
    index: Annotated[
        bool,
        option("Add the index of each kept point among those that are read.", ATTRIBUTES, "--index"),
    ] = False,
    rank: Annotated[
        bool,
        option("Add the place of each kept point in the order of importance.", ATTRIBUTES, "--rank"),
    ] = False,
    order: Annotated[
        Literal["importance", "input", "gps_time"] | None,
        option(f"{HELP['order']} By default input in LAS and LAZ files, else importance.", ATTRIBUTES, metavar="ORDER"),
    ] = None,
    mark: Annotated[
        str | None,
        option(
            "Write all points, with an attribute of this name that is 1 for kept ones and 0 for others.",
            ATTRIBUTES,
            metavar="NAME",
        ),
    ] = None,
    threads: options.Threads = None,
    memory: options.Memory = None,
    workers: options.Workers = None,
    separately: Annotated[
        bool,
        option("Simplify each of several inputs by itself, where their results go to a folder.", None, "--separately"),
    ] = False,
    dry_run: Annotated[
        bool, option("Print what would be done and in how much memory, and do nothing.", LARGE, "--dry-run")
    ] = False,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    Several inputs are one cloud. If the output is a folder, the points of each go to a file of its name; a run that was
    stopped goes on when the command is given again. With --separately, each input is a cloud by itself. The name -
    stands for standard input, or for standard output with --to.
    """
    arguments = {name: value for name, value in locals().items() if name in HELP}
    from gppcs.amounts.options import method_of, require
    from gppcs.app.outputs import Output, outputs_of
    from gppcs.app.runs import Job, plan_job, run_folder, run_job
    from gppcs.engine.timer import Timer
    from gppcs.io import check_distinct, is_standard

    timer = started(quiet, threads)
    arguments |= {
        "method": method_of(method, settings=_settings(settings)),
        "detail": options.weights_of(detail),
        "quota": None if quota is None else dict(map(_condition_and_number, quota)),
        "inside": inside or None,
        "format": input_format,
    }
    sizes = () if levels is None else _sizes(levels)
    _check_together(arguments | {"levels": levels, "index": index, "rank": rank, "mark": mark})
    del arguments["order"]  # which follows from the format of each output if it is not given
    if sizes or rank:
        require(arguments["method"], Feature.RANKING)
    if sizes:
        arguments |= {"ratio": sizes[-1]} if sizes[-1] < 1 else {"n_points": round(sizes[-1])}
    job = Job(Options(**arguments), sizes, index, rank, order, mark, force, lossy)
    if dry_run and job.options.size is None:
        raise ParameterError("expected --ratio or --points with --dry-run, as other options need the points themselves")
    if mark is not None and job.options.algorithm.moves_points:
        raise ParameterError("expected --mark with a method that moves no points, as it writes them where they were")
    outputs = {result.sources[0]: result for result in outputs_of(inputs, output, output_format, len(sizes))}
    targets = [target for result in outputs.values() for target in result.targets]
    sources = [source for result in outputs.values() for source in result.sources]
    check_distinct(targets, [*inputs, *sources, *options.files_of_inside(inside)])

    if len(outputs) > 1 and not separately:
        _check_folder(job)
        if dry_run:
            record, rows = plan_job(job, Output(sources, targets, makes_folders=True, format=output_format))
        else:
            record, rows = run_folder(job, list(outputs.values()), timer)
        emit(record, as_json, quiet, f"{len(sources)} files → {output}", rows)
        return

    def work(source: Path) -> None:
        result = outputs[source]
        record, rows = plan_job(job, result) if dry_run else run_job(job, result, Timer(timer.on_progress))
        line = ", ".join(rows[name].partition(";")[0] for name in ("points", "memory", "time") if name in rows)
        if is_standard(result.targets[-1]) and not dry_run:  # where only the cloud goes
            if not quiet:
                print_error(f"{result.title}: {line}")
        elif len(outputs) > 1 and not (quiet or as_json):
            say(f"{result.title}: {line}")
        else:
            emit(record, as_json, quiet, result.title, rows)

    for_each(outputs, work)


def _check_together(arguments: Mapping[str, Any]) -> None:
    """Check that the options go together of which the library does not know."""
    if arguments["mark"] == "":
        raise ParameterError("expected --mark with the name of an attribute, found nothing")
    sizes = ("ratio", "n_points", "tolerance", "spacing", "max_gap", "quota")
    for name, excluded in {"mark": ("index", "rank", "order", "normals", "scores"), "levels": (*sizes, "mark")}.items():
        for other in excluded:
            if arguments[name] and arguments[other]:
                raise ParameterError(f"expected `{name}` without `{other}`, found both")


def _check_folder(job: Job) -> None:
    """Check that nothing is asked for that files of one cloud together do not get."""
    for name in ("sizes", "index", "rank", "mark"):
        if getattr(job, name):
            option_name = "levels" if name == "sizes" else name
            raise ParameterError(f"expected --{option_name} with one output file or with --separately, found a folder")


def _sizes(levels: str) -> tuple[float, ...]:
    """Return the sizes of levels, from coarse to fine: either fractions of the points or numbers."""
    from gppcs.clouds.quantities import size_of

    values = [size_of("levels", value.strip()) for value in levels.split(",")]
    sizes = sorted(set(values))
    if len(values) > 256:
        raise ParameterError(f"expected --levels with at most 256 sizes, found {len(values)}")
    if sizes[0] < 1 <= sizes[-1]:
        raise ParameterError(f"expected --levels with fractions or with numbers, found both in {shown(levels)}")
    if len(sizes) < len(values):
        raise ParameterError(f"expected --levels with different sizes, such as 10%,3%,1%, found {shown(levels)}")
    return tuple(sizes)


def _completed_settings(method: str | None, incomplete: str) -> list[str]:
    """Return the parameters of a method, and of such as have few values these, that begin as a user has typed."""
    from gppcs.methods.parameters import parameters_of

    settings = list[str]()
    for key, parameter in parameters_of(METHODS.get(method or "", DEFAULT)).items():
        values = ["True", "False"] if parameter.kind == "bool" else re.findall(r'"(.+?)"', parameter.kind)
        settings += [f"{key}={value}" for value in values or [""]]
    return [setting for setting in settings if setting.startswith(incomplete)]


def _settings(settings: list[str] | None) -> dict[str, str]:
    """Return settings of the form KEY=VALUE as a dictionary."""
    for setting in settings or ():
        if "=" not in setting:
            raise ParameterError(f"expected --set KEY=VALUE, found {setting!r}")
    return {key: value for key, _, value in (setting.partition("=") for setting in settings or ())}


def _condition_and_number(quota: str) -> tuple[str, str]:
    """Return condition and number of a quota, given as CONDITION: NUMBER."""
    condition, colon, number = quota.rpartition(":")
    if not colon or not condition.strip() or not number.strip():
        raise ParameterError(f"expected --quota as CONDITION: NUMBER, such as 'z > 6: 10%', found {shown(quota)}")
    return condition.strip(), number.strip()
