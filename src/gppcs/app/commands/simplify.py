"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs.amounts.options import Options, Order
from gppcs.app import options
from gppcs.app.options import ATTRIBUTES, CHOICE, HELP, SIZE, from_field, option
from gppcs.app.printing import emit, for_each, print_error, say, started
from gppcs.errors import ParameterError, shown
from gppcs.methods import DEFAULT, METHODS
from gppcs.methods.parameters import parameters_of

if TYPE_CHECKING:
    from gppcs.app.outputs import Output


EPILOG = (
    "gppcs simplify scan.ply -o small.ply --ratio 3%\n\n"
    "gppcs simplify scan.laz -o small.laz --spacing 50cm --only 'z > 2'\n\n"
    "gppcs simplify scan.ply -o 'scan_{level}.ply' --levels 10%,3%,1%\n\n"
    "gppcs simplify scans -o small/ --points 5k\n\n"
    f"[bold]Methods[/bold] (gppcs methods NAME explains one): {', '.join(METHODS.built_in)}"
)


def simplify(
    inputs: Annotated[list[Path], options.files("IN...", options.FILES)],
    output: Annotated[
        str,
        options.output(
            "OUT", "The file to write, or a folder for a file of each input, with a slash behind a new one.", None
        ),
    ],
    ratio: options.Ratio = None,
    n_points: options.Points = None,
    tolerance: Annotated[str | None, from_field("tolerance", SIZE, "LENGTH")] = None,
    spacing: Annotated[str | None, from_field("spacing", SIZE, "LENGTH")] = None,
    max_gap: Annotated[str | None, from_field("max_gap", SIZE, "LENGTH")] = None,
    levels: Annotated[str | None, from_field("levels", SIZE, "SIZE,...")] = None,
    unit: options.Unit = None,
    keep: Annotated[str | None, from_field("keep", CHOICE, "CONDITION")] = None,
    weight: Annotated[str | None, from_field("weight", CHOICE, "FORMULA")] = None,
    detail: Annotated[list[str] | None, from_field("detail", CHOICE, "NAME[:W]")] = None,
    quota: Annotated[list[str] | None, from_field("quota", CHOICE, "RULE")] = None,
    invalid: options.Invalid = "error",
    drop_outliers: Annotated[bool, from_field("drop_outliers", CHOICE, None, "--drop-outliers")] = False,
    method: Annotated[
        str,
        option(
            "Name of the method, from the list below.", CHOICE, metavar="NAME", autocompletion=lambda: list(METHODS)
        ),
    ] = DEFAULT.name,
    settings: Annotated[
        list[str] | None,
        option(
            "Set a parameter of the method. Can be repeated.",
            CHOICE,
            "--set",
            metavar="KEY=VALUE",
            autocompletion=_completed,
        ),
    ] = None,
    denoise: Annotated[bool, option("Move points out of noise: --set denoise=true.", CHOICE, "--denoise")] = False,
    input_format: options.From = None,
    output_format: options.To = None,
    inside: options.Inside = None,
    only: options.Only = None,
    normals: Annotated[bool, from_field("normals", ATTRIBUTES, None, "--normals")] = False,
    scores: Annotated[bool, from_field("scores", ATTRIBUTES, None, "--scores")] = False,
    index: Annotated[bool, from_field("index", ATTRIBUTES, None, "--index")] = False,
    rank: Annotated[bool, from_field("rank", ATTRIBUTES, None, "--rank")] = False,
    order: Annotated[
        Order | None,
        option(f"{HELP['order']} By default input in LAS files.", ATTRIBUTES, metavar="ORDER"),
    ] = None,
    mark: Annotated[str | None, from_field("mark", ATTRIBUTES, "NAME")] = None,
    threads: options.Threads = None,
    memory: options.Memory = None,
    workers: options.Workers = None,
    separately: Annotated[bool, option("Simplify each of several inputs by itself.", None, "--separately")] = False,
    dry_run: Annotated[bool, option("Print the plan and do nothing.", None, "--dry-run")] = False,
    force: options.Force = False,
    lossy: options.Lossy = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    Several inputs are one cloud. If the output is a folder, the points of each go to a file of its name; a run that was
    stopped goes on when the command is given again. The name - is standard input, or with --to standard output.
    """
    arguments = {name: value for name, value in locals().items() if name in HELP}
    from gppcs.amounts.options import method_of
    from gppcs.app.outputs import outputs_of
    from gppcs.app.runs import plan_job, run_job
    from gppcs.engine.timer import Timer
    from gppcs.io import check_distinct, is_standard

    timer = started(quiet, threads)
    parameters = _pairs(settings, "(.*?)=(.*)", "--set KEY=VALUE")
    quotas = _pairs(quota, r"\s*(.*\S)\s*:\s*([^:]*[^:\s])\s*", "--quota as CONDITION: NUMBER, such as 'z > 6: 10%'")
    arguments |= {
        "method": method_of(method, parameters | ({"denoise": True} if denoise else {})),
        "detail": options.weights_of(detail),
        "quota": quotas or None,
        "order": order or "importance",
    }
    chosen = Options(**arguments)
    if dry_run and chosen.size is None:
        raise ParameterError("expected --ratio or --points with --dry-run, as other options need the points themselves")
    reading = {"format": input_format, "inside": inside or None, "only": only}
    how: dict[str, Any] = {"suffix": output_format, "asked_order": order, "force": force, "lossy": lossy}
    results = outputs_of(inputs, output, reading, len(chosen.sizes), separately)
    outputs = [replace(result, **how) for result in results]
    targets = [target for result in outputs for target in result.targets]
    sources = [source for result in outputs for source in result.source.paths]
    check_distinct(targets, [*inputs, *sources, *options.files_of_inside(inside)])

    def work(result: Output) -> None:
        record, rows = plan_job(chosen, result) if dry_run else run_job(chosen, result, Timer(timer.on_progress))
        line = ", ".join(rows[name].partition(";")[0] for name in ("points", "memory", "time") if name in rows)
        if is_standard(result.targets[-1]) and not dry_run:  # where only the cloud goes
            if not quiet:
                print_error(f"{result.title}: {line}")
        elif len(outputs) > 1 and not (quiet or as_json):
            say(f"{result.title}: {line}")
        else:
            emit(record, as_json, quiet, result.title, rows)

    for_each(((result.source.paths[0], result) for result in outputs), work)


def _completed(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the parameters of a method, and of such as have few values these, that begin as a user has typed."""
    settings = list[str]()
    for key, parameter in parameters_of(METHODS.get(ctx.params.get("method") or "", DEFAULT)).items():
        values = ["True", "False"] if parameter.kind == "bool" else re.findall(r'"(.+?)"', parameter.kind)
        settings += [f"{key}={value}" for value in values or [""]]
    return [setting for setting in settings if setting.startswith(incomplete)]


def _pairs(texts: list[str] | None, pattern: str, expected: str) -> dict[str, str]:
    """Return names and values, of which each text holds one of both."""
    pairs = dict[str, str]()
    for text in texts or ():
        match = re.fullmatch(pattern, text, re.DOTALL)
        if not match:
            raise ParameterError(f"expected {expected}, found {shown(text)}")
        if match[1] in pairs:
            raise ParameterError(f"expected {expected}, each once, found {shown(match[1])} twice")
        pairs[match[1]] = match[2]
    return pairs
