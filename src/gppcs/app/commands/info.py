"""The command `gppcs info`: facts about clouds."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import TYPE_CHECKING

from gppcs.app import options
from gppcs.app.outputs import sources_of
from gppcs.app.printing import for_each, names_of, show

if TYPE_CHECKING:
    from gppcs.clouds.summary import Summary
    from gppcs.io.reading import Loaded

EPILOG = "gppcs info scan.ply --json\n\ngppcs info a.ply b.xyz folder"


def info(
    files: list[Path] = options.file_argument("FILE...", options.FILES),
    input_format: str | None = options.FROM,
    columns: str | None = options.COLUMNS,
    inside: list[str] | None = options.INSIDE,
    only: str | None = options.ONLY,
    resolution: float | None = options.RESOLUTION,
    as_json: bool = options.JSON,
) -> None:
    """Print the number of points, bounding box, unit, spacing, repeats, invalid points, and each attribute's range.

    If the file is a mesh, it also says how many faces there are. If one of several files cannot be read, the others are
    still shown, and the exit code is 2.
    """
    from gppcs import io

    query, _ = options.query_of(inside, only, resolution)
    part = (input_format, names_of(columns), query)
    for_each(sources_of(files), lambda file: _print(file, io.load(file, *part), as_json))


def _print(file: Path, loaded: Loaded, as_json: bool) -> None:
    """Print the facts about one file."""
    from gppcs.clouds.summary import info as summarise

    summary, faces = summarise(loaded.cloud), loaded.faces
    unit = f" {summary.unit}" if summary.unit else ""
    rows = {
        "points": f"{summary.points:,}",
        "low corner": "  ".join(f"{value:.9g}" for value in summary.low),
        "high corner": "  ".join(f"{value:.9g}" for value in summary.high),
        "unit": summary.unit or "the file does not say it",
        "diagonal": f"{summary.diagonal:.6g}{unit}",
        "spacing": f"{summary.spacing:.4g}{unit} (median distance to the nearest other point)",
        "repeats": f"{summary.repeats:,}",
        "not finite": f"{summary.non_finite:,}",
        "coordinates": summary.coordinate_type,
    }
    if summary.crs:
        rows["coordinate system"] = summary.crs
    if faces:
        rows["faces"] = f"{faces:,} (the file is a mesh; only its vertices are read)"
    record = {"file": str(file), **dataclasses.asdict(summary), "faces": faces}
    show(record, str(file), rows | _attribute_rows(summary), as_json)


def _attribute_rows(summary: Summary) -> dict[str, str]:
    """Return the type and the range of each attribute as rows of a table."""
    kinds = {name: re.sub(r"^[<>]U\d+", "text", kind) for name, kind in summary.attributes.items()}
    width = max(map(len, kinds.values()), default=0)
    return {f"attribute {name}": f"{kind:<{width}}  {_written(summary.ranges[name])}" for name, kind in kinds.items()}


def _written(limits: tuple[float, float] | None) -> str:
    """Return a range in words; whole numbers in full, others with nine digits, as coordinates have."""
    if limits is None:
        return ""
    least, greatest = (f"{limit}" if isinstance(limit, int) else f"{limit:.9g}" for limit in limits)
    return least if least == greatest else f"{least} to {greatest}"
