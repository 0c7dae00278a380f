"""The command `gppcs info`: facts about clouds."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gppcs.app import options
from gppcs.app.outputs import sources_of
from gppcs.app.printing import emit, for_each, names_of, text_of

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud

EPILOG = "gppcs info scan.ply --json\n\ngppcs info a.ply b.xyz folder"


def info(
    files: Annotated[list[Path], options.files("FILE...", options.FILES)],
    input_format: options.From = None,
    columns: options.Columns = None,
    inside: options.Inside = None,
    only: options.Only = None,
    resolution: options.Resolution = None,
    as_json: options.Json = False,
) -> None:
    """Print the number of points, bounding box, unit, spacing, repeats, invalid points, and each attribute's range.

    If the file is a mesh, it also says how many faces there are. If one of several files cannot be read, the others are
    still shown, and the exit code is 2.
    """
    from gppcs import io

    def show_info(file: Path) -> None:
        with io.CloudFiles([file], input_format, names_of(columns), inside or None, only, resolution) as clouds:
            _print(file, clouds.read(), clouds.n_faces, as_json)

    for_each(sources_of(files), show_info)


def _print(file: Path, cloud: PointCloud, faces: int, as_json: bool) -> None:
    """Print the facts about one file."""
    from gppcs.clouds.summary import info as summarise

    summary = summarise(cloud)
    record = {"file": str(file), **dataclasses.asdict(summary), "faces": faces}
    table = {
        name: value
        for name, value in record.items()
        if value is not None and name not in ("file", "attributes", "ranges")
    }
    for name in ("minimum", "maximum"):
        table[name] = "  ".join(f"{value:.9g}" for value in table[name])  # may be far away
    table["unit"] = summary.unit or "the file does not say it"
    for name, kind in summary.attributes.items():
        kind = re.sub(r"^[<>]U\d+", "text", kind)
        table[f"attribute {name}"] = f"{kind:<8}  {_written(summary.ranges[name])}"
    emit(record, as_json, False, str(file), table)


def _written(limits: tuple[float, float] | None) -> str:
    """Return the range of an attribute."""
    if limits is None:
        return ""
    smallest, largest = map(text_of, limits)
    return smallest if smallest == largest else f"{smallest} to {largest}"
