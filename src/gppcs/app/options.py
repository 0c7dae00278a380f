"""The options and arguments that commands share, and what their values stand for."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gppcs.amounts.options import Options
from gppcs.errors import ParameterError, file_path, shown

if TYPE_CHECKING:
    from gppcs.drawing.camera import Viewpoint


# The groups in which the help of a command lists its options. Those in no group come first.
SIZE = "Size of the result"
CHOICE = "Choice of the points"
METHOD = "Method"
INPUT = "Reading the input"
ATTRIBUTES = "Attributes of the result"
LOOK = "Figures and pictures"

HELP = {field.name: field.metadata["help"] for field in dataclasses.fields(Options)}


def option(text: str, panel: str | None = None, *names: str, **more: Any) -> Any:
    """Declare an option in a group of the help, under other names than that of the parameter if any are given."""
    return typer.Option(*names, help=text, rich_help_panel=panel, **more)


def from_field(name: str, panel: str | None = None, metavar: str | None = None, *names: str) -> Any:
    """Declare an option with the help text of a field of `Options`."""
    repeats = " Can be repeated." if name in ("detail", "quota") else ""
    return option(HELP[name] + repeats, panel, *names, metavar=metavar)


def output(metavar: str, text: str, parser: Callable[[Any], Path] | None = file_path) -> Any:
    """Declare the option for the file that a command writes."""
    return option(text, None, "--output", "-o", metavar=metavar, parser=parser)


def argument(metavar: str, text: str, **more: Any) -> Any:
    """Declare an argument."""
    return typer.Argument(metavar=metavar, help=text, show_default=False, **more)


files = partial(argument, parser=file_path)  # names a file, or several


FILES = "Point cloud files, folders or .vpc lists."

Cloud = Annotated[Path, files("IN", "A point cloud file.")]
Ratio = Annotated[str | None, from_field("ratio", SIZE, "FRACTION")]
Points = Annotated[str | None, from_field("n_points", SIZE, "M", "--points")]
Unit = Annotated[str | None, from_field("unit", SIZE, "NAME")]
Seed = Annotated[int | None, option("Seed of the methods that have one.", METHOD)]
Measured = Annotated[list[str] | None, option("Measure errors of an attribute, too.", None, "--detail", metavar="NAME")]
From = Annotated[str | None, option("Format of the input; default: by content.", INPUT, "--from", metavar="SUFFIX")]
To = Annotated[str | None, option("Format of the output; default: by name.", None, "--to", metavar="SUFFIX")]
Ascii = Annotated[bool | None, option("Write PLY or PCD as text.", None, "--ascii/--binary", show_default=False)]
Columns = Annotated[str | None, option("Columns of a text table, such as x,y,z,red.", INPUT, metavar="NAME,...")]
Inside = Annotated[
    list[str] | None,
    option(
        "Read only points in a box xmin,ymin,xmax,ymax, or with zmin and zmax, or in the polygons of a GeoJSON file. "
        "Can be repeated.",
        INPUT,
        metavar="BOX|FILE",
    ),
]
Only = Annotated[
    str | None, option("Read only points that meet a condition, such as 'z > 2.5'.", INPUT, metavar="CONDITION")
]
Resolution = Annotated[
    float | None, option("Read a COPC file only down to about this spacing.", INPUT, metavar="LENGTH")
]
Invalid = Annotated[Literal["error", "drop"], from_field("invalid", INPUT, "error|drop")]
Memory = Annotated[str | None, from_field("memory", metavar="SIZE")]
Workers = Annotated[str | None, from_field("workers", metavar="ADDRESS")]
Colour = Annotated[str | None, option("Colour by rgb, variation or an attribute.", LOOK, metavar="NAME")]
View = Annotated[
    str | None,
    option(
        "Direction of the view, in degrees. At 0,0 it is horizontal with x to the right (y with --up x or -x). A "
        "larger azimuth moves the viewer to the right around the cloud, a larger elevation up. Guessed by default.",
        LOOK,
        metavar="AZIMUTH,ELEVATION",
    ),
]
Up = Annotated[Literal["x", "y", "z", "-x", "-y", "-z"] | None, option("Axis that points up, else guessed.", LOOK)]
Threads = Annotated[int | None, option("Number of threads; by default all cores.", metavar="N")]
Force = Annotated[bool, option("Overwrite files, but never an input.", None, "--force")]
Lossy = Annotated[bool, option("Leave out what the format cannot hold.", None, "--lossy")]
Quiet = Annotated[bool, option("Print errors and notes only.", None, "--quiet", "-q")]
Json = Annotated[bool, option("Print JSON, one object a line.", None, "--json")]


def files_of_inside(inside: Sequence[str] | None) -> list[Path]:
    """Return the files of polygons that `--inside` names; a text with commas that names no file is a box."""
    return [Path(text) for text in inside or () if "," not in text or Path(text).exists()]


def weights_of(detail: Sequence[str] | None) -> dict[str, float]:
    """Return the weights of attributes, each given as NAME or NAME:WEIGHT."""
    weights = {}
    for text in detail or ():
        name, colon, weight = text.rpartition(":")
        try:
            weights[name if colon else text] = float(weight) if colon else 1.0
        except ValueError:
            raise ParameterError(f"expected --detail NAME or NAME:WEIGHT, found {shown(text)}") from None
    return weights


def viewpoint_of(view: str | None, up: str | None) -> Viewpoint:
    """Return the viewpoint that the options set."""
    from gppcs.drawing.camera import Viewpoint

    if view is None:
        return Viewpoint(up)
    try:
        azimuth, elevation = map(float, view.split(","))
    except ValueError:
        raise ParameterError(f"expected --view AZIMUTH,ELEVATION in degrees, such as 30,20, found {view!r}") from None
    return Viewpoint(up, (azimuth, elevation))
