"""The command `gppcs info`: facts about clouds."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import gppcs
from gppcs.app import options
from gppcs.app.options import option
from gppcs.app.printing import emit, for_each, names_of, say, text_of, unit_text

if TYPE_CHECKING:
    from gppcs.clouds.cloud import PointCloud

LARGE = 1_000_000  # points of a LAS file of which its header is shown

EPILOG = "gppcs info scan.ply --json\n\ngppcs info a.ply b.xyz folder"


def info(
    files: Annotated[list[Path], options.files("FILE...", options.FILES)],
    input_format: options.From = None,
    columns: options.Columns = None,
    inside: options.Inside = None,
    only: options.Only = None,
    resolution: options.Resolution = None,
    everything: Annotated[
        bool, option("Read all points of large LAS files, too, not only what their headers tell.", None, "--all")
    ] = False,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Print the number of points, bounding box, unit, spacing, repeats, invalid points, attributes and classes.

    Of LAS, LAZ and COPC files of more than a million points, it prints what the header tells, at once. If the file is a
    mesh, it also says how many faces there are. If one of several files cannot be read, the others are still shown, and
    the exit code is 2.
    """
    from gppcs import io
    from gppcs.app.outputs import note_empty, note_unused, sources_of

    def show_info(file: Path) -> None:
        with io.CloudFiles([file], input_format, names_of(columns), inside or None, only, resolution) as clouds:
            bounds = None if everything else clouds.bounds
            if bounds is not None and clouds.n_points <= LARGE:
                bounds = None
            cloud = clouds.read() if bounds is None else clouds.preview
            summary, faces = gppcs.info(cloud), clouds.n_faces
            record = {"file": str(file), **asdict(summary), "classes": _classes(cloud), "faces": faces}
            if bounds is not None:
                lower, upper = bounds.tolist()
                unknown = dict.fromkeys(("diagonal", "spacing", "repeats", "non_finite"))
                record |= {"points": clouds.n_points, "minimum": lower, "maximum": upper, **unknown, "classes": {}}
                record["ranges"] = dict.fromkeys(summary.ranges)
            note_unused(file, clouds, are_faces_used=True)  # they are counted
            if clouds.query:
                note_empty(file, clouds, summary.points)
        emit(record, as_json, quiet, str(file), _table(record))
        if bounds is not None and not (quiet or as_json):
            say("gppcs info --all also tells diagonal, spacing, repeats, classes and the ranges of attributes")

    for_each(((file, file) for file in sources_of(files)), show_info)


def _classes(cloud: PointCloud) -> dict[str, int]:
    """Return how many points each class has, by its number and its name."""
    import numpy as np

    from gppcs.clouds.columns import CLASS_NAMES, CLASSIFICATION

    values = cloud.attributes.get(CLASSIFICATION)
    if values is None or values.dtype.kind not in "iu" or values.ndim > 1:
        return {}
    names = dict(enumerate(CLASS_NAMES))
    classes, counts = np.unique(values, return_counts=True)
    return {f"{n} {names.get(n, '')}".strip(): k for n, k in zip(classes.tolist(), counts.tolist(), strict=True)}


def _table(record: dict[str, Any]) -> dict[str, Any]:
    """Return the facts about one file, for a table."""
    table = {name: value for name, value in record.items() if name != "file"} | {"unit": unit_text(record["unit"])}
    horizontal, vertical = table.pop("coordinate_units") or ("", "")
    if horizontal != vertical:
        table["unit"] = f"{horizontal} in x and y, {vertical} in z; of lengths: {record['unit']}"
    sides = [upper - lower for lower, upper in zip(record["minimum"], record["maximum"], strict=True)]
    if sides[0] * sides[1] > 0 and horizontal != "degrees":
        square = f"{horizontal or 'unit'}² in x and y"
        table["density"] = f"{record['points'] / (sides[0] * sides[1]):.4g} points per {square}"
    for name, count in table.pop("classes").items():
        table[f"class {name}"] = f"{count:,}  ({count / record['points']:.1%})"
    kinds, ranges = table.pop("attributes"), table.pop("ranges")
    for name in ("minimum", "maximum"):
        table[name] = "  ".join(f"{value:.9g}" for value in table[name])  # may be far away
    for name, limits in ranges.items():
        kind = re.sub(r"^[<>]U\d+", "text", kinds[name])
        title = f"attribute {name}" if name.isidentifier() else f'attribute ["{name}"]'  # as conditions take it
        table[title] = f"{kind:<8}  {' to '.join(dict.fromkeys(map(text_of, limits or ())))}"
    return {name: value for name, value in table.items() if value is not None}
