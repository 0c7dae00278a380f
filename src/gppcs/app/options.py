"""The options and arguments that commands share, and what their values stand for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gppcs.app.panels import INPUT, LARGE, LOOK, METHOD, SIZE
from gppcs.errors import ParameterError, file_path, shown

if TYPE_CHECKING:
    from gppcs.drawing.viewpoint import Viewpoint
    from gppcs.io.query import Query


def option(text: str, panel: str | None = None, *names: str, **more: Any) -> Any:
    """Declare an option in a group of the help, under other names than that of the parameter if any are given."""
    return typer.Option(*names, help=text, rich_help_panel=panel, **more)


def output(metavar: str, text: str) -> Any:
    """Declare the option for the file that a command writes."""
    return option(text, None, "--output", "-o", metavar=metavar, parser=file_path)


def files(metavar: str, text: str) -> Any:
    """Declare an argument that names a file, or several."""
    return typer.Argument(metavar=metavar, help=text, parser=file_path, show_default=False)


FILES = "Point cloud files. A folder stands for all files in it that gppcs reads, a .vpc file for those that it lists."

Cloud = Annotated[Path, files("IN", "A point cloud file.")]
Ratio = Annotated[
    str | None,
    option("Share of the points to keep, above 0 and at most 1, such as 0.03 or 3%.", SIZE, metavar="SHARE"),
]
Points = Annotated[str | None, option("Number of points, such as 5000, 5,000, 5k or 1.5M.", SIZE, metavar="M")]
Unit = Annotated[
    str | None,
    option("Unit of the coordinates, such as m or mm, if the input does not tell it.", SIZE, metavar="NAME"),
]
Seed = Annotated[int | None, option("Seed of random numbers. Methods without random numbers ignore it.", METHOD)]
Measured = Annotated[
    list[str] | None,
    option(
        "Measure the error of this attribute, too: rgb, a number or classes. Can be repeated.",
        None,
        "--detail",
        metavar="NAME",
    ),
]
From = Annotated[
    str | None,
    option(
        "Format of the input, such as xyz. By default, the content tells; for text and OBJ, the name.",
        INPUT,
        "--from",
        metavar="SUFFIX",
    ),
]
To = Annotated[
    str | None,
    option("Format of the output, such as ply. By default, the name tells.", None, "--to", metavar="SUFFIX"),
]
Ascii = Annotated[
    bool | None,
    option(
        "Write PLY or PCD as text, or as binary data. By default, only PCD that comes from such text is text.",
        None,
        "--ascii/--binary",
        show_default=False,
    ),
]
Columns = Annotated[
    str | None,
    option(
        "Names of the columns of a text table, such as x,y,z,red,green,blue. They replace those in the file.",
        INPUT,
        metavar="NAME,...",
    ),
]
Inside = Annotated[
    list[str] | None,
    option(
        "Read only the points in a box, xmin,ymin,xmax,ymax or xmin,ymin,zmin,xmax,ymax,zmax, or inside the polygons "
        "of a GeoJSON file, in the coordinate system of the input. Give it twice for both.",
        INPUT,
        metavar="BOX|FILE",
    ),
]
Only = Annotated[
    str | None,
    option(
        "Read only the points that meet a condition on attributes and x, y, z, such as 'classification == 6 and "
        "z > 2.5'.",
        INPUT,
        metavar="CONDITION",
    ),
]
Resolution = Annotated[
    float | None,
    option(
        "Read a COPC file only down to the level on which neighbours are about that far from each other.",
        INPUT,
        metavar="LENGTH",
    ),
]
Drop = Annotated[
    Literal["invalid"] | None,
    option("Leave out the points with NaN or infinite coordinates, which are otherwise an error.", INPUT),
]
Memory = Annotated[
    str | None,
    option("How much memory to use, such as 2GB; half of what is free by default.", LARGE, metavar="SIZE"),
]
Workers = Annotated[
    str | None,
    option(
        "Share the work among this many processes of this machine, or among the workers of a Dask scheduler, such as "
        "tcp://10.0.0.5:8786.",
        LARGE,
        metavar="COUNT|ADDRESS",
    ),
]
Colour = Annotated[
    str | None,
    option(
        "What the colours of the points in the picture show: rgb, variation (surface variation), or an attribute of "
        "the input. By default surface variation, which shows where a method should keep more points.",
        LOOK,
        metavar="NAME",
    ),
]
View = Annotated[
    str | None,
    option(
        "Direction of the view, in degrees. At 0,0 it is horizontal with x to the right (y with --up x or -x). A "
        "larger azimuth moves the viewer to the right around the cloud, a larger elevation up. Guessed by default.",
        LOOK,
        metavar="AZIMUTH,ELEVATION",
    ),
]
Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"] | None,
    option("The axis that points up in the picture. Guessed by default.", LOOK),
]
Threads = Annotated[
    int | None, option("Number of threads. By default, as many as this process may use cores.", metavar="N")
]
Force = Annotated[bool, option("Overwrite existing files, but never an input.", None, "--force")]
Lossy = Annotated[
    bool,
    option(
        "Leave out values that the output format cannot hold, and round coordinates. Otherwise this is an error.",
        None,
        "--lossy",
    ),
]
Quiet = Annotated[
    bool,
    option("Show no progress and print no table. Errors and notes are still printed.", None, "--quiet", "-q"),
]
Json = Annotated[bool, option("Print JSON, one object per line.", None, "--json")]


def query_of(
    inside: Sequence[str] | None, only: str | None, resolution: float | None = None
) -> tuple[Query | None, list[Path]]:
    """Return what is asked for, and the files of `--inside`; a text with commas that names no file is a box."""
    from gppcs.io.query import Query

    boxes = [text for text in inside or () if "," in text and not Path(text).exists()]
    files = [file_path(text) for text in inside or () if text not in boxes]
    if "" in (inside or ()):
        raise ParameterError("expected --inside with the numbers of a box or with a GeoJSON file, found nothing")
    if len(boxes) > 1 or len(files) > 1:
        raise ParameterError("expected --inside with at most one box and one file, found two of a kind")
    try:
        limits = [float(limit) for limit in boxes[0].split(",")] if boxes else None
    except ValueError:
        expected = "expected --inside with the numbers of a box, such as 0,0,100,50, or with a GeoJSON file"
        raise ParameterError(f"{expected}, found {shown(boxes[0])}") from None
    return Query.of(limits, resolution, only, *files), files


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
    from gppcs.drawing.viewpoint import Viewpoint

    if view is None:
        return Viewpoint(up)
    try:
        azimuth, elevation = map(float, view.split(","))
    except ValueError:
        raise ParameterError(f"expected --view AZIMUTH,ELEVATION in degrees, such as 30,20, found {view!r}") from None
    return Viewpoint(up, (azimuth, elevation))
