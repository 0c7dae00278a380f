"""The command `gppcs`: results to stdout, progress and errors to stderr."""

from __future__ import annotations

import dataclasses
import json
import sys
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gppcs import __version__
from gppcs.errors import GppcsError, InputError, OutputError, ParameterError
from gppcs.methods import DEFAULT, METHODS, Method, method_named

if TYPE_CHECKING:
    from gppcs.cloud import PointCloud
    from gppcs.evaluation import Report
    from gppcs.simplification import Result

BAD_INPUT = 2
INTERRUPTED = 130
FAILURES = (GppcsError, OSError, MemoryError)  # told in one line

_METHOD_LIST = "\n\n".join(
    f"[cyan]{method.name}[/cyan]: {method.summary} [dim]({method.source})[/dim]" for method in METHODS.values()
)

app = typer.Typer(
    name="gppcs",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Thin a point cloud to exactly the number of points asked for, and keep its features.",
    epilog="[bold]Examples[/bold]\n\n"
    "gppcs sample bracket -o scan.ply\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.03 --picture small.png\n\n"
    "gppcs info small.ply",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object a line, for machines.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist; never an input.")]


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit


@app.command(
    epilog="[bold]Examples[/bold]\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.03 --figures\n\n"
    "gppcs simplify scan.ply -o small.ply --points 5000 --method fps\n\n"
    "gppcs simplify scan.ply -o small.ply --ratio 0.1 --set eigenfunctions=50\n\n"
    "gppcs simplify a.ply b.ply -o folder --ratio 0.1 --json\n\n"
    "[bold]Methods[/bold] (their parameters: gppcs methods)\n\n" + _METHOD_LIST,
)
def simplify(
    inputs: Annotated[list[Path], typer.Argument(metavar="IN...", help="Point cloud files.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="OUT", help="The file to write; for several inputs, a folder."),
    ],
    ratio: Annotated[float | None, typer.Option(help="Share of the points to keep, above 0, at most 1.")] = None,
    points: Annotated[int | None, typer.Option(help="Number of points to keep.")] = None,
    method: Annotated[str, typer.Option(help="Name of the method; see below.")] = DEFAULT,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A parameter of the method; may be repeated."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Of all that is drawn at random; methods without chance ignore it.")
    ] = None,
    invalid: Annotated[
        Literal["error", "drop"], typer.Option(help="What to do with NaN and infinite coordinates.")
    ] = "error",
    figures: Annotated[bool, typer.Option("--figures", help="Measure how good the result is.")] = False,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Draw original and result, coloured by surface variation."),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Keep exactly the number of points asked for, each with all its attributes.

    Of several inputs, those that can be used are simplified even if others cannot.
    """
    options = {
        "ratio": ratio,
        "n_points": points,
        "method": method_named(method, _parsed(settings or [])),
        "seed": seed,
        "invalid": invalid,
    }
    targets = _targets(inputs, output)
    if picture:
        _check_picture(picture, inputs, force)
    failed = False
    for source, target in targets.items():
        try:
            run = _simplify_file(source, target, figures, picture, force, options)
        except ParameterError:
            raise  # it would be wrong for every file
        except FAILURES as error:
            _tell(error, source)
            failed = True
        else:
            if as_json:
                _print_json(run.record())
            else:
                run.print()
    if failed:
        raise typer.Exit(BAD_INPUT)


def _parsed(settings: list[str]) -> dict[str, str]:
    """Split KEY=VALUE."""
    for setting in settings:
        if "=" not in setting:
            raise ParameterError(f"expected --set KEY=VALUE, found {setting!r}")
    return {key: value for key, _, value in (setting.partition("=") for setting in settings)}


def _targets(inputs: list[Path], output: Path) -> dict[Path, Path]:
    """Return the file to write for each input."""
    if output.is_dir():
        targets = {source: output / source.name for source in inputs}
    elif len(inputs) == 1:
        targets = {inputs[0]: output}
    else:
        raise OutputError(
            f"{output}: expected a folder for the results of {len(inputs)} inputs, found none; make it first"
        )
    if len(set(targets.values())) < len(inputs):
        raise OutputError(f"{output}: expected inputs with different names, found two that would write one file")
    return targets


def _check_picture(picture: Path, inputs: list[Path], force: bool) -> None:
    """Make sure that the picture can be drawn and written."""
    from gppcs.io import check_writable
    from gppcs.picture import require_matplotlib

    if len(inputs) > 1:
        raise ParameterError(f"expected one input with --picture, found {len(inputs)}")
    if picture.suffix.lower() != ".png":
        raise OutputError(f"{picture}: expected a name that ends in .png for the picture")
    require_matplotlib()
    check_writable(picture, force)


def _simplify_file(
    source: Path, target: Path, figures: bool, picture: Path | None, force: bool, options: dict[str, Any]
) -> _Run:
    """Simplify one file, with `options` for `simplify`."""
    from gppcs import io
    from gppcs.console import ProgressBar, compilation_noticed
    from gppcs.evaluation import evaluate
    from gppcs.simplification import simplify
    from gppcs.stages import Stages

    io.format_to_write(target)
    io.check_writable(target, force)
    if target.exists() and source.exists() and target.samefile(source):
        raise OutputError(f"{target}: expected a file other than the input, found the same; choose another name")
    stages = Stages(ProgressBar())
    with compilation_noticed() as compilation:
        with stages("reading"):
            cloud = io.read(source)
        result = simplify(cloud, stages=stages, **options)
        report = image = None
        if figures:
            with stages("figures"):
                report = evaluate(cloud.take(_finite(cloud)), result.cloud)
        if picture:
            with stages("picture"):
                image = _drawn(cloud, result)
        with stages("writing"):
            io.write(target, result.cloud, force=force)
            if picture and image:
                with io.whole_file(picture, force) as file:
                    file.write(image)
    return _Run(source, target, cloud, result, report, compilation.seconds)


def _finite(cloud: PointCloud) -> Any:
    import numpy as np

    return np.delete(np.arange(len(cloud)), cloud.non_finite())


def _drawn(cloud: PointCloud, result: Result) -> bytes:
    """Return a PNG of the cloud and of what was kept of it."""
    import numpy as np

    from gppcs.features import estimate_features
    from gppcs.picture import Panel, draw

    rows = _finite(cloud)
    points = cloud.points[rows]
    features = estimate_features(points - points.min(axis=0))
    kept = np.searchsorted(rows, result.indices)
    image = BytesIO()
    draw(
        image,
        [
            Panel("original", points, features.surface_variation, features.normals),
            Panel(result.method.name, points[kept], features.surface_variation[kept], features.normals[kept]),
        ],
    )
    return image.getvalue()


@dataclass(frozen=True)
class _Run:
    """What was done to one file."""

    source: Path
    target: Path
    cloud: PointCloud
    result: Result
    report: Report | None
    compiling: float

    def record(self) -> dict[str, Any]:
        """Return it for machines."""
        return {
            "input": str(self.source),
            "output": str(self.target),
            "points_in": len(self.cloud),
            "points_out": len(self.result.indices),
            "method": self.result.method.name,
            "parameters": dataclasses.asdict(self.result.method),
            "diagnostics": dict(self.result.diagnostics),
            "seconds": dict(self.result.seconds),
            "seconds_compiling": self.compiling,
            "figures": dataclasses.asdict(self.report) if self.report else None,
            "version": __version__,
        }

    def print(self) -> None:
        """Print it for people."""
        from gppcs.console import print_table

        seconds = {f"{stage}, s": f"{value:.2f}" for stage, value in self.result.seconds.items()}
        total = f"{sum(self.result.seconds.values()):.2f}"
        if self.compiling:
            total += f", of which {self.compiling:.2f} compiling kernels, this time only"
        figures = dataclasses.asdict(self.report) if self.report else {}
        print_table(
            f"{self.source} → {self.target}",
            {
                "points": f"{len(self.cloud):,} in, {len(self.result.indices):,} out",
                "method": _written(self.result.method),
                **{name: f"{value:.4g}" for name, value in self.result.diagnostics.items()},
                **seconds,
                "all, s": total,
                **{name.replace("_", " "): f"{value:.4g}" for name, value in figures.items() if "points" not in name},
            },
        )


def _written(method: Method) -> str:
    """Return the method with its parameters, as one line."""
    parameters = ", ".join(f"{name}={value}" for name, value in dataclasses.asdict(method).items())
    return f"{method.name} ({parameters})" if parameters else method.name


def _print_json(record: dict[str, Any]) -> None:
    """Print one line of strict JSON; what is not a number becomes null."""

    def strict(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: strict(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [strict(item) for item in value]
        if isinstance(value, float) and value - value != 0:
            return None
        return value

    typer.echo(json.dumps(strict(record), allow_nan=False))


@app.command(epilog="[bold]Example[/bold]\n\ngppcs info scan.ply --json")
def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A point cloud file.", show_default=False)],
    as_json: Json = False,
) -> None:
    """Print points, bounds, spacing, attributes, repeats and coordinates that are not finite."""
    from gppcs import io
    from gppcs.console import compilation_noticed, print_table
    from gppcs.summary import info as summarise

    with compilation_noticed():
        summary = summarise(io.read(file))
    if as_json:
        _print_json({"file": str(file), **dataclasses.asdict(summary)})
        return
    rows = {
        "points": f"{summary.points:,}",
        "low corner": "  ".join(f"{value:.9g}" for value in summary.low),
        "high corner": "  ".join(f"{value:.9g}" for value in summary.high),
        "diagonal": f"{summary.diagonal:.6g}",
        "spacing": f"{summary.spacing:.4g} (median distance to the nearest other point)",
        "repeats": f"{summary.repeats:,}",
        "not finite": f"{summary.non_finite:,}",
        "coordinates": summary.coordinate_type,
    }
    rows |= {f"attribute {name}": kind for name, kind in summary.attributes.items()}
    print_table(str(file), rows)


@app.command(epilog="[bold]Example[/bold]\n\ngppcs sample fan -o fan.ply --points 50000 --noise 0.002")
def sample(
    name: Annotated[str, typer.Argument(metavar="NAME", help="medallion, bracket, fan or sphere.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT", help="The file to write.")],
    points: Annotated[int, typer.Option(help="Number of points, outliers among them.")] = 200_000,
    noise: Annotated[
        float, typer.Option(help="Standard deviation of each coordinate, as a share of the diagonal.")
    ] = 0.0,
    outliers: Annotated[float, typer.Option(help="Share of points that lie anywhere in the box.")] = 0.0,
    uneven: Annotated[float, typer.Option(help="Share of its density lost over the scan, 0 to below 1.")] = 0.0,
    seed: Annotated[int, typer.Option(help="The same seed gives the same scan.")] = 0,
    force: Force = False,
) -> None:
    """Make a scan of a surface that is known exactly, with its normals and curvature."""
    from gppcs import io, scans

    io.format_to_write(output)
    io.check_writable(output, force)
    io.write(output, scans.sample(name, points, noise, outliers, uneven, seed), force=force)


@app.command()
def methods(as_json: Json = False) -> None:
    """List the methods with their sources and parameters."""
    if as_json:
        for method in METHODS.values():
            _print_json(
                {
                    "name": method.name,
                    "summary": method.summary,
                    "source": method.source,
                    "parameters": dataclasses.asdict(method()),
                }
            )
        return
    from gppcs.console import print_table

    for method in METHODS.values():
        rows = {"source": method.source}
        parameters = dataclasses.asdict(method())
        if parameters:
            rows["parameters"] = ", ".join(f"{key}={value}" for key, value in parameters.items())
        print_table(f"{method.name}: {method.summary}", rows)


def main() -> None:
    """Run the command; what goes wrong becomes one line on stderr and exit code 2."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may hold anything, terminals may not
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except FAILURES as error:
        _tell(error)
        code = BAD_INPUT
    except KeyboardInterrupt:
        code = INTERRUPTED
    except Exception as error:
        if not hasattr(error, "format_message"):  # Typer's own complaints about the command line
            raise
        _print_error(error.format_message())
        code = BAD_INPUT
    sys.exit(code if isinstance(code, int) else 0)


def _tell(error: BaseException, source: Path | None = None) -> None:
    """Print what went wrong; errors about a cloud do not know which file it came from."""
    if isinstance(error, InputError) and source:
        _print_error(f"{source}: {error}")
    elif isinstance(error, OSError) and error.filename:
        _print_error(f"{error.filename}: {error.strerror}")
    else:
        _print_error(str(error) or "not enough memory")


def _print_error(message: str) -> None:
    typer.echo(f"gppcs: {' '.join(message.split())}", err=True)
