"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs import __version__
from gppcs.app.printing import (
    BAD_INPUT,
    FAILURES,
    Force,
    Invalid,
    Json,
    Lossy,
    Threads,
    figure_rows,
    note_left_out,
    print_json,
    tell,
)
from gppcs.app.viewpoint import Up, View, viewpoint_of
from gppcs.engine.memory import peak_memory
from gppcs.engine.stages import COMPILATION
from gppcs.engine.threads import set_threads
from gppcs.errors import OutputError, ParameterError
from gppcs.methods import DEFAULT, METHODS, Method, method_named

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud
    from gppcs.drawing.camera import Viewpoint
    from gppcs.evaluation.report import Report
    from gppcs.simplification import Result

EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.03 --figures\n\n"
    "gppcs simplify scan.ply -o small.ply --points 5000 --method fps\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --set feature_weight=0.8\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --normals\n\n"
    "gppcs simplify a.ply b.ply -o folder --ratio 0.1 --json\n\n"
    "[bold]Output of --json[/bold]\n\n"
    "Besides input, output, method and figures: [cyan]seconds[/cyan], the time of each stage; "
    "[cyan]seconds_compiling[/cyan], the part of it that only a first run takes; and [cyan]peak_memory[/cyan], the "
    "most bytes that the process has held so far, or null if the system does not report it.\n\n"
    "[bold]Methods[/bold] (their parameters: gppcs methods NAME)\n\n"
    + "\n\n".join(
        f"[cyan]{method.name}[/cyan]: {method.summary} [dim]({method.source})[/dim]" for method in METHODS.values()
    )
)


