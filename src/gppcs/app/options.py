"""The options and arguments that commands share, each declared once, and how a command declares its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from gppcs.app.panels import CHOICE, INPUT, LARGE, LOOK, METHOD, SIZE
from gppcs.errors import ParameterError, file_path, shown
from gppcs.methods import METHODS


def option(metavar: str | None, text: str, panel: str | None = None, *names: str, **more: Any) -> Any:
    """Declare an option, in a group of the help, under names other than that of the parameter if any are given."""
    return typer.Option(*names, metavar=metavar, help=text, rich_help_panel=panel, **more)


def output(metavar: str, text: str) -> Any:
    """Declare the option for the file that a command writes."""
    return option(metavar, text, None, "--output", "-o", parser=file_path)


def flag(name: str, text: str, panel: str | None = None) -> Any:
    """Declare an option without a value."""
    return option(None, text, panel, name)


def file_argument(metavar: str, text: str) -> Any:
    """Declare an argument that names a file, or several."""
    return typer.Argument(metavar=metavar, help=text, parser=file_path, show_default=False)


Cloud = Annotated[Path, file_argument("IN", "A point cloud file.")]

FILES = "Point cloud files. A folder stands for all files in it that gppcs reads, a .vpc file for those that it lists."

Ratio = Annotated[
    str | None,
    option("SHARE", "Share of the points to keep, above 0 and at most 1, such as 0.03 or 3%. Or give --points.", SIZE),
]

Points = Annotated[
    str | None, option("M", "Number of points to keep, such as 5000, 5,000, 5k or 1.5M. Or give --ratio.", SIZE)
]

Tolerance = Annotated[
    str | None,
    option(
        "LENGTH[:p95]",
        "Keep the fewest points whose local surface no original point is farther from than this, outliers aside: "
        "0.5 (in the unit of the coordinates), 0.5mm, or 0.02% of the diagonal. With :p95, :mean or :rms behind it, it "
        "bounds that error instead; with :max, outliers count, too. In place of --points.",
        SIZE,
    ),
]

Spacing = Annotated[
    str | None,
    option(
        "LENGTH",
        "Keep as many points as have this spacing: 0.05, 5cm or 1%. In place of --points. "
        + " ".join(
            f"{name}: {known.supports['spacing']}" for name, known in METHODS.items() if "spacing" in known.supports
        ),
        SIZE,
    ),
]

MaxGap = Annotated[
    str | None,
    option(
        "LENGTH",
        "Add points until each original point has a kept one within this distance. Alone or with --points and so on.",
        SIZE,
    ),
]

Unit = Annotated[
    str | None,
    option(
        "NAME",
        "Unit of the coordinates, such as m or mm, for lengths with a unit. By default, the coordinate system of the "
        "input tells it.",
        SIZE,
    ),
]

Levels = Annotated[
    str | None,
    option(
        "SIZE,...",
        "Make several sizes at once, such as 10%,3%,1% or 50k,5k, of which each is the start of the next. With "
        "{level} in the name, each is a file: level 0 is the coarsest. Otherwise OUT is the finest, and its attribute "
        "level tells to which level each point belongs first. In place of --points.",
        SIZE,
    ),
]

Json = Annotated[bool, flag("--json", "Print JSON, one object per line.")]

Threads = Annotated[int | None, option("N", "Number of threads. By default, as many as this process may use cores.")]

Force = Annotated[bool, flag("--force", "Overwrite existing files, but never an input.")]

Lossy = Annotated[
    bool,
    flag(
        "--lossy",
        "Leave out values that the output format cannot hold, and round coordinates. Otherwise this is an error.",
    ),
]

From = Annotated[
    str | None,
    option(
        "SUFFIX",
        "Format of the input, such as xyz. By default, the content tells; for text and OBJ, the name.",
        INPUT,
        "--from",
    ),
]

To = Annotated[
    str | None, option("SUFFIX", "Format of the output, such as ply. By default, the name tells.", None, "--to")
]

Ascii = Annotated[
    bool | None,
    option(
        None,
        "Write PLY or PCD as text, or as binary data. By default, only PCD that comes from such text is text.",
        None,
        "--ascii/--binary",
        show_default=False,
    ),
]

Quiet = Annotated[
    bool,
    option(None, "Show no progress and print no table. Errors and notes are still printed.", None, "--quiet", "-q"),
]

Columns = Annotated[
    str | None,
    option(
        "NAME,...",
        "Names of the columns of a text table, such as x,y,z,red,green,blue. They replace those in the file.",
        INPUT,
    ),
]

Box = Annotated[
    str | None,
    option(
        "XMIN,YMIN,...",
        "Read only the points in this box: xmin,ymin,xmax,ymax or xmin,ymin,zmin,xmax,ymax,zmax.",
        INPUT,
    ),
]

Only = Annotated[
    str | None,
    option(
        "CONDITION",
        "Read only the points that meet a condition on attributes and x, y, z, such as 'classification == 6 and z > "
        "2.5'.",
        INPUT,
    ),
]

Inside = Annotated[
    Path | None,
    option(
        "FILE",
        "Read only the points inside the polygons of a GeoJSON file, in the coordinate system of the input.",
        INPUT,
        "--polygon",
        parser=file_path,
    ),
]

Keep = Annotated[
    str | None,
    option(
        "CONDITION",
        "Keep all points that meet a condition on attributes and x, y, z, such as 'classification == 6'. They count in "
        "--points, and the others are chosen where these are not (method gp).",
        CHOICE,
    ),
]

Weight = Annotated[
    str | None,
    option("NAME", "Multiply the density of the kept points by this attribute, from 0 on (method gp).", CHOICE),
]

Quota = Annotated[
    list[str] | None,
    option(
        "'CONDITION: NUMBER'",
        "Keep exactly this number of points that meet a condition, or this share of the kept points, such as "
        "'classification == 6: 10%'. The other points share the rest. Can be repeated (methods "
        "that rank their points).",
        CHOICE,
    ),
]

Group = Annotated[
    str | None,
    option(
        "NAME",
        "Keep or drop groups whole: points with an equal attribute, such as the pulses of a laser by gps_time. There "
        "are then as near to --points as whole groups allow (methods that rank their points).",
        CHOICE,
    ),
]


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


Detail = Annotated[
    list[str] | None,
    option(
        "NAME[:WEIGHT]",
        "Let this attribute count beside the shape: rgb (red, green and blue), a number such as intensity, or classes. "
        "The weight is 1 if none is given. Can be repeated (method gp).",
        CHOICE,
    ),
]

Seed = Annotated[int | None, option(None, "Seed of random numbers. Methods without random numbers ignore it.", METHOD)]

Resolution = Annotated[
    float | None,
    option(
        "LENGTH",
        "Read a COPC file only down to the level on which neighbours are about that far from each other.",
        INPUT,
    ),
]

DropInvalid = Annotated[
    Literal["invalid"] | None,
    option(
        None, "Leave out the points with NaN or infinite coordinates, which are otherwise an error.", INPUT, "--drop"
    ),
]

Merge = Annotated[bool, flag("--merge", "Take all inputs as one cloud, in the order in which they are given.", INPUT)]

AssumeSameCrs = Annotated[
    bool,
    flag(
        "--assume-same-crs",
        "If several files are one cloud, give all of them the coordinate system of the first file. Without this "
        "option, files with different coordinate systems are an error.",
        INPUT,
    ),
]

Memory = Annotated[
    str | None,
    option(
        "SIZE",
        "How much memory to use, such as 2GB; half of what is free by default. The points of a larger cloud go to "
        "temporary files, where other points are chosen than in memory, but equally good ones.",
        LARGE,
    ),
]

Workers = Annotated[
    str | None,
    option(
        "COUNT|ADDRESS",
        "Share the work among this many processes of this machine, in place of threads, or among the workers of a "
        "Dask scheduler, such as tcp://10.0.0.5:8786.",
        LARGE,
    ),
]

DryRun = Annotated[bool, flag("--dry-run", "Print what would be done and in how much memory, and do nothing.", LARGE)]

Measured = Annotated[
    list[str] | None,
    option(
        "NAME", "Measure the error of this attribute, too: rgb, a number or classes. Can be repeated.", None, "--detail"
    ),
]

View = Annotated[
    str | None,
    option(
        "AZIMUTH,ELEVATION",
        "Direction of the view, in degrees. At 0,0 it is horizontal with x to the right (y with --up x or -x). "
        "A larger azimuth moves the viewer to the right around the cloud, a larger elevation up. Guessed by default.",
        LOOK,
    ),
]

Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"] | None,
    option(None, "The axis that points up in the picture. Guessed by default.", LOOK),
]

Colour = Annotated[
    str | None,
    option(
        "NAME",
        "What the colours of the points in the picture show: rgb, variation (surface variation), or an attribute of "
        "the input. By default surface variation, which shows where a method should keep more points.",
        LOOK,
    ),
]
