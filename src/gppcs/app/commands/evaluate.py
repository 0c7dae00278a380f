"""The command `gppcs evaluate`: how good a simplified cloud or mesh is."""

from pathlib import Path
from typing import Annotated

import gppcs
from gppcs.app import options
from gppcs.app.options import option
from gppcs.app.printing import emit, names_of, note_units, print_error, started, text_of, unit_text
from gppcs.errors import ParameterError
from gppcs.evaluation.report import DetailErrors, Figures, MeshReport, Rebuilt, Report, definition_of


def _defined(report: type[Figures]) -> str:
    return "\n\n".join(
        f"[cyan]{name.replace('_', ' ')}[/cyan] ({figure.unit}): {figure.definition}"
        for name, figure in report.definitions().items()
    )


EPILOG = (
    "gppcs evaluate scan.ply small.ply\n\n"
    "gppcs evaluate scan.ply small.ply --mesh surface.ply --json\n\n"
    "gppcs evaluate scan.ply small.ply --detail rgb\n\n"
    "gppcs evaluate scan.ply --simplified-mesh mesh.ply\n\n"
    f"[bold]Figures[/bold] (lengths in the unit of the clouds)\n\n{_defined(Report)}\n\n"
    "The area that a point stands for is an eighth of the disc around it that reaches to its 8th neighbour. The "
    "largest 1 % of the areas are cut to their 99th percentile, so that a few outliers do not count as much as all "
    "other points.\n\n"
    f"[bold]With --detail NAME[/bold] (the names of the figures start with that of the attribute)\n\n"
    f"{_defined(DetailErrors)}\n\n"
    f"[bold]With a mesh[/bold] (needs the extra evaluate)\n\n{_defined(Rebuilt)}\n\n"
    "The surface is rebuilt with the normals of the mesh at the nearest original points, which judges the points "
    "alone. It is rebuilt a second time with normals estimated on the simplified cloud, as in the paper, and if this "
    "cloud carries normals (nx, ny, nz), a third time with these: the names of these figures start with estimated and "
    "carried.\n\n"
    f"[bold]Of a simplified mesh[/bold] (needs the extra evaluate)\n\n{_defined(MeshReport)}"
)


def evaluate(
    original: Annotated[Path, options.files("ORIGINAL", "The original cloud.")],
    simplified: Annotated[Path | None, options.files("SIMPLIFIED", "The simplified cloud.")] = None,
    mesh: Annotated[Path | None, option("The surface of ORIGINAL, to compare the surface of SIMPLIFIED with.")] = None,
    simplified_mesh: Annotated[Path | None, option("A mesh to judge, in place of SIMPLIFIED.", metavar="FILE")] = None,
    detail: options.Measured = None,
    input_format: options.From = None,
    columns: options.Columns = None,
    threads: options.Threads = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Measure how good a simplified cloud or mesh is. Points with NaN or infinite coordinates are left out."""
    from gppcs.app.outputs import read_each
    from gppcs.clouds.quantities import unit_of

    timer = started(quiet, threads)
    if (simplified is None) == (simplified_mesh is None):
        raise ParameterError("expected a second file, SIMPLIFIED, or --simplified-mesh FILE, found both or neither")
    if detail and simplified_mesh:
        raise ParameterError("expected --detail with SIMPLIFIED, found --simplified-mesh")
    surface = gppcs.read_mesh(mesh) if mesh else None
    judged = gppcs.read_mesh(simplified_mesh) if simplified_mesh else None
    with timer("reading"):
        read = read_each([original, *filter(None, [simplified])], input_format, names_of(columns))
    clouds = [cloud[cloud.is_finite()] for cloud, _ in read]
    report: Report | MeshReport
    if judged:
        report = gppcs.evaluate_mesh(clouds[0], judged, surface, timer)
    else:
        report = gppcs.evaluate(clouds[0], clouds[1], surface, timer, detail or ())
    record = {
        "original": str(original),
        **({"simplified_mesh": str(simplified_mesh)} if judged else {"simplified": str(simplified)}),
        "mesh": str(mesh) if mesh else None,
        "figures": report.figures(),
        "relative": report.figures(relative=True),
    }
    note_units(original, clouds[0])
    table = _table(report, unit_of(clouds[0].header))
    emit(record, as_json, quiet, f"{original} → {simplified_mesh or simplified}", table)
    for name, value in report.figures().items():
        if name.endswith("stray_share") and value > 0:
            print_error(f"note: {name.replace('_', ' ')}: {value:.2%} of a rebuilt mesh lies far from the original")


def _table(report: Report | MeshReport, unit: str | None) -> dict[str, str]:
    """Return the figures with their units, for a table."""
    figures, relative = report.figures(), report.figures(relative=True)
    table = {"unit": unit_text(unit)}
    for name, value in figures.items():
        kind = definition_of(name).unit
        if kind == "length":
            part = "" if name == "diagonal" else f"  ({relative[name]:.3%} of the diagonal)"
            table[name] = f"{value:.4g} {unit or ''}".rstrip() + part
        elif kind == "squared length":
            table[name] = f"{value:.4g}  ({relative[name]:.3g} of the squared diagonal)"
        elif kind == "share":
            table[name] = f"{100 * value:.4g} %"
        else:
            table[name] = text_of(value) + (" degrees" if kind == "degrees" else "")
    return table