def simplify(
    inputs: Annotated[list[Path], typer.Argument(metavar="IN...", help="Point cloud files.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="OUT", help="The file to write. For several inputs, an existing folder."
        ),
    ],
    ratio: Annotated[
        float | None, typer.Option(help="Share of the points to keep, above 0 and at most 1. Or give --points.")
    ] = None,
    points: Annotated[int | None, typer.Option(help="Number of points to keep. Or give --ratio.")] = None,
    method: Annotated[str, typer.Option(help="Name of the method, from the list below.")] = DEFAULT,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Set a parameter of the method. Can be repeated."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of random numbers. Methods without random numbers ignore it.")
    ] = None,
    invalid: Invalid = "error",
    normals: Annotated[
        bool,
        typer.Option(
            "--normals",
            help="Add to each kept point a normal estimated from all points of the input, to rebuild a surface. It "
            "replaces a normal of the input. Normals of closed pieces point outward, of flat pieces up.",
        ),
    ] = False,
    scores: Annotated[
        bool,
        typer.Option(
            "--scores", help="Add to each kept point its score and standard deviation when it was chosen (method gp)."
        ),
    ] = False,
    figures: Annotated[
        bool, typer.Option("--figures", help="Measure how good the result is, as gppcs evaluate does.")
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="PNG", help="Draw the original and the result, coloured by surface variation, to a PNG file."
        ),
    ] = None,
    view: View = None,
    up: Up = None,
    threads: Threads = None,
    force: Force = False,
    lossy: Lossy = False,
    as_json: Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    If one of several inputs cannot be used, the others are still simplified.
    """
    from gppcs.io import check_distinct
    from gppcs.simplification import simplify as simplified

    set_threads(threads)
    options: dict[str, Any] = {
        "ratio": ratio,
        "n_points": points,
        "method": method_named(method, _parsed(settings or [])),
        "seed": seed,
        "invalid": invalid,
        "normals": normals,
        "scores": scores,
    }
    viewpoint = viewpoint_of(view, up, picture is not None)
    simplified([[0.0, 0.0, 0.0]], **options)  # checks the options before long work
    targets = _targets(inputs, output)
    if picture:
        _check_picture(picture, inputs, force)
    check_distinct([*targets.values(), *([picture] if picture else [])], inputs)
    failed = False
    for source, target in targets.items():
        try:
            run = _simplify_file(source, target, figures, picture, viewpoint, force, lossy, options)
        except FAILURES as error:
            tell(error, source)
            failed = True
        else:
            if as_json:
                print_json(run.record())
            else:
                run.print()
    if failed:
        raise typer.Exit(BAD_INPUT)


def _parsed(settings: list[str]) -> dict[str, str]:
    """Return settings of the form KEY=VALUE as a dictionary."""
    for setting in settings:
        if "=" not in setting:
            raise ParameterError(f"expected --set KEY=VALUE, found {setting!r}")
    return {key: value for key, _, value in (setting.partition("=") for setting in settings)}


def _targets(inputs: list[Path], output: Path) -> dict[Path, Path]:
    """Return the output file of each input."""
    if output.is_dir():
        targets = {source: output / source.name for source in inputs}
    elif len(inputs) == 1:
        targets = {inputs[0]: output}
    else:
        raise OutputError(
            f"{output}: expected a folder for the results of {len(inputs)} inputs, found none; make it first"
        )
    if len(set(targets.values())) < len(inputs):
        raise OutputError(f"{output}: expected inputs with different names, found two with one output file; rename one")
    return targets


def _check_picture(picture: Path, inputs: list[Path], force: bool) -> None:
    """Check that the picture can be drawn and written."""
    from gppcs.engine.extras import require_matplotlib
    from gppcs.io import check_writable

    if len(inputs) > 1:
        raise ParameterError(f"expected one input with --picture, found {len(inputs)}")
    if picture.suffix.lower() != ".png":
        raise OutputError(f"{picture}: expected a name that ends in .png for the picture")
    require_matplotlib()
    check_writable(picture, force)


def _simplify_file(
    source: Path,
    target: Path,
    figures: bool,
    picture: Path | None,
    viewpoint: Viewpoint,
    force: bool,
    lossy: bool,
    options: dict[str, Any],
) -> _Run:
    """Simplify one file; `options` are the arguments of `gppcs.simplify`."""
    from gppcs import io
    from gppcs.app.console import ProgressBar
    from gppcs.engine.stages import Stages
    from gppcs.evaluation.judge import evaluate
    from gppcs.simplification import simplify

    io.format_to_write(target)
    io.check_writable(target, force)
    stages = Stages(ProgressBar())
    with stages("reading"):
        cloud, unread = io.load(source)
    if not lossy:
        io.check_losses(target, cloud)
    result = simplify(cloud, stages=stages, **options)
    report = image = None
    if figures:
        with stages("figures"):
            report = evaluate(cloud.take(cloud.finite_rows()), result.cloud)
    if picture:
        with stages("picture"):
            image = _drawn(cloud, result, viewpoint)
    with stages("writing"):
        io.write(target, result.cloud, force=force, lossy=lossy)
        if picture and image:
            with io.whole_file(picture, force) as file:
                file.write(image)
    note_left_out(target, [*unread, *io.losses(target, result.cloud)])
    return _Run(source, target, cloud, result, report)


def _drawn(cloud: PointCloud, result: Result, viewpoint: Viewpoint) -> bytes:
    """Return a PNG of the original and the simplified cloud."""
    import numpy as np

    from gppcs.drawing.cloud_images import ColouredCloud
    from gppcs.drawing.pair import draw_pair

    rows = cloud.finite_rows()
    original = ColouredCloud.by_surface_variation(cloud.points[rows])
    kept = np.searchsorted(rows, result.indices)
    simplified = ColouredCloud(
        result.cloud.points, original.values[kept]
    )  # at the places to which the method moved them
    image = BytesIO()
    draw_pair(image, result.method.label, original, simplified, viewpoint)
    return image.getvalue()


@dataclass(frozen=True)
class _Run:
    """The simplification of one file."""

    source: Path
    target: Path
    cloud: PointCloud
    result: Result
    report: Report | None

    def record(self) -> dict[str, Any]:
        """Return the run as the record that `--json` prints."""
        return {
            "input": str(self.source),
            "output": str(self.target),
            "points_in": len(self.cloud),
            "points_out": len(self.result.indices),
            "method": self.result.method.name,
            "parameters": dataclasses.asdict(self.result.method),
            "diagnostics": dict(self.result.diagnostics),
            "seconds": dict(self.result.seconds),
            "seconds_compiling": self.result.seconds.get(COMPILATION, 0.0),
            "peak_memory": peak_memory(),
            "figures": self.report.figures() if self.report else None,
            "version": __version__,
        }

    def print(self) -> None:
        """Print the run as a table."""
        from gppcs.app.console import print_table
        from gppcs.engine.kernel_cache import are_kept

        seconds = dict(self.result.seconds)
        total = f"{sum(seconds.values()):.2f}"
        if compilation := seconds.pop(COMPILATION, 0.0):
            total += f", of which {compilation:.2f} compiling kernels"
            total += ", this time only" if are_kept() else ""
        print_table(
            f"{self.source} → {self.target}",
            {
                "points": f"{len(self.cloud):,} in, {len(self.result.indices):,} out",
                "method": _written(self.result.method),
                **{name: f"{value:.4g}" for name, value in self.result.diagnostics.items()},
                **{f"{stage}, s": f"{value:.2f}" for stage, value in seconds.items()},
                "all, s": total,
                **(figure_rows(self.report) if self.report else {}),
            },
        )


def _written(method: Method) -> str:
    """Return the method with all its parameters as one line."""
    parameters = ", ".join(f"{name}={value}" for name, value in dataclasses.asdict(method).items())
    return f"{method.name} ({parameters})" if parameters else method.name
