"""The options and arguments that commands share, how a command declares its own, and what values stand for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from gppcs.app.panels import CHOICE, INPUT, LARGE, LOOK, METHOD, SIZE
from gppcs.errors import ParameterError, file_path, shown
from gppcs.methods import METHODS, Feature

if TYPE_CHECKING:
    from gppcs.drawing.viewpoint import Viewpoint
    from gppcs.io.query import Query


def option(
    metavar: str | None, text: str, panel: str | None = None, *names: str, default: Any = None, **more: Any
) -> Any:
    """Declare an option, in a group of the help, under names other than that of the parameter if any are given."""
    return typer.Option(default, *names, metavar=metavar, help=text, rich_help_panel=panel, **more)


def output(metavar: str, text: str, default: Any = ...) -> Any:
    """Declare the option for the file that a command writes."""
    return option(metavar, text, None, "--output", "-o", default=default, parser=file_path)


def flag(name: str, text: str, panel: str | None = None) -> Any:
    """Declare an option without a value."""
    return option(None, text, panel, name, default=False)


def file_argument(metavar: str, text: str, default: Any = ...) -> Any:
    """Declare an argument that names a file, or several."""
    return typer.Argument(default, metavar=metavar, help=text, parser=file_path, show_default=False)


Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Invalid = Literal["invalid"]

CLOUD = file_argument("IN", "A point cloud file.")
FILES = "Point cloud files. A folder stands for all files in it that gppcs reads, a .vpc file for those that it lists."
RATIO = option(
    "SHARE", "Share of the points to keep, above 0 and at most 1, such as 0.03 or 3%. Or give --points.", SIZE
)
POINTS = option("M", "Number of points to keep, such as 5000, 5,000, 5k or 1.5M. Or give --ratio.", SIZE)
TOLERANCE = option(
    "LENGTH[:p95]",
    "Keep the fewest points whose local surface no original point is farther from than this, outliers aside: "
    "0.5 (in the unit of the coordinates), 0.5mm, or 0.02% of the diagonal. With :p95, :mean or :rms behind it, it "
    "bounds that error instead; with :max, outliers count, too. In place of --points.",
    SIZE,
)
SPACING = option(
    "LENGTH",
    "Keep as many points as have this spacing: 0.05, 5cm or 1%. In place of --points. "
    + " ".join(
        f"{name}: {known.supports[Feature.SPACING]}"
        for name, known in METHODS.built_in.items()
        if Feature.SPACING in known.supports
    ),
    SIZE,
)
MAX_GAP = option(
    "LENGTH",
    "Add points until each original point has a kept one within this distance. Alone or with --points and so on.",
    SIZE,
)
UNIT = option(
    "NAME",
    "Unit of the coordinates, such as m or mm, for lengths with a unit. By default, the coordinate system of the "
    "input tells it.",
    SIZE,
)
LEVELS = option(
    "SIZE,...",
    "Make several sizes at once, such as 10%,3%,1% or 50k,5k, of which each is the start of the next. With "
    "{level} in the name, each is a file: level 0 is the coarsest. Otherwise OUT is the finest, and its attribute "
    "level tells to which level each point belongs first. In place of --points.",
    SIZE,
)
JSON = flag("--json", "Print JSON, one object per line.")
THREADS = option("N", "Number of threads. By default, as many as this process may use cores.")
FORCE = flag("--force", "Overwrite existing files, but never an input.")
LOSSY = flag(
    "--lossy", "Leave out values that the output format cannot hold, and round coordinates. Otherwise this is an error."
)
FROM = option(
    "SUFFIX",
    "Format of the input, such as xyz. By default, the content tells; for text and OBJ, the name.",
    INPUT,
    "--from",
)
TO = option("SUFFIX", "Format of the output, such as ply. By default, the name tells.", None, "--to")
ASCII = option(
    None,
    "Write PLY or PCD as text, or as binary data. By default, only PCD that comes from such text is text.",
    None,
    "--ascii/--binary",
    show_default=False,
)
QUIET = option(
    None,
    "Show no progress and print no table. Errors and notes are still printed.",
    None,
    "--quiet",
    "-q",
    default=False,
)
COLUMNS = option(
    "NAME,...",
    "Names of the columns of a text table, such as x,y,z,red,green,blue. They replace those in the file.",
    INPUT,
)
INSIDE = option(
    "BOX|FILE",
    "Read only the points in a box, xmin,ymin,xmax,ymax or xmin,ymin,zmin,xmax,ymax,zmax, or inside the polygons "
    "of a GeoJSON file, in the coordinate system of the input. Give it twice for both.",
    INPUT,
)

ONLY = option(
    "CONDITION",
    "Read only the points that meet a condition on attributes and x, y, z, such as 'classification == 6 and z > 2.5'.",
    INPUT,
)
KEEP = option(
    "CONDITION",
    "Keep all points that meet a condition on attributes and x, y, z, such as 'classification == 6'. They count in "
    "--points, and the others are chosen where these are not (method gp).",
    CHOICE,
)
WEIGHT = option("NAME", "Multiply the density of the kept points by this attribute, from 0 on (method gp).", CHOICE)
QUOTA = option(
    "'CONDITION: NUMBER'",
    "Keep exactly this number of points that meet a condition, or this share of the kept points, such as "
    "'classification == 6: 10%'. The other points share the rest. Can be repeated (methods "
    "that rank their points).",
    CHOICE,
)
GROUP = option(
    "NAME",
    "Keep or drop groups whole: points with an equal attribute, such as the pulses of a laser by gps_time. There "
    "are then as near to --points as whole groups allow (methods that rank their points).",
    CHOICE,
)

DETAIL = option(
    "NAME[:WEIGHT]",
    "Let this attribute count beside the shape: rgb (red, green and blue), a number such as intensity, or classes. "
    "The weight, from 0 to 1000, is 1 if none is given. Can be repeated (method gp).",
    CHOICE,
)
SEED = option(None, "Seed of random numbers. Methods without random numbers ignore it.", METHOD)
RESOLUTION = option(
    "LENGTH", "Read a COPC file only down to the level on which neighbours are about that far from each other.", INPUT
)
DROP_INVALID = option(
    None, "Leave out the points with NaN or infinite coordinates, which are otherwise an error.", INPUT, "--drop"
)
ASSUME_SAME_CRS = flag(
    "--assume-same-crs",
    "If several files are one cloud, give all of them the coordinate system of the first file. Without this "
    "option, files with different coordinate systems are an error.",
    INPUT,
)
MEMORY = option(
    "SIZE",
    "How much memory to use, such as 2GB; half of what is free by default. The points of a larger cloud go to "
    "temporary files, where other points are chosen than in memory, but equally good ones.",
    LARGE,
)
WORKERS = option(
    "COUNT|ADDRESS",
    "Share the work among this many processes of this machine, in place of threads, or among the workers of a "
    "Dask scheduler, such as tcp://10.0.0.5:8786.",
    LARGE,
)
DRY_RUN = flag("--dry-run", "Print what would be done and in how much memory, and do nothing.", LARGE)
MEASURED = option(
    "NAME", "Measure the error of this attribute, too: rgb, a number or classes. Can be repeated.", None, "--detail"
)
VIEW = option(
    "AZIMUTH,ELEVATION",
    "Direction of the view, in degrees. At 0,0 it is horizontal with x to the right (y with --up x or -x). "
    "A larger azimuth moves the viewer to the right around the cloud, a larger elevation up. Guessed by default.",
    LOOK,
)
UP = option(None, "The axis that points up in the picture. Guessed by default.", LOOK)
COLOUR = option(
    "NAME",
    "What the colours of the points in the picture show: rgb, variation (surface variation), or an attribute of "
    "the input. By default surface variation, which shows where a method should keep more points.",
    LOOK,
)


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
