"""The command `gppcs info`: facts about clouds."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import gppcs
from gppcs.app import options
from gppcs.app.printing import emit, for_each, names_of, text_of, unit_text

if TYPE_CHECKING:
    from gppcs.clouds.summary import Summary

EPILOG = "gppcs info scan.ply --json\n\ngppcs info a.ply b.xyz folder"


def info(
    files: Annotated[list[Path], options.files("FILE...", options.FILES)],
    input_format: options.From = None,
    columns: options.Columns = None,
    inside: options.Inside = None,
    only: options.Only = None,
    resolution: options.Resolution = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Print the number of points, bounding box, unit, spacing, repeats, invalid points, and each attribute's range.

    If the file is a mesh, it also says how many faces there are. If one of several files cannot be read, the others are
    still shown, and the exit code is 2.
    """
    from gppcs import io
    from gppcs.app.inputs import note_empty, note_unused
    from gppcs.app.outputs import sources_of

    def show_info(file: Path) -> None:
        with io.CloudFiles([file], input_format, names_of(columns), inside or None, only, resolution) as clouds:
            summary, faces = gppcs.info(clouds.read()), clouds.n_faces
            note_unused(file, clouds, are_faces_used=True)  # they are counted
            if clouds.query:
                note_empty(file, clouds, summary.points)
        emit({"file": str(file), **asdict(summary), "faces": faces}, as_json, quiet, str(file), _table(summary, faces))

    for_each(sources_of(files), show_info)


def _table(summary: Summary, faces: int) -> dict[str, Any]:
    """Return the facts about one file, for a table."""
    table = asdict(summary) | {"unit": unit_text(summary.unit), "faces": faces}
    horizontal, vertical = table.pop("coordinate_units") or ("", "")
    if horizontal != vertical:
        table["unit"] = f"{horizontal} in x and y, {vertical} in z; of lengths: {summary.unit}"
    kinds, ranges = table.pop("attributes"), table.pop("ranges")
    for name in ("minimum", "maximum"):
        table[name] = "  ".join(f"{value:.9g}" for value in table[name])  # may be far away
    for name, limits in ranges.items():
        kind = re.sub(r"^[<>]U\d+", "text", kinds[name])
        title = f"attribute {name}" if name.isidentifier() else f'attribute ["{name}"]'  # as conditions take it
        table[title] = f"{kind:<8}  {' to '.join(dict.fromkeys(map(text_of, limits or ())))}"
    return {name: value for name, value in table.items() if value is not None}
