"""The command `gppcs simplify`: clouds to files of fewer points."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gppcs import __version__
from gppcs.app.outputs import Outputs, outputs_of
from gppcs.app.printing import (
    BAD_INPUT,
    FAILURES,
    Columns,
    Force,
    From,
    Invalid,
    Json,
    Lossy,
    Quiet,
    Threads,
    To,
    figure_rows,
    names_of,
    note_left_out,
    print_error,
    print_json,
    progress,
    tell,
)
from gppcs.app.quantities import Points, Ratio, count_of, share_of
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
    "gppcs simplify a.ply b.ply -o folder/ --ratio 10% --json\n\n"
    "gppcs simplify scans -o '{parent}/{stem}_small.ply' --points 5k\n\n"
    "gppcs simplify table.txt -o small.ply --points 5k --columns x,y,z,red,green,blue\n\n"
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
    inputs: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...",
            help="Point cloud files. A folder stands for all files in it that gppcs reads.",
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
    ratio: Ratio = None,
    points: Points = None,
    method: Annotated[
        str,
        typer.Option(help="Name of the method, from the list below.", autocompletion=lambda: list(METHODS)),
    ] = DEFAULT,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Set a parameter of the method. Can be repeated."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of random numbers. Methods without random numbers ignore it.")
    ] = None,
    input_format: From = None,
    output_format: To = None,
    columns: Columns = None,
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
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    If one of several inputs cannot be used, the others are still simplified, and the exit code is 2. The name - stands
    for standard input, or for standard output with --to.
    """
    from gppcs.io import check_distinct
    from gppcs.simplification import simplify as simplified

    set_threads(threads)
    options: dict[str, Any] = {
        "ratio": None if ratio is None else share_of(ratio),
        "n_points": None if points is None else count_of(points),
        "method": method_named(method, _parsed(settings or [])),
        "seed": seed,
        "invalid": invalid,
        "normals": normals,
        "scores": scores,
    }
    viewpoint = viewpoint_of(view, up, picture is not None)
    simplified([[0.0, 0.0, 0.0]], **options)  # checks the options before long work
    outputs = outputs_of(inputs, output, output_format)
    sources, targets = list(outputs.targets), list(outputs.targets.values())
    if picture:
        _check_picture(picture, sources, force)
    check_distinct([*targets, *([picture] if picture else [])], sources)
    job = _Job(outputs, options, input_format, names_of(columns), figures, picture, viewpoint, force, lossy, quiet)
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
    if is_standard(run.target):  # there the result goes
        if not job.quiet:
            typer.echo(run.line(), err=True)
    elif as_json:
        print_json(run.record())
    elif job.quiet:
        pass
    elif len(job.outputs.targets) > 1 and not job.figures:
        typer.echo(run.line())
    else:
        run.print()
    return True


def _parsed(settings: list[str]) -> dict[str, str]:
    """Return settings of the form KEY=VALUE as a dictionary."""
    for setting in settings:
        if "=" not in setting:
            raise ParameterError(f"expected --set KEY=VALUE, found {setting!r}")
    return {key: value for key, _, value in (setting.partition("=") for setting in settings)}


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


@dataclass(frozen=True)
class _Job:
    """What to do with each input; `options` are the arguments of `gppcs.simplify`."""

    outputs: Outputs
    options: dict[str, Any]
    input_format: str | None
    columns: list[str] | None
    figures: bool
    picture: Path | None
    viewpoint: Viewpoint
    force: bool
    lossy: bool
    quiet: bool

    def run(self, source: Path) -> _Run:
        """Simplify one file."""
        from gppcs import io
        from gppcs.engine.stages import Stages
        from gppcs.evaluation.judge import evaluate
        from gppcs.simplification import simplify

        target = self.outputs.targets[source]
        self.outputs.check(target, self.force)
        stages = Stages(progress(self.quiet))
        with stages("reading"):
            cloud, _, unread = io.load(source, self.input_format, self.columns)
        if not self.lossy:
            io.check_losses(target, cloud, self.outputs.format)
        result = simplify(cloud, stages=stages, **self.options)
        report = image = None
        if self.figures:
            with stages("figures"):
                report = evaluate(cloud.take(cloud.finite_rows()), result.cloud)
        if self.picture:
            with stages("picture"):
                image = _drawn(cloud, result, self.viewpoint)
        with stages("writing"):
            self.outputs.make_folder(target)
            io.write(target, result.cloud, self.outputs.format, force=self.force, lossy=self.lossy)
            if self.picture and image:
                with io.whole_file(self.picture, self.force) as file:
                    file.write(image)
        note_left_out(target, [*unread, *io.losses(target, result.cloud, self.outputs.format)])
        self._note_all_kept(source, len(result.indices))
        return _Run(source, target, cloud, result, report)

    def _note_all_kept(self, source: Path, kept: int) -> None:
        """Print a note if the input has fewer points than were asked for."""
        asked = self.options["n_points"]
        if asked is not None and kept < asked:
            usable = " with finite coordinates" if self.options["invalid"] == "drop" else ""
            print_error(
                f"note: {source}: all of its {kept:,} points{usable} were kept, fewer than the {asked:,} asked for"
            )


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

    def line(self) -> str:
        """Return the run as one line."""
        counts = f"{len(self.cloud):,} points in, {len(self.result.indices):,} out"
        return f"{self.source} → {self.target}: {counts}, {sum(self.result.seconds.values()):.2f} s"

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
