"""The command `gppcs evaluate`: how good a simplified cloud is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gppcs.app.printing import Json, Threads, figure_rows, print_error, print_json
from gppcs.engine.threads import set_threads
from gppcs.errors import ParameterError, file_path
from gppcs.evaluation.report import MeshReport, Rebuilt, Report, figures_of

if TYPE_CHECKING:
    from gppcs.clouds.mesh import Mesh
    from gppcs.engine.stages import Stages


def _defined(report: type) -> str:
    return "\n\n".join(
        f"[cyan]{name.replace('_', ' ')}[/cyan] ({figure.unit}): {figure.definition}"
        for name, figure in figures_of(report).items()
    )


EPILOG = (
    "[bold]Examples[/bold]\n\n"
    "gppcs evaluate scan.ply small.ply\n\n"
    "gppcs evaluate scan.ply small.ply --mesh surface.ply --json\n\n"
    "gppcs evaluate scan.ply --simplified-mesh mesh.ply\n\n"
    f"[bold]Figures[/bold] (lengths in the unit of the clouds)\n\n{_defined(Report)}\n\n"
    "The area that a point stands for is an eighth of the disc around it that reaches to its 8th neighbour. The "
    "largest 1 % of the areas are cut to their 99th percentile, so that a few outliers do not count as much as all "
    "other points.\n\n"
    f"[bold]With a mesh[/bold] (needs the extra evaluate)\n\n{_defined(Rebuilt)}\n\n"
    "The surface is rebuilt with normals estimated on the simplified cloud. If this cloud carries normals (nx, ny, "
    "nz), the surface is rebuilt a second time with these, and the names of its figures start with carried.\n\n"
    f"[bold]Of a simplified mesh[/bold] (needs the extra evaluate)\n\n{_defined(MeshReport)}"
)


def evaluate(
    original: Annotated[
        Path, typer.Argument(metavar="ORIGINAL", parser=file_path, help="The original cloud.", show_default=False)
    ],
    simplified: Annotated[
        Path | None,
        typer.Argument(metavar="SIMPLIFIED", parser=file_path, help="The simplified cloud.", show_default=False),
    ] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(
            help="The surface of ORIGINAL as a mesh file, to compare the surface rebuilt from SIMPLIFIED with."
        ),
    ] = None,
    simplified_mesh: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="A mesh of ORIGINAL to judge, such as one of gppcs mesh, without SIMPLIFIED."
        ),
    ] = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Measure how good a simplified cloud or mesh is. Points with NaN or infinite coordinates are left out."""
    from gppcs.engine.progress import ProgressBar
    from gppcs.engine.stages import Stages
    from gppcs.io.mesh_files import read_mesh

    set_threads(threads)
    if (simplified is None) == (simplified_mesh is None):
        found = "neither" if simplified is None else "both"
        raise ParameterError(f"expected either SIMPLIFIED or --simplified-mesh, found {found}")
    surface = read_mesh(mesh) if mesh else None
    stages = Stages(ProgressBar())
    if simplified_mesh is not None:
        _judge_mesh(original, simplified_mesh, mesh, surface, as_json, stages)
    elif simplified is not None:
        _judge_cloud(original, simplified, mesh, surface, as_json, stages)


def _judge_mesh(
    original: Path, simplified: Path, mesh: Path | None, surface: Mesh | None, as_json: bool, stages: Stages
) -> None:
    """Print the figures of a mesh."""
    from gppcs import io
    from gppcs.app.console import print_table
    from gppcs.evaluation.judge import evaluate_mesh
    from gppcs.io.mesh_files import read_mesh

    judged = read_mesh(simplified)
    before = io.read(original)
    report = evaluate_mesh(before.take(before.finite_rows()), judged, surface, stages)
    if as_json:
        files = {"original": str(original), "simplified_mesh": str(simplified), "mesh": str(mesh) if mesh else None}
        print_json({**files, "figures": report.figures(), "relative": report.figures(relative=True)})
    else:
        print_table(f"{original} → {simplified}", figure_rows(report))


def _judge_cloud(
    original: Path, simplified: Path, mesh: Path | None, surface: Mesh | None, as_json: bool, stages: Stages
) -> None:
    """Print the figures of a cloud."""
    from gppcs import io
    from gppcs.app.console import print_table
    from gppcs.evaluation.judge import evaluate as measured

    before, after = (cloud.take(cloud.finite_rows()) for cloud in map(io.read, (original, simplified)))
    report = measured(before, after, surface, stages)
    if as_json:
        files = {"original": str(original), "simplified": str(simplified), "mesh": str(mesh) if mesh else None}
        print_json({**files, "figures": report.figures(), "relative": report.figures(relative=True)})
    else:
        counts = f"{report.points_in:,} in, {report.points_out:,} out"
        print_table(f"{original} → {simplified}", {"points": counts, **figure_rows(report)})
    for name, rebuilt in (("", report.rebuilt), (", with carried normals,", report.rebuilt_carried)):
        if rebuilt and rebuilt.stray_share > 0:
            print_error(
                f"note: {rebuilt.stray_share:.2%} of the rebuilt mesh{name} lies far from the original mesh; "
                "see back max and stray share"
            )
