"""The command `gppcs evaluate`: how good a simplified cloud is."""

from __future__ import annotations

from pathlib import Path

from gppcs.app import options
from gppcs.app.printing import figure_rows, names_of, print_error, show, started
from gppcs.errors import ParameterError
from gppcs.evaluation.report import DetailErrors, MeshReport, Rebuilt, Report, figures_of


def _defined(report: type) -> str:
    return "\n\n".join(
        f"[cyan]{name.replace('_', ' ')}[/cyan] ({figure.unit}): {figure.definition}"
        for name, figure in figures_of(report).items()
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
    "The surface is rebuilt with normals estimated on the simplified cloud. If this cloud carries normals (nx, ny, "
    "nz), the surface is rebuilt a second time with these, and the names of its figures start with carried.\n\n"
    f"[bold]Of a simplified mesh[/bold] (needs the extra evaluate)\n\n{_defined(MeshReport)}"
)


def evaluate(
    original: Path = options.file_argument("ORIGINAL", "The original cloud."),
    simplified: Path | None = options.file_argument("SIMPLIFIED", "The simplified cloud.", default=None),
    mesh: Path | None = options.option(
        None, "The surface of ORIGINAL as a mesh file, to compare the surface rebuilt from SIMPLIFIED with."
    ),
    simplified_mesh: Path | None = options.option(
        "FILE", "A mesh of ORIGINAL to judge, such as one of gppcs mesh, without SIMPLIFIED."
    ),
    detail: list[str] | None = options.MEASURED,
    input_format: str | None = options.FROM,
    columns: str | None = options.COLUMNS,
    threads: int | None = options.THREADS,
    quiet: bool = options.QUIET,
    as_json: bool = options.JSON,
) -> None:
    """Measure how good a simplified cloud or mesh is. Points with NaN or infinite coordinates are left out."""
    from gppcs import io
    from gppcs.clouds.quantities import unit_of
    from gppcs.evaluation.judge import evaluate as measured
    from gppcs.evaluation.judge import evaluate_mesh
    from gppcs.io.mesh_files import read_mesh

    timer = started(quiet, threads)
    if (simplified is None) == (simplified_mesh is None):
        found = "neither" if simplified is None else "both"
        raise ParameterError(f"expected either SIMPLIFIED or --simplified-mesh, found {found}")
    if detail and simplified_mesh:
        raise ParameterError("expected --detail with SIMPLIFIED, found --simplified-mesh")
    surface = read_mesh(mesh) if mesh else None
    judged = read_mesh(simplified_mesh) if simplified_mesh else None
    with timer("reading"):
        inputs = [original, *([simplified] if simplified else [])]
        read = io.read_each(inputs, input_format, names_of(columns))
    if simplified and (faces := read[1][1]):
        print_error(
            f"note: {simplified}: only its points are judged, not its {faces:,} faces; for the mesh, use "
            f"--simplified-mesh {simplified}"
        )
    clouds = [cloud.take(cloud.finite_rows()) for cloud, _ in read]
    report = (
        evaluate_mesh(clouds[0], judged, surface, timer)
        if judged
        else measured(clouds[0], clouds[1], surface, timer, detail or ())
    )
    result = {"simplified_mesh": str(simplified_mesh)} if judged else {"simplified": str(simplified)}
    counts = {} if judged else {"points": f"{len(clouds[0]):,} in, {len(clouds[1]):,} out"}
    show(
        {
            "original": str(original),
            **result,
            "mesh": str(mesh) if mesh else None,
            "figures": report.figures(),
            "relative": report.figures(relative=True),
        },
        f"{original} → {simplified_mesh or simplified}",
        counts | figure_rows(report, unit_of(clouds[0].header)),
        as_json,
        quiet,
    )
    if isinstance(report, Report):
        _note_strays(report)


def _note_strays(report: Report) -> None:
    """Print a note for each surface of which a part lies far from the true one."""
    for name, rebuilt in (("", report.rebuilt), (", with carried normals,", report.rebuilt_carried)):
        if rebuilt and rebuilt.stray_share > 0:
            print_error(
                f"note: {rebuilt.stray_share:.2%} of the rebuilt mesh{name} lies far from the original mesh; "
                "see back max and stray share"
            )
